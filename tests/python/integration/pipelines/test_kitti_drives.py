# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's poses are of camera 0, z ahead and y down: the robot's path follows through Tr."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fusionslam.evaluation import judge_map
from fusionslam.fusion import FusionConfig
from fusionslam.geometry.se2 import wrapped
from fusionslam.geometry.trajectory import Trajectory, ground_poses
from fusionslam.pipelines.drives import open_drive
from fusionslam.pipelines.maps import run_ratslam
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.ratslam.view_sources import SourceOptions
from fusionslam.views.visual_templates import VisualTemplatesConfig
from kitti import ODOMETRY_CALIB, TR, put_image, put_text, raw_drive
from rows import rows

# Tr of the made drives: the camera is 0.1 m left of the scanner, 0.2 m above and 0.3 m behind.
CAMERA_FROM_ROBOT = np.array([*map(float, TR.split()), 0, 0, 0, 1]).reshape(4, 4)
AXES = np.diag([0.0, 0, 0, 1])
AXES[[0, 1, 2], [1, 2, 0]] = -1, -1, 1


def around_a_corner(frames: int = 24) -> NDArray[np.float64]:
    """float64 (n, 3): 12 m ahead, then 11 m to the left, a metre per frame."""
    x, y = np.minimum(np.arange(frames), 12.0), np.maximum(np.arange(frames) - 12.0, 0)
    return np.stack([x, y, np.where(y > 0, np.pi / 2, 0.0)], axis=1)


def write_drive(
    root: Path, places: NDArray[np.float64], camera_from_robot: NDArray[np.float64], calib: str
) -> Path:
    """A sequence with images; its poses are of the camera, relative to the first."""
    sequence = root / "sequences" / "03"
    for number, place in enumerate(places):
        grey = int(10 * abs(place[0] - place[1]))
        put_image(sequence / f"image_2/{number:06d}.png", (64, 48), (grey, grey, 255 - grey))
    put_text(sequence / "calib.txt", calib)
    put_text(sequence / "times.txt", "".join(f"{0.517 * n:e}\n" for n in range(len(places))))
    cameras = ground_poses(*places.T) @ np.linalg.inv(camera_from_robot)
    put_poses(root / "poses" / "03.txt", np.linalg.inv(cameras[0]) @ cameras)
    return sequence


def put_poses(path: Path, poses: NDArray[np.float64]) -> None:
    rows = poses[:, :3].reshape(-1, 12).tolist()
    put_text(path, "".join(" ".join(map(repr, row)) + "\n" for row in rows))


def relative(truth: Trajectory) -> NDArray[np.float64]:
    """float64 (n, 3): the trajectory in the frame of its first pose."""
    poses = ground_poses(truth.x, truth.y, truth.yaw)
    poses = np.linalg.inv(poses[0]) @ poses
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    return np.stack([poses[:, 0, 3], poses[:, 1, 3], wrapped(yaw)], axis=1)


@rows("with_tr", [True, False])
def test_the_truth_is_the_path_of_the_robot_in_the_plane(tmp_path: Path, with_tr: bool) -> None:
    # Without Tr the robot is where the camera is, with a robot's axes.
    camera_from_robot = CAMERA_FROM_ROBOT if with_tr else AXES
    calib = ODOMETRY_CALIB if with_tr else ODOMETRY_CALIB.partition("Tr:")[0]
    places = around_a_corner()
    drive = open_drive(write_drive(tmp_path, places, camera_from_robot, calib))
    assert drive.truth is not None
    np.testing.assert_allclose(relative(drive.truth), places, atol=1e-9)


def test_the_truth_of_a_raw_drive_with_given_poses_is_the_path_of_the_robot(tmp_path: Path) -> None:
    places = around_a_corner(3)
    root = raw_drive(tmp_path)
    turn = " ".join(map(str, AXES[:3, :3].ravel()))
    put_text(tmp_path / "calib_velo_to_cam.txt", f"R: {turn}\nT: 0 0 0\n")
    stamps = "".join(f"2011-09-26 13:02:25.{n}00000000\n" for n in range(3))
    put_text(root / "velodyne_points/timestamps.txt", stamps)
    put_poses(tmp_path / "poses.txt", ground_poses(*places.T) @ np.linalg.inv(AXES))
    recording = Recording.at(root, poses=tmp_path / "poses.txt")
    truth = open_drive(recording).truth
    assert truth is not None
    np.testing.assert_allclose(relative(truth), places, atol=1e-9)


def test_odometry_that_is_the_truth_has_no_error(tmp_path: Path) -> None:
    source = write_drive(tmp_path, around_a_corner(), CAMERA_FROM_ROBOT, ODOMETRY_CALIB)
    templates = VisualTemplatesConfig(columns=16, rows=8, bottom=None)
    options = SourceOptions(templates=templates)
    report = judge_map(run_ratslam(source, "visual_templates", "truth", options=options))
    assert report.dead_reckoning is not None
    assert report.dead_reckoning.max_m == pytest.approx(0, abs=1e-6)
    assert report.dead_reckoning.rmse_m == pytest.approx(0, abs=1e-6)


def test_recorded_scenes_and_the_drive_agree_on_the_truth(kitti: Path) -> None:
    data = Recording.at(kitti).open()
    scenes = record_scenes(data, fusion=FusionConfig(frame="scan", ground="none"))
    truth = open_drive(kitti).truth
    assert truth is not None and scenes.poses is not None
    np.testing.assert_allclose(scenes.poses[:, :2], np.stack([truth.x, truth.y], axis=1), atol=1e-9)


@pytest.mark.slow
@rows(
    "sequence, calibration, extent",
    [("00", "calib_00-02.txt", (564, 496)), ("06", "calib_04-12.txt", (23, 457))],
)
def test_kitti_extends_over_the_ground(
    test_data: Path, tmp_path: Path, sequence: str, calibration: str, extent: tuple[int, int]
) -> None:
    source = tmp_path / "sequences" / sequence
    poses = (test_data / f"kitti/poses/{sequence}.txt").read_text()
    put_text(tmp_path / "poses" / f"{sequence}.txt", poses)
    put_text(source / "calib.txt", (test_data / "kitti/calib" / calibration).read_text())
    times = (test_data / f"kitti/times/times_{sequence}.txt").read_text()
    put_text(source / "times.txt", times)
    (source / "velodyne").mkdir()
    for number in range(len(poses.splitlines())):
        (source / f"velodyne/{number:06d}.bin").touch()
    truth = open_drive(source).truth
    assert truth is not None
    assert (np.ptp(truth.x), np.ptp(truth.y)) == pytest.approx(extent, abs=0.5)
