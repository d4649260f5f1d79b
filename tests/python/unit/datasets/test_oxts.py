# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses from KITTI raw's GPS/IMU records against numbers by hand, and against the globe."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusionslam.datasets import open_dataset
from fusionslam.datasets.oxts import oxts_poses
from kitti import pose_lines, put_text
from public_data import oxts_line, raw_drive_with_oxts
from refusals import refuses
from rows import rows

LATITUDE, LONGITUDE = 49.0, 8.4
RADIUS_M = 6378137.0
FLATTENING = 1 / 298.257223563


def records(latitudes: object, longitudes: object) -> np.ndarray:
    rows = np.zeros((np.size(longitudes), 6))
    rows[:, 0], rows[:, 1], rows[:, 2] = latitudes, longitudes, 116
    return rows


def test_a_drive_along_a_parallel_is_as_long_as_on_the_sphere() -> None:
    longitudes = LONGITUDE + np.linspace(0, 0.0137, 11)  # a kilometre
    poses = oxts_poses(records(LATITUDE, longitudes))
    arcs = RADIUS_M * np.cos(np.radians(LATITUDE)) * np.radians(longitudes - LONGITUDE)
    assert 999 < arcs[-1] < 1001
    np.testing.assert_allclose(poses[:, 0, 3], arcs, atol=0.01)
    np.testing.assert_allclose(poses[:, 1:3, 3], 0, atol=1e-6)


def test_short_drives_are_right_on_the_ellipsoid_to_centimetres_and_long_ones_to_0_2_percent() -> (
    None
):
    """Radii of curvature of WGS 84: of the prime vertical, and of the meridian."""
    sine_2 = np.sin(np.radians(LATITUDE)) ** 2
    square = FLATTENING * (2 - FLATTENING)
    vertical = RADIUS_M / np.sqrt(1 - square * sine_2)
    meridian = vertical * (1 - square) / (1 - square * sine_2)
    for metres in (10.0, 1000.0):
        step = np.degrees(metres / vertical / np.cos(np.radians(LATITUDE)))
        east = oxts_poses(records(LATITUDE, [LONGITUDE, LONGITUDE + step]))[1, 0, 3]
        step = np.degrees(metres / meridian)
        north = oxts_poses(records([LATITUDE, LATITUDE + step], [LONGITUDE] * 2))[1, 1, 3]
        assert east == pytest.approx(metres * 0.99809, abs=0.002 * metres / 100)
        assert north == pytest.approx(metres * 1.00099, rel=1e-4)
        assert max(abs(east - metres), abs(north - metres)) < 0.002 * metres


def test_two_records_by_hand() -> None:
    """At the equator a thousandth of a degree is pi * 6378137 / 180000 m, here east and up."""
    rows = np.array([[0, 10, 5, 0, 0, np.pi / 2], [0, 10.001, 7, 0, 0, np.pi]])
    first, second = oxts_poses(rows)
    assert np.array_equal(first, np.eye(4))
    # The car faces north, so what is east of it is on its right; then it turns left, to the west.
    expected = [[0, -1, 0, 0], [1, 0, 0, -111.31949079327358], [0, 0, 1, 2], [0, 0, 0, 1]]
    np.testing.assert_allclose(second, expected, atol=1e-6)


