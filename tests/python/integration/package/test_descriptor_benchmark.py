# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command that writes the page on all descriptors."""

from typing import Any

import numpy as np

from benchmarks.accuracy import descriptors as command
from benchmarks.accuracy.descriptor_pairs import distance_by, share
from benchmarks.accuracy.descriptors import GROUPS, KINDS, WORLDS, is_ours, tables_of, verdict
from benchmarks.accuracy.kitti_pairs import PLACES
from fusionslam.evaluation import DescriptorRun, evaluate, evaluate_verified
from fusionslam.report.loops.comparison import Compared, pair_up
from rows import rows
from verified import PLACES as WAY
from verified import verified_run


def town(seed: int, names: tuple[str, ...] = ("scan_context", "m2dp")) -> list[Compared]:
    """The first descriptor knows every place, the others hardly any."""
    rng, count = np.random.default_rng(seed), len(WAY)
    evaluations = []
    for name in names:
        vectors = rng.normal(size=(count, 1200 if name == "scan_context" else 2))
        if name == names[0]:
            vectors[:] = 0
            vectors[:, : 2 if name == "m2dp" else 20] = 1
            vectors[:, :2] += [place[:2] for place in WAY]
        run = DescriptorRun(
            source="cloud",
            descriptor=name,
            dataset="nine frames",
            descriptors=vectors.astype(np.float32),
            frames=np.arange(count),
            stamps_ns=np.arange(count),
            poses=verified_run().poses,
            seconds={"describe": np.full(count, 0.01 + seed / 1000)},
            peak_memory_bytes=0,
            points=np.full(count, 9),
            config={"descriptors": {"preset": "robust"}},
        )
        evaluations.append(evaluate(run, window=0))
        loops = verified_run(source="cloud", descriptors=(name,))
        evaluations.append(evaluate_verified(loops, window=0))
    return pair_up(evaluations)


def found(**worlds: list[Compared]) -> Any:
    return {("towns", "circle"): worlds}


def test_every_table_has_a_place_on_the_page() -> None:
    page = command.PAGE.read_text(encoding="utf-8")
    groups = {world.group for world in WORLDS.values()}
    assert groups == set(GROUPS)
    for kind in KINDS:
        for world in WORLDS.values():
            if kind.is_recorded(world.name):
                assert f"<!-- {world.group}-{kind.name}: " in page
    for name in ("verdict", "pairs", "left-out"):
        assert f"<!-- {name}: " in page


def test_a_table_says_mean_and_range_and_how_many_revisits_there_are() -> None:
    (text,) = tables_of(found(one=town(1), two=town(2)), refined=1).values()
    assert "18 frames, 8 of them revisits" in text.replace("\n", " ")
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert [row.split(" | ")[0].strip("| ") for row in rows if "descriptor" not in row] == [
        *("scan_context", "m2dp robust") * 2
    ]
    assert any("11.5 (11.0 to 12.0)" in row for row in rows)  # ms to make


def test_the_verdict_names_the_best_and_the_best_of_ours_where_it_loses() -> None:
    lines = verdict(found(one=town(1, ("m2dp", "scan_context")))).splitlines()
    top = next(line for line in lines if " top-1: " in line)
    assert "`m2dp` 1.000 (ours)" in top
    lines = verdict(found(one=town(1, ("shot", "m2dp")))).splitlines()
    top = next(line for line in lines if " top-1: " in line)
    assert "`shot` 1.000; the best of ours, `m2dp`, " in top


@rows(
    "name, ours",
    [
        *(("m2dp", True), ("m2dp:author", False), ("cm2dp:upright", True)),
        *(("shot", False), ("bev_spectrum", True), ("scan_context", False)),
    ],
)
def test_ours_are_our_descriptors_and_presets(name: str, ours: bool) -> None:
    assert is_ours(name) is ours


def test_a_pair_is_measured_by_the_nearest_other_place() -> None:
    vectors = {name: np.zeros(2, np.float32) for place in PLACES.values() for name in place}
    for number, place in enumerate(PLACES.values()):
        for side, name in enumerate(place):
            vectors[name][:] = 10 * number, 3 * side
    distance = distance_by("l2")
    assert share(vectors, "00 at 94", distance) == "**0.30**"
    vectors[PLACES["00 at 94"][1]][1] = 30
    assert share(vectors, "00 at 94", distance) == "3.00"
