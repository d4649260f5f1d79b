# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One verifier for every descriptor: pairs are registered once, and results stay those of one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

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
from streets import WAY, write_street

pytest.importorskip("small_gicp")

NAMES = ("m2dp", "m2dp:author", "scan_context", "bev_spectrum")
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


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = write_street(tmp_path_factory.mktemp("street"), WAY)
    stamps = np.arange(len(WAY)) * 10**9
    write_poses_tum(folder / "poses.txt", stamps, np.array(WAY))
    return Recording.at(folder)


def prove(street: Recording, folder: Path, names: tuple[str, ...], **options: Any) -> Any:
    dataset = street.open("cloud")
    runs = describe_recording(street, dataset, folder, names, config=CONFIG)
    found = verify_each(street, dataset, folder, runs, config=CONFIG, **options)
    return dict(zip(names, found, strict=True))


def assert_same(one: VerifiedRun, other: VerifiedRun) -> None:
    assert one.descriptors == other.descriptors
    for name in FIELDS:
        first, second = getattr(one, name), getattr(other, name)
        assert first.tobytes() == second.tobytes(), name


def test_each_descriptor_has_the_loops_of_its_own_detector(
    street: Recording, tmp_path: Path
) -> None:
    together = prove(street, tmp_path / "together", NAMES, jobs=2)
    assert any(run.accepted.any() for run in together.values())
    dataset = street.open("cloud")
    for name, run in together.items():
        alone = verify_recording(street, dataset, tmp_path / name, name, config=CONFIG)
        assert_same(run, alone)


def test_results_do_not_depend_on_the_other_descriptors(street: Recording, tmp_path: Path) -> None:
    together = prove(street, tmp_path / "together", NAMES)
    for name in NAMES[::-1]:
        alone = prove(street, tmp_path / name, (name,))
        assert_same(together[name], alone[name])


def test_a_pair_is_registered_once_however_many_propose_it(
    street: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[bytes, bytes, bytes]] = []
    register = verification.register

    def count(source: Any, target: Any, guess: Any, **options: Any) -> Any:
        seen.append((source.points.tobytes(), target.points.tobytes(), guess.tobytes()))
        return register(source, target, guess, **options)

    monkeypatch.setattr(verification, "register", count)
    found = prove(street, tmp_path, NAMES)
    assert len(set(seen)) == len(seen)
    tried = sum(int((run.candidates >= 0).any(axis=1).sum()) for run in found.values())
    assert 0 < len(seen) < tried


def test_stored_loops_are_read_again_and_a_further_descriptor_leaves_them(
    street: Recording, tmp_path: Path
) -> None:
    prove(street, tmp_path, NAMES[:2])
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "verified").iterdir()}
    assert {path.name for path in files} == {"cloud-m2dp.npz", "cloud-m2dp-author.npz"}
    prove(street, tmp_path, NAMES)
    assert len(list((tmp_path / "verified").iterdir())) == len(NAMES)
    assert all(path.stat().st_mtime_ns == then for path, then in files.items())


def test_bench_judges_each_descriptor_with_and_without_verification(
    street: Recording, tmp_path: Path
) -> None:
    found = benchmark(street, tmp_path, NAMES, configs={"cloud": CONFIG}, verify="each")
    names = [evaluation.run.name for evaluation in found]
    assert names == [*NAMES, *(f"verified {name}" for name in NAMES)]
    assert len({tuple(evaluation.run.numbers) for evaluation in found}) == 1
    plain = benchmark(street, tmp_path, NAMES, configs={"cloud": CONFIG}, verify="none")
    assert [evaluation.run.name for evaluation in plain] == [*NAMES]


def test_only_the_known_ways_to_verify_are_taken(street: Recording, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        benchmark(street, tmp_path, verify="every")
    assert (caught.value.code, caught.value.fields) == ("choice", ("verify", "every"))
    assert not list(tmp_path.iterdir())