def test_roll_pitch_and_yaw_turn_about_x_then_y_then_z() -> None:
    roll, pitch, yaw = 0.1, -0.2, 2.5
    rows = np.zeros((2, 6))
    rows[1, 3:] = roll, pitch, yaw
    x = [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    y = [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
    z = [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    turn = np.array(z) @ np.array(y) @ np.array(x)
    np.testing.assert_allclose(oxts_poses(rows)[1, :3, :3], turn, atol=1e-12)


def east(frame: int) -> str:
    """A record every ten thousandth of a degree of longitude, facing east."""
    return oxts_line(LATITUDE, LONGITUDE + 1e-4 * frame)


def test_a_raw_drive_has_the_poses_of_camera_0_as_kitti_odometry_has(tmp_path: Path) -> None:
    turned = Rotation.from_euler("z", 0.3).as_matrix()
    drive = raw_drive_with_oxts(tmp_path, {0: east(0), 1: east(1), 2: east(2)})
    text = " ".join(map(repr, (turned @ [[0, -1, 0], [0, 0, -1], [1, 0, 0]]).ravel().tolist()))
    put_text(tmp_path / "calib_velo_to_cam.txt", f"R: {text}\nT: 0 -0.1 -0.3\n")
    dataset = open_dataset(drive)
    assert (dataset.pose_frame, dataset.body_is_camera) == ("camera 0 (left grey)", True)
    assert dataset.poses_file == drive / "oxts/data"
    np.testing.assert_allclose(dataset.poses[0], np.eye(4), atol=1e-9)
    # In the world of the first scanner the car drives along what the IMU's x axis is there.
    scanners = np.linalg.inv(dataset.body_from_points) @ dataset.poses @ dataset.body_from_points
    metres = RADIUS_M * np.cos(np.radians(LATITUDE)) * np.radians(2e-4)
    np.testing.assert_allclose(scanners[2, :3, 3], [0, metres, 0], atol=1e-6)


def test_without_the_place_of_the_imu_the_poses_are_its_own(tmp_path: Path) -> None:
    drive = raw_drive_with_oxts(tmp_path, {n: east(n) for n in range(3)}, mounted=False)
    dataset = open_dataset(drive)
    assert (dataset.pose_frame, dataset.body_is_camera) == ("GPS/IMU", False)
    assert dataset.body_from_points is None
    metres = RADIUS_M * np.cos(np.radians(LATITUDE)) * np.radians(1e-4)
    np.testing.assert_allclose(dataset.poses[1, :3, 3], [metres, 0, 0], atol=1e-6)
    # The origin is the first record, whatever frames are there.
    for path in (next(drive.rglob("*0000000000.bin")), next(drive.rglob("*0000000000.png"))):
        path.unlink()
    np.testing.assert_allclose(open_dataset(drive).poses[0, 0, 3], metres, atol=1e-6)


def test_without_cameras_the_imu_is_placed_by_the_scanner(tmp_path: Path) -> None:
    drive = raw_drive_with_oxts(tmp_path, {n: east(n) for n in range(3)})
    (tmp_path / "calib_cam_to_cam.txt").unlink()
    dataset = open_dataset(drive)
    assert dataset.pose_frame == "GPS/IMU"
    imu = dataset.body_from_points @ [-0.8, 0.3, -0.8, 1]
    np.testing.assert_allclose(imu, [0, 0, 0, 1], atol=1e-12)


def test_a_given_file_of_poses_comes_before_the_gps(tmp_path: Path) -> None:
    drive = raw_drive_with_oxts(tmp_path, {n: "cut" for n in range(3)})
    put_text(tmp_path / "mine.txt", pose_lines(3, 7))
    assert open_dataset(drive, poses=tmp_path / "mine.txt").poses[2, 0, 3] == 14


def test_a_frame_without_a_record_has_no_pose(tmp_path: Path) -> None:
    drive = raw_drive_with_oxts(tmp_path, {0: east(0), 2: east(2)})
    assert open_dataset(drive).numbers.tolist() == [0, 2]
    kept = open_dataset(drive, without_pose="keep")
    assert np.isfinite(kept.poses).all(axis=(1, 2)).tolist() == [True, False, True]


def test_records_of_a_drive_that_is_not_synchronised_are_not_of_its_frames(tmp_path: Path) -> None:
    drive = raw_drive_with_oxts(tmp_path, {n: east(n) for n in range(3)})
    put_text(tmp_path / "calib_imu_to_velo.txt", "R: 1 0 0 0 2 0 0 0 1\nT: 0 0 0\n")
    with refuses("not-a-rotation"):
        open_dataset(drive)
    assert open_dataset(drive.rename(tmp_path / "2011_09_26_drive_0001_extract")).poses is None


@rows(
    "line, code, field",
    [
        (east(1)[:-9], "truncated", "26"),
        ("", "truncated", "0"),
        (east(1).replace("49", "91", 1), "damaged-file", "lat"),
        (east(1).replace("49", "nan", 1), "damaged-file", "lat"),
        (oxts_line(49, 200), "damaged-file", "lon"),
        (oxts_line(90, 8), "damaged-file", "lat"),
        (oxts_line(49, 8, float("inf")), "damaged-file", "alt"),
        (oxts_line(49, 8, 116, (0, 0, 0.5)).replace("0.5", "north"), "damaged-file", "yaw"),
    ],
)
def test_a_damaged_record_is_named_with_its_field(
    tmp_path: Path, line: str, code: str, field: str
) -> None:
    drive = raw_drive_with_oxts(tmp_path, {0: east(0), 1: line, 2: east(2)})
    with refuses(code, str(drive / "oxts/data/0000000001.txt"), field):
        open_dataset(drive)
