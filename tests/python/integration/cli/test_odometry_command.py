# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command odometry: files of poses that other commands read, or the reason for none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from artefacts import artefact, copy_artefact
from cli import error_of, interrupted_at, run, succeeds
from fusionslam import datasets
from fusionslam.base.arrays import Matrix
from fusionslam.evaluation import RatSlamRun
from fusionslam.pipelines.lidar_odometry import LidarTrack, track_lidar
from refusals import refuses

pytest.importorskip("kiss_icp", reason="the library of odometry by LiDAR is an extra")

STEP_M = 0.05
COUNT = 12


@pytest.fixture
def corridor(tmp_path: Path) -> Path:
    return copy_artefact(artefact("cli-corridor", write_corridor), tmp_path / "corridor")


def write_corridor(folder: Path) -> None:
    """A plain folder of scans, 0.05 m apart along x, and where the scanner is on the robot."""
    rng = np.random.default_rng(8)
    (folder / "clouds").mkdir()
    walls = rng.uniform((-6, -2, -0.5), (8, 2, 2), (6000, 3))
    rows = np.arange(len(walls))
    axis = rng.choice([0, 1, 1, 2], len(walls))
    sides = np.array([[-6, 8], [-2, 2], [-0.5, 2]])
    walls[rows, axis] = sides[axis, rng.integers(0, 2, len(walls))]
    pillars = rng.normal((3, 1, 0.5), (0.05, 0.05, 0.5), (800, 3))
    for k in range(COUNT):
        cloud = np.vstack([walls, pillars]) - [STEP_M * k, 0, 0]
        cloud += rng.normal(0, 0.005, cloud.shape)
        rows_of_file = np.column_stack([cloud, np.zeros(len(cloud))]).astype("<f4")
        rows_of_file.tofile(folder / "clouds" / f"{k:06d}.bin")
    (folder / "times.txt").write_text("".join(f"{100 + k / 10:.1f}\n" for k in range(COUNT)))
    robot_from_points = [1, 0, 0, 0.3, 0, 1, 0, 0, 0, 0, 1, 0.5, 0, 0, 0, 1]
    (folder / "calib.yaml").write_text(f"robot_from_points: {robot_from_points}\n")


def truth() -> Matrix:
    poses = np.tile(np.eye(4), (COUNT, 1, 1))
    poses[:, 0, 3] = STEP_M * np.arange(COUNT)
    return poses


def test_poses_by_time_are_the_odometry_of_a_folder(corridor: Path, tmp_path: Path) -> None:
    path = corridor / "odometry.txt"
    result = succeeds("odometry", corridor, "-o", path)
    assert str(path) in result.stdout and "without times" in result.stdout
    stamps_ns, poses = datasets.read_poses_tum(path)
    dataset = datasets.open_dataset(corridor)
    assert stamps_ns.tolist() == dataset.stamps_ns.tolist()
    np.testing.assert_allclose(poses, truth(), atol=0.02)
    assert dataset.poses is None and len(dataset.motion("odometry")) == COUNT
    succeeds("ratslam", corridor, "--views", "m2dp", "--no-report", "-o", tmp_path / "map")
    assert error_of(1, "odometry", corridor, "-o", path).code == "exists"


def test_poses_by_frame_have_the_format_of_kitti(corridor: Path, tmp_path: Path) -> None:
    for name, options in (("a.kitti", ()), ("b_kitti.txt", ()), ("c.txt", ("--format", "kitti"))):
        succeeds("odometry", corridor, "-o", tmp_path / name, *options)
        stamps, poses = datasets.read_poses(tmp_path / name)
        assert stamps is None
        np.testing.assert_allclose(poses, truth(), atol=0.02)
    assert run("odometry", corridor, "--format", "g2o").exit_code == 2


def test_drift_is_printed_where_the_truth_is_known(corridor: Path, tmp_path: Path) -> None:
    dataset = datasets.open_dataset(corridor)
    datasets.write_poses_tum(tmp_path / "truth.txt", dataset.stamps_ns, truth())
    words = ("odometry", corridor, "-o", tmp_path / "o.txt", "--gt", tmp_path / "truth.txt")
    result = succeeds(*words)
    assert len(result.stdout.splitlines()) == 2


def test_a_map_is_made_of_scans_alone(corridor: Path, tmp_path: Path) -> None:
    words = ("ratslam", corridor, "--views", "m2dp", "--odometry", "lidar", "--no-report")
    succeeds(*words, "-o", tmp_path / "map")
    built = RatSlamRun.load(tmp_path / "map/run.npz")
    way = np.ptp(built.dead_reckoning[:, 0])
    assert way == pytest.approx(STEP_M * (COUNT - 1), abs=0.03)


def test_a_refused_pose_names_its_frame_and_leaves_no_file(corridor: Path, tmp_path: Path) -> None:
    (corridor / "times.txt").write_text("".join(f"{k}\n" for k in range(COUNT)))
    words = ("odometry", corridor, "-o", tmp_path / "o.txt")
    error = error_of(1, *words, "--set", "lidar_odometry.max_step=0.03")
    assert error.code == "far-apart" and "frame 1 " in str(error)
    assert not (tmp_path / "o.txt").exists()
    assert error_of(2, *words, "--set", "lidar_odometry.max_stepp=1").code == "unknown-key"


def test_scans_that_cannot_be_used_are_named_or_left_out(corridor: Path, tmp_path: Path) -> None:
    bad = corridor / "clouds/000004.bin"
    for content, code in ((b"12345", None), (np.ones(40, "<f4").tobytes(), "few-points")):
        bad.write_bytes(content)
        error = error_of(1, "odometry", corridor, "-o", tmp_path / "o.txt")
        assert "000004" in str(error) and code in (None, error.code)
    bad.write_bytes(b"12345")
    succeeds("odometry", corridor, "-o", tmp_path / "o.txt", "--skip-bad-frames")
    stamps_ns, poses = datasets.read_poses_tum(tmp_path / "o.txt")
    assert len(stamps_ns) == COUNT - 1
    np.testing.assert_allclose(poses, np.delete(truth(), 4, axis=0), atol=0.02)
    # Line n of a KITTI file is frame n: there is none for the one left out.
    words = ("odometry", corridor, "-o", tmp_path / "o.kitti", "--skip-bad-frames")
    assert error_of(1, *words).code == "no-pose"


def test_the_poses_are_those_of_the_body(corridor: Path) -> None:
    dataset = datasets.open_dataset(corridor)
    turned = np.array([[0.0, -1, 0, 2], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    of_camera = track_lidar(replace(dataset, body_from_points=turned))
    np.testing.assert_allclose(of_camera.poses[-1][:3, 3], [0, 0, 0.55], atol=0.02)
    assert isinstance(of_camera, LidarTrack) and 0.5 < of_camera.length_m < 0.6
    with refuses("no-scans"):  # one scan has no motion
        track_lidar(dataset[:1])


def test_ctrl_c_says_that_nothing_was_written(
    corridor: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.odometry.LidarOdometry.process", interrupted_at(0))
    result = run("odometry", corridor, "-o", tmp_path / "o.txt")
    assert result.exit_code == 130 and not (tmp_path / "o.txt").exists()
