# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One verifier for every descriptor: pairs are registered once, and results stay those of one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import artefact
from fusionslam.config import merged
from fusionslam.datasets.pose_files import write_poses_tum
from fusionslam.errors import ConfigError
from fusionslam.evaluation import VerifiedRun
from fusionslam.loop_closure import verification
from fusionslam.pipelines.compare_descriptors import benchmark
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.reusable_runs import describe_recording
from fusionslam.pipelines.shared_verification import verify_each
from fusionslam.pipelines.verified_loops import verify_recording
from refusals import refuses
from streets import WAY, write_street

NAMES = ("m2dp", "m2dp:author", "scan_context", "bev_spectrum")
ONE_AND_NIGHTLY_ALL = [
    pytest.param(name, marks=[pytest.mark.slow if name == "scan_context" else pytest.mark.nightly])
    for name in NAMES
]
CONFIG = merged(
    PipelineConfig(),
    {
        "fusion": {"source": "cloud"},
        "loop_closure": {"window": 3, "candidates": 4, "voters": ()},
        "evaluation": {"window": 3, "radius": 5.0},
    },
)
FIELDS = ("match", "match_from_query", "covariance", "overlap", "probability", "distance")
FIELDS += ("accepted", "candidates", "rejected", "frames", "numbers", "points")


def write_way(folder: Path) -> None:
    way = WAY[3:15]  # six frames out, and six back
    write_street(folder, way)
    write_poses_tum(folder / "poses.txt", np.arange(len(way)) * 10**9, np.array(way))


@pytest.fixture(scope="module")
def street() -> Recording:
    return Recording.at(artefact("street-to-verify", write_way))


def prove(street: Recording, folder: Path, names: tuple[str, ...], **options: Any) -> Any:
    dataset = street.open("cloud")
    runs = describe_recording(street, dataset, folder, names, config=CONFIG)
    found = verify_each(street, dataset, folder, runs, config=CONFIG, **options)
    return dict(zip(names, found, strict=True))


@pytest.fixture(scope="module")
def together(street: Recording, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The loops of all descriptors, proven together."""
    return prove(street, tmp_path_factory.mktemp("together"), NAMES, jobs=2)


def assert_same(one: VerifiedRun, other: VerifiedRun) -> None:
    assert one.descriptors == other.descriptors
    for name in FIELDS:
        first, second = getattr(one, name), getattr(other, name)
        assert first.tobytes() == second.tobytes(), name


@pytest.mark.parametrize("name", ONE_AND_NIGHTLY_ALL)
def test_each_descriptor_has_the_loops_of_its_own_detector(
    name: str, street: Recording, together: Any, tmp_path: Path
) -> None:
    assert any(run.accepted.any() for run in together.values())
    alone = verify_recording(street, street.open("cloud"), tmp_path, name, config=CONFIG)
    assert_same(together[name], alone)


@pytest.mark.parametrize("name", ONE_AND_NIGHTLY_ALL)
def test_results_do_not_depend_on_the_other_descriptors(
    name: str, street: Recording, together: Any, tmp_path: Path
) -> None:
    assert_same(together[name], prove(street, tmp_path, (name,))[name])


@pytest.mark.slow
def test_a_pair_is_registered_once_however_many_propose_it(
    street: Recording, together: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[bytes, bytes, bytes]] = []
    register = verification.register

    def count(source: Any, target: Any, guess: Any, **options: Any) -> Any:
        seen.append((source.points.tobytes(), target.points.tobytes(), guess.tobytes()))
        return register(source, target, guess, **options)

    monkeypatch.setattr(verification, "register", count)
    found = prove(street, tmp_path, NAMES, jobs=1)
    assert len(set(seen)) == len(seen)
    tried = sum(int((run.candidates >= 0).any(axis=1).sum()) for run in found.values())
    assert 0 < len(seen) < tried
    for name in NAMES:
        assert_same(found[name], together[name])


@pytest.mark.slow
def test_a_further_descriptor_leaves_stored_loops_alone(street: Recording, tmp_path: Path) -> None:
    prove(street, tmp_path, NAMES[1:2])
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "verified").iterdir()}
    assert {path.name for path in files} == {"cloud-m2dp-author.npz"}
    prove(street, tmp_path, NAMES[:2])
    assert len(list((tmp_path / "verified").iterdir())) == 2
    assert all(path.stat().st_mtime_ns == then for path, then in files.items())


@pytest.mark.slow
def test_bench_judges_each_descriptor_unverified_too(street: Recording, tmp_path: Path) -> None:
    names = NAMES[:2]
    found = benchmark(street, tmp_path, names, configs={"cloud": CONFIG}, verify="each")
    judged = [evaluation.run.name for evaluation in found]
    assert judged == [*names, *(f"verified {name}" for name in names)]
    assert len({tuple(evaluation.run.numbers) for evaluation in found}) == 1
    plain = benchmark(street, tmp_path, names, configs={"cloud": CONFIG}, verify="none")
    assert [evaluation.run.name for evaluation in plain] == [*names]


def test_only_the_known_ways_to_verify_are_taken(street: Recording, tmp_path: Path) -> None:
    with refuses("choice", "verify", "every", error=ConfigError):
        benchmark(street, tmp_path, verify="every")
    assert not list(tmp_path.iterdir())
