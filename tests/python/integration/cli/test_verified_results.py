# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Commands on folders of results that hold verified loops beside descriptors."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import NO_WINDOW, error_of, interrupted_at, run, succeeds
from descriptor_runs import descriptor_run
from fusionslam.evaluation import VerifiedRun
from fusionslam.loop_closure import LoopDetector
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work, forget_demo, verified_path
from fusionslam.registration import RegistrationConfig
from verified import verified_run

BY_POSE = ("--set", "evaluation.protocol=pose-2m-5deg")
UNVERIFIED = ("--set", "loop_closure.verify=false")


@pytest.fixture
def results(tmp_path: Path) -> Path:
    verified = verified_run()
    verified_path(tmp_path, "lidar", "cm2dp").parent.mkdir()
    verified.save(verified_path(tmp_path, "lidar", "cm2dp"))
    (tmp_path / "descriptors").mkdir()
    same = ("dataset", "frames", "numbers", "stamps_ns", "poses", "points", "config")
    descriptors = np.random.default_rng(0).normal(size=(len(verified), 3))
    run_of = descriptor_run(descriptors, **{name: getattr(verified, name) for name in same})
    run_of.save(tmp_path / "descriptors" / "lidar-m2dp.npz")
    configs = {"lidar": {"evaluation": {"window": 0}}}
    Work(Recording(str(tmp_path / "gone")), verified.dataset, configs=configs).save(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_verified_loops_are_a_row_of_the_table_and_in_the_report(results: Path) -> None:
    printed = succeeds("eval", results, *BY_POSE).stdout
    assert max(map(len, printed.split("protocol")[0].splitlines())) <= 80
    assert "protocol pose-2m-5deg" in printed
    row = next(line for line in printed.splitlines() if "verified" in line)
    assert row.split()[1:4] == ["0.500", "0.200", "0.774"]  # R@100P, threshold, max F1
    figures = json.loads((results / "metrics.json").read_text())
    assert "3 loops accepted, 0 of them wrong" in printed
    assert "candidates of m2dp+scan_context" in printed
    assert [run["verified"] for run in figures["runs"]] == [False, True]
    printed = succeeds("info", verified_path(results, "lidar", "cm2dp")).stdout
    assert "verified loops" in printed and "frames" in printed
    assert "3 loops in 9 frames" in succeeds("info", results).stdout
    succeeds("report", results, "-o", results / "page")
    assert "verified m2dp+scan_context" in (results / "page" / "report.html").read_text()


def test_verified_loops_are_judged_by_other_poses_of_the_same_body(results: Path) -> None:
    poses = verified_run().poses
    assert poses is not None
    moved = poses.copy()
    moved[4, 0, 3] += 5  # as if the fifth frame were not where it was
    for name, right, rows in (("poses.txt", 4, poses), ("moved.txt", 3, moved)):
        every = np.repeat(rows[:, :3], 10, axis=0)  # the frames' numbers are 0, 10, 20, ...
        np.savetxt(results / name, every.reshape(-1, 12))
        folder = results / name.replace(".txt", "")
        for part in ("descriptors", "verified"):
            shutil.copytree(results / part, folder / part)
        settings = ("--window", 0, "--gt", results / name, *BY_POSE)
        succeeds("eval", folder, *settings)
        runs = json.loads((folder / "metrics.json").read_text())["runs"]
        assert runs[1]["protocols"]["pose-2m-5deg"]["n_correct"] == right


def test_a_protocol_by_pose_needs_verified_loops_at_once(results: Path, kitti: Path) -> None:
    verified_path(results, "lidar", "cm2dp").unlink()
    for words in (
        ("eval", results, *BY_POSE),
        ("bench", kitti, "-d", "m2dp", "-o", results / "bench", *UNVERIFIED, *BY_POSE),
    ):
        error = error_of(2, *words)
        assert (error.code, error.fields[0]) == ("needs-poses", "evaluation.protocol")
    assert not list((results / "bench").glob("descriptors/*"))


def test_verified_loops_alone_are_no_pairs_to_judge(results: Path) -> None:
    shutil.rmtree(results / "descriptors")
    error = error_of(2, "eval", results, "--window", 0, "--protocol", "ssc")
    assert (error.code, error.fields) == ("needs-descriptors", ("evaluation.protocol", "ssc"))


def test_the_demo_replaces_its_verified_loops(tmp_path: Path) -> None:
    for source, dataset in (("lidar", "simulated drive"), ("stereo", "another drive")):
        path = verified_path(tmp_path, source, "cm2dp")
        path.parent.mkdir(exist_ok=True)
        verified_run(dataset=dataset).save(path)
    configs: dict[str, dict[str, Any]] = {"lidar": {}, "stereo": {}}
    old = Work(Recording("/drives/one"), "simulated drive", configs=configs, demo=True)
    old.save(tmp_path)
    forget_demo(tmp_path, Recording("/drives/two"))
    assert [path.name for path in (tmp_path / "verified").iterdir()] == ["stereo-cm2dp.npz"]


def test_without_the_extra_loops_are_those_of_descriptors_and_it_is_said_once(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.loop_closure.observation.find_spec", lambda name: None)
    free = ("--set", "registration.gravity=false")
    words = ("loops", kitti, "-d", "m2dp,cm2dp", "-o", tmp_path, *NO_WINDOW, *free)
    result = succeeds(*words)
    said = " ".join(result.stderr.split())
    assert said.count("fusionslam[map]") == 1 and " queries: " in result.stdout
    assert (tmp_path / "descriptors/lidar-cm2dp.npz").exists()
    assert not (tmp_path / "verified").exists() and not list(tmp_path.glob("*.g2o"))
    text = (tmp_path / "loops-cm2dp.csv").read_text()
    assert text.startswith("query,match,distance,query_stamp_ns,match_stamp_ns\n")
    chosen = succeeds(*words, *UNVERIFIED)
    assert "fusionslam[map]" not in chosen.stderr and chosen.stdout == result.stdout
    assert error_of(1, *words, "--set", "loop_closure.verify=true").code == "missing-extra"


@pytest.mark.slow
def test_an_interrupted_proof_keeps_finished_descriptors_and_starts_the_others_again(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("loops", kitti, "-d", "m2dp,scan_context", "-o", tmp_path, *NO_WINDOW)
    stopped = interrupted_at(24, LoopDetector.add_observation)
    with monkeypatch.context() as patch:
        patch.setattr(LoopDetector, "add_observation", stopped)
        result = run(*words)
    assert result.exit_code == 130 and "starts the rest again" in result.stderr
    finished = tmp_path / "verified/lidar-m2dp.npz"
    assert [path.name for path in (tmp_path / "verified").iterdir()] == [finished.name]
    before = finished.stat().st_mtime_ns
    succeeds(*words)
    assert finished.stat().st_mtime_ns == before
    assert len(list((tmp_path / "verified").iterdir())) == 2


def test_the_window_of_the_evaluation_holds_for_proven_loops(kitti: Path, tmp_path: Path) -> None:
    windows = ("--set", "loop_closure.window=2", "--set", "evaluation.window=7")
    lidar = ("--source", "lidar", "--no-report")
    succeeds("bench", kitti, "-d", "m2dp", "-o", tmp_path, *windows, *lidar)
    proven = VerifiedRun.load(verified_path(tmp_path, "lidar", "m2dp"))
    rows, columns = np.nonzero(proven.candidates >= 0)
    assert (rows - proven.candidates[rows, columns]).min() == 8
    # A run that proves nothing deletes the poses of former loops.
    (tmp_path / "loops.g2o").write_text("EDGE_SE3:QUAT 0 9\n")
    succeeds("loops", kitti, "-d", "m2dp", "-o", tmp_path, "--threshold", "0.2", *NO_WINDOW)
    assert sorted(path.name for path in tmp_path.glob("loops.*")) == ["loops.csv"]


@pytest.mark.slow
def test_proven_loops_are_reused_if_their_lengths_are_fitted_again_or_given_alike(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.registration.scale.ROOM_REACH", np.inf)  # fits what is no room
    voxel = RegistrationConfig().voxel
    given = ("--set", f"registration.voxel={voxel}")
    path, times = verified_path(tmp_path, "lidar", "m2dp"), []
    for words in ((), (), given, given, ()):
        succeeds("loops", kitti, "-d", "m2dp", "-o", tmp_path, *NO_WINDOW, *words)
        times.append(path.stat().st_mtime_ns)
        used = VerifiedRun.load(path).config["registration"]["voxel"]
        assert (used == voxel) == (words == given)
    assert times[0] == times[1] < times[2] == times[3] < times[4]
