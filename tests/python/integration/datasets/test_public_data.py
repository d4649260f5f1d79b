# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The readers of SemanticKITTI, KITTI-360, MulRan, NCLT and GPS of KITTI raw, of made folders."""

import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cli import info_of
from fusionslam.datasets import open_dataset
from fusionslam.datasets.kitti_raw import oxts_poses
from fusionslam.datasets.pose_files import read_poses_kitti
from fusionslam.datasets.streams import MissingSensorError
from fusionslam.errors import DataError
from kitti import POINTS, pose_lines, put_text
from public_data import (
    KITTI_360_DRIVE,
    MULRAN_STAMP,
    NCLT_STAMP,
    NCLT_STEPS,
    PERSPECTIVE,
    kitti_360,
    matrix_row,
    mulran,
    nclt,
    oxts_line,
    raw_drive_with_oxts,
    semantic_kitti,
)
from refusals import refuses
from rows import rows

Make = Callable[[Path], Path]
Logs = pytest.LogCaptureFixture


def test_labels_beside_scans_are_no_trouble_and_poses_there_come_first(tmp_path: Path) -> None:
    sequence = semantic_kitti(tmp_path)
    dataset = open_dataset(tmp_path / "dataset", sequence="3")
    assert (dataset.kind, dataset.name) == ("kitti-odometry", "SemanticKITTI 03")
    assert dataset.sensors == ("points",) and np.array_equal(dataset[1].points, POINTS)
    assert dataset.poses_file == sequence / "poses.txt" and dataset.poses[2, 0, 3] == 4
    assert dataset.body_is_camera and dataset.body_from_points is not None
    chosen = open_dataset(sequence, poses=tmp_path / "dataset/poses/03.txt")
    assert chosen.poses[2, 0, 3] == 2
    assert "03/poses.txt" in info_of(sequence)
    (sequence / "poses.txt").unlink()
    kitti = open_dataset(sequence)
    assert kitti.name == "KITTI odometry 03" and kitti.poses[2, 0, 3] == 2


@rows(
    "place",
    [".", "data_3d_raw", f"data_3d_raw/{KITTI_360_DRIVE}", f"data_2d_raw/{KITTI_360_DRIVE}"],
)
def test_a_drive_is_opened_from_any_of_its_folders(tmp_path: Path, place: str) -> None:
    dataset = open_dataset(kitti_360(tmp_path) / place)
    assert (dataset.kind, dataset.name) == ("kitti-360", f"KITTI-360 {KITTI_360_DRIVE}")
    assert dataset.sensors == ("points", "left", "right") and dataset.recorded == 6
    assert dataset.numbers.tolist() == [1, 2, 4]
    exact = np.datetime64("2013-05-28T08:46:02.904481000", "ns").astype(np.int64)
    assert dataset.stamps_ns[0] == exact


def test_a_drive_is_chosen_by_its_name_or_number(tmp_path: Path) -> None:
    kitti_360(tmp_path)
    other = KITTI_360_DRIVE.replace("0003", "0010")
    for raw in ("data_3d_raw", "data_2d_raw"):
        (tmp_path / raw / other).mkdir()
    for name in ("3", "0003", KITTI_360_DRIVE):
        assert open_dataset(tmp_path, sequence=name).root.name == KITTI_360_DRIVE
    with refuses("no-sequence", KITTI_360_DRIVE, other):
        open_dataset(tmp_path)
    with refuses("no-frames"):
        open_dataset(tmp_path, sequence=10)


def test_frames_without_a_pose_may_be_left_out(tmp_path: Path, caplog: Logs) -> None:
    kept = open_dataset(kitti_360(tmp_path), without_pose="keep")
    known = np.isfinite(kept.poses).all(axis=(1, 2))
    assert known.tolist() == [False, True, True, False, True, False]
    assert np.isnan(kept[0].pose).all() and np.isfinite(kept[1].pose).all()
    put_text(tmp_path / "mine.txt", pose_lines(6, 3))
    dataset = open_dataset(tmp_path, poses=tmp_path / "mine.txt")
    assert np.array_equal(dataset.poses, read_poses_kitti(tmp_path / "mine.txt"))
    caplog.clear()
    dataset = open_dataset(tmp_path)
    assert len(dataset) == 3
    assert any(record.args[1:] == (3, 6) for record in caplog.records if record.args)
    # The fisheyes are counted and not read.
    assert "image_02" not in dataset.sensors and "6 of image_02" in caplog.text
    caplog.clear()
    open_dataset(tmp_path, sensors=["points"], without_pose="keep")
    assert not caplog.records


def test_images_are_named_and_points_project_into_both(tmp_path: Path) -> None:
    """By hand: a point 10 m ahead of camera 0, 1 m to its right and 0.5 m below."""
    frame = open_dataset(kitti_360(tmp_path))[0]
    assert frame.images["left"][0, 0].tolist() == [200, 0, 0]
    assert frame.images["right"][0, 0].tolist() == [0, 200, 0]
    point = np.array([10 + 0.8, 0.3 - 1, -0.2 - 0.5, 1])
    for name, column in (("left", 2 + 5 * 1 / 10), ("right", 2 + (5 * 1 - 3) / 10)):
        camera = frame.cameras[name]
        pixel = camera.projection_from_points @ point
        np.testing.assert_allclose(pixel / pixel[2], [column, 1.5 + 5 * 0.5 / 10, 1])
        assert camera.size == (4, 3)


def test_poses_are_of_the_imu_turned_upright_and_place_the_scanner(tmp_path: Path) -> None:
    """The car faces east in a world of east, north, up; the scanner is above the IMU."""
    dataset = open_dataset(kitti_360(tmp_path))
    assert dataset.numbers[2] == 4 and not dataset.body_is_camera
    text = info_of(tmp_path)
    assert "kitti-360" in text and f"{KITTI_360_DRIVE}/poses.txt" in text
    expected = np.eye(4)
    expected[:3, 3] = 1004, 2000, 116
    np.testing.assert_allclose(dataset.poses[2], expected, atol=1e-12)
    # By hand: camera 0 is (1.6, 0.1, -0.7) ahead, right and down of the IMU, the scanner 0.8 m
    # behind the camera, 0.3 m to its right and 0.2 m above it.
    np.testing.assert_allclose(dataset.body_from_points[:3, 3], [0.8, -0.4, 0.9], atol=1e-12)
    np.testing.assert_allclose(dataset.body_from_points[:3, :3], np.eye(3), atol=1e-12)


@rows("name", ["perspective.txt", "calib_cam_to_velo.txt"])
def test_without_calibration_the_scans_are_there_and_the_log_names_the_file(
    tmp_path: Path, caplog: Logs, name: str
) -> None:
    (kitti_360(tmp_path) / "calibration" / name).unlink()
    dataset = open_dataset(tmp_path)
    assert dataset.cameras == {} and len(dataset[0].points) == 20
    assert name in caplog.text


def test_what_a_drive_lacks_it_does_without(tmp_path: Path, caplog: Logs) -> None:
    placed = kitti_360(tmp_path / "placed")
    (placed / "calibration/calib_cam_to_pose.txt").unlink()
    dataset = open_dataset(placed)
    assert dataset.body_from_points is None and set(dataset.cameras) == {"left", "right"}
    (placed / "data_poses" / KITTI_360_DRIVE / "poses.txt").unlink()
    dataset = open_dataset(placed)
    assert dataset.poses is None and len(dataset) == 6
    caplog.clear()
    dataset = open_dataset(kitti_360(tmp_path, posed=(17,)))  # of none of its frames
    assert dataset.poses is None and len(dataset) == 6
    assert any(record.args[1:] == (6,) for record in caplog.records if record.args)
    shutil.rmtree(tmp_path / "data_3d_raw")
    dataset = open_dataset(tmp_path)
    assert dataset.sensors == ("left", "right") and len(dataset) == 6
    assert dataset.root.parent.name == "data_2d_raw"


GOOD = "1 1 0 0 5 0 -1 0 7 0 0 -1 9\n"


@rows(
    "text, code, line",
    [
        (GOOD + "2 1 0 0 5 0 1 0", "damaged-file", "2"),
        ("# drive\n\n" + GOOD + "2 1 0 0 five 0 -1 0 7 0 0 -1 9\n", "damaged-file", "4"),
        (GOOD.replace("1", "1.5", 1), "damaged-file", "1"),
        (GOOD.replace("5", "nan"), "not-finite", "1"),
        (GOOD + GOOD.replace("-1", "1", 1).replace("1", "2", 1), "not-a-rotation", "2"),
        (GOOD + GOOD, "two-poses", "2"),
        ("\n", "too-short", "1"),
    ],
)
def test_damaged_poses_are_named_by_line(tmp_path: Path, text: str, code: str, line: str) -> None:
    path = kitti_360(tmp_path) / "data_poses" / KITTI_360_DRIVE / "poses.txt"
    put_text(path, text)
    with refuses(code, str(path), line):
        open_dataset(tmp_path)


def test_damaged_calibrations_are_named(tmp_path: Path) -> None:
    folder = kitti_360(tmp_path) / "calibration"
    put_text(folder / "perspective.txt", PERSPECTIVE.replace("P_rect_01", "P_01"))
    with refuses("calibration-key", str(folder / "perspective.txt"), "P_rect_01"):
        open_dataset(tmp_path)
    put_text(folder / "perspective.txt", PERSPECTIVE)
    put_text(folder / "calib_cam_to_pose.txt", "image_00: 1 0 0 0 0 1 0 0 0 0 3 0\n")
    with refuses("not-a-rotation"):
        open_dataset(tmp_path)
    put_text(folder / "calib_cam_to_velo.txt", "1 0 0 0 0 1\n")
    with pytest.raises(ValueError, match=r"calib_cam_to_velo\.txt"):
        open_dataset(tmp_path)


def test_a_missing_scan_is_a_gap_and_stamps_that_end_early_are_refused(tmp_path: Path) -> None:
    scans = kitti_360(tmp_path) / "data_3d_raw" / KITTI_360_DRIVE / "velodyne_points"
    (scans / "data/0000000002.bin").unlink()
    with pytest.raises(ValueError, match=r"0000000002\.bin"):
        open_dataset(tmp_path)
    assert open_dataset(tmp_path, gaps="skip").numbers.tolist() == [1, 4]
    path = scans / "timestamps.txt"
    put_text(path, "".join(path.read_text().splitlines(keepends=True)[:3]))
    with refuses("too-short", str(path), "6"):
        open_dataset(tmp_path, gaps="skip")


def test_mulran_poses_are_interpolated_within_the_recorded_span_only(tmp_path: Path) -> None:
    """Poses run from 0.05 s to 0.25 s after the first scan: scans 1 and 2 are within."""
    sequence = mulran(tmp_path)
    kept = open_dataset(sequence, without_pose="keep")
    assert (kept.kind, kept.name, len(kept)) == ("mulran", "MulRan KAIST01", 4)
    assert kept.stamps_ns.tolist() == [MULRAN_STAMP + frame * 100_000_000 for frame in range(4)]
    assert np.array_equal(kept[3].points, POINTS) and kept.recorded == 4
    assert np.isfinite(kept.poses).all(axis=(1, 2)).tolist() == [False, True, True, False]
    np.testing.assert_allclose(kept.poses[1:3, 0, 3], [353_001, 353_002], atol=1e-9)
    dataset = open_dataset(sequence)
    assert dataset.numbers.tolist() == [1, 2]
    # As published, the scanner faces backwards: 1.7042 m ahead, -0.021 m left, 1.8047 m up.
    ahead = dataset.body_from_points @ [1, 0, 0, 1]
    np.testing.assert_allclose(ahead, [0.7042, -0.021 + 0.00584, 1.8047, 1], atol=1e-4)
    np.testing.assert_allclose(dataset.body_from_robot, np.eye(4), atol=1e-12)


def test_mulran_poses_between_two_rows_turn_half_way(tmp_path: Path) -> None:
    sequence, lines = mulran(tmp_path), ""
    for seconds, yaw in ((0.05, 0.2), (0.15, 0.6), (0.35, 0.6)):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
        pose[:3, 3] = 10 * seconds, 0, 0
        lines += matrix_row(MULRAN_STAMP + int(seconds * 1e9), pose)
    put_text(sequence / "global_pose.csv", lines)
    first, second, third = open_dataset(sequence).poses
    np.testing.assert_allclose(first[:3, :3], Rotation.from_euler("z", 0.4).as_matrix(), atol=1e-9)
    np.testing.assert_allclose([first[0, 3], second[0, 3], third[0, 3]], [1, 2, 3], atol=1e-6)


@rows("gap_s, known", [(0.5, 4), (0.6, 2)])
def test_no_pose_is_interpolated_across_a_long_gap(
    tmp_path: Path, gap_s: float, known: int
) -> None:
    """Poses before and after the gap, which begins just after the second scan."""
    sequence = mulran(tmp_path)
    begins = MULRAN_STAMP + 110_000_000
    stamps = [MULRAN_STAMP - 1000, begins, begins + round(gap_s * 1e9)]
    put_text(sequence / "global_pose.csv", "".join(matrix_row(at, np.eye(4)) for at in stamps))
    assert len(open_dataset(sequence)) == known


def test_sequences_are_chosen_by_name_and_may_lack_the_folder_sensor_data(tmp_path: Path) -> None:
    sequence = mulran(tmp_path)
    (sequence / "sensor_data/Ouster").rename(sequence / "Ouster")
    assert open_dataset(sequence).kind == "mulran"
    mulran(tmp_path, name="DCC02")
    with refuses("no-sequence", "DCC02", "KAIST01"):
        open_dataset(tmp_path)
    assert open_dataset(tmp_path, sequence="DCC02").root == tmp_path / "DCC02"


def test_nclt_coordinates_by_hand_are_turned_so_that_z_is_up(tmp_path: Path) -> None:
    """20200, 20000, 20600 are 1 m ahead, 0 m right, 3 m down: 1 m ahead, 3 m below."""
    dataset = open_dataset(nclt(tmp_path))
    assert (dataset.kind, dataset.name, len(dataset)) == ("nclt", "NCLT 2012-01-08", 3)
    assert dataset.stamps_ns.tolist() == [(NCLT_STAMP + 200_000 * n) * 1000 for n in range(3)]
    expected = [[1, 0, -3], [-100, -227.675, 0], [50, 5, 0.005]]
    points = dataset[0].points
    assert points.dtype == np.float32 and points.flags.c_contiguous
    np.testing.assert_allclose(points, expected, atol=1e-5)


def test_a_point_of_nclt_is_in_the_world_where_the_files_say(tmp_path: Path) -> None:
    """The pose by the files' own convention, in a world with z down, against the turned one."""
    dataset = open_dataset(nclt(tmp_path))
    file_points = NCLT_STEPS * 0.005 - 100.0
    turn = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix()  # fixed axes: Rz Ry Rx
    down = file_points @ turn.T + [4.0, 2.0, -3.0]
    pose = dataset.poses[2] @ dataset.body_from_points
    up = dataset[2].points @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose(up, down * [1, -1, -1], atol=1e-4)


def test_rows_of_nan_are_no_poses_but_may_be_bridged(tmp_path: Path) -> None:
    date = nclt(tmp_path)
    path = date / "groundtruth_2012-01-08.csv"
    lines = path.read_text().splitlines(keepends=True)
    # Scan 1 is at row 2: without rows 1 and 2 its pose is half way between rows 0 and 3.
    put_text(path, "".join([lines[0], *lines[3:]]))
    assert open_dataset(date).poses[1, 0, 3] == pytest.approx(2)
    put_text(path, "".join(line.split(",")[0] + ",nan" * 6 + "\n" for line in lines))
    with refuses("no-pose", str(path)):
        open_dataset(date)


@rows("place", ["..", "../ground_truth", "ground_truth"])
def test_nclt_poses_are_found_where_their_archives_put_them(tmp_path: Path, place: str) -> None:
    date = nclt(tmp_path)
    folder = date / place
    folder.mkdir(exist_ok=True)
    name = "groundtruth_2012-01-08.csv"
    (date / name).rename(folder / name)
    assert len(open_dataset(tmp_path).poses) == 3


def test_frames_have_intensities_in_the_scanners_own_unit(tmp_path: Path) -> None:
    intensities = open_dataset(nclt(tmp_path))[0].intensities
    assert intensities.dtype == np.float32 and intensities.tolist() == [7, 255, 0]
    sequence = mulran(tmp_path / "mulran")
    scan = sequence / f"sensor_data/Ouster/{MULRAN_STAMP + 100_000_000}.bin"
    np.array([[1, 2, 3, 640.5]], "<f4").tofile(scan)
    frame = open_dataset(sequence)[0]
    assert frame.points.tolist() == [[1, 2, 3]] and frame.intensities.tolist() == [640.5]


@rows("make, size", [(mulran, 16), (nclt, 8)])
def test_a_cut_scan_is_refused_when_it_is_read(make: Make, size: int, tmp_path: Path) -> None:
    root = make(tmp_path)
    path = max(root.rglob("*.bin"))
    path.write_bytes(path.read_bytes()[: size + 3])
    dataset = open_dataset(root, without_pose="keep")
    with refuses("truncated", str(path)):
        _ = dataset[-1].points
    path.write_bytes(b"")
    assert open_dataset(root, without_pose="keep")[-1].points.shape == (0, 3)


@rows("make", [mulran, nclt])
def test_scans_without_poses_open_and_have_no_images(make: Make, tmp_path: Path) -> None:
    root = make(tmp_path)
    text = info_of(root)
    assert f"kind {make.__name__}" in text and ".csv" in text
    next(root.glob("*.csv")).unlink()
    dataset = open_dataset(root, kind=make.__name__)
    assert dataset.poses is None and dataset.sensors == ("points",)
    with pytest.raises(MissingSensorError):
        open_dataset(root, sensors=["left"])
    put_text(tmp_path / "mine.txt", pose_lines(len(dataset)))
    assert open_dataset(root, poses=tmp_path / "mine.txt").poses[1, 0, 3] == 1


def cut(line: str) -> str:
    return line.rpartition(",")[0] + "\n"


@rows("make", [mulran, nclt])
@rows(
    "damage",
    [
        cut,
        lambda line: line.replace(",", ",x", 1),
        lambda line: line.replace(",", ".5,", 1),
        lambda line: "9" * 20 + line,
        lambda line: line.replace(",", " "),
        lambda line: line[:5] + "\n",
    ],
)
def test_a_damaged_line_of_poses_is_named(
    make: Make, damage: Callable[[str], str], tmp_path: Path
) -> None:
    root = make(tmp_path)
    path = next(root.glob("*.csv"))
    lines = path.read_text().splitlines(keepends=True)
    lines[3] = damage(lines[3])
    put_text(path, "".join(lines))
    with refuses("damaged-file", str(path), "4"):
        open_dataset(root)


@rows("make", [mulran, nclt])
def test_poses_of_another_time_are_refused(make: Make, tmp_path: Path) -> None:
    root = make(tmp_path)
    path = next(root.glob("*.csv"))
    lines = path.read_text().splitlines(keepends=True)
    put_text(path, "".join("1" + line[1:].replace(line[1:6], "00000", 1) for line in lines))
    with refuses("other-time", str(path)):
        open_dataset(root)
    for content, line in ((lines[0], "2"), ("", "1")):
        put_text(path, content)
        with refuses("too-short", str(path), line):
            open_dataset(root)


def test_names_that_are_no_stamps_and_empty_folders_are_refused(tmp_path: Path) -> None:
    scans = nclt(tmp_path) / "velodyne_sync"
    path = scans / f"{'9' * 17}.bin"
    path.write_bytes(struct.pack("<HHHBB", 1, 2, 3, 4, 5))
    with refuses("not-a-stamp", str(path)):
        open_dataset(scans.parent)
    (tmp_path / "empty/2012-01-08/velodyne_sync").mkdir(parents=True)
    with refuses("no-frames"):
        open_dataset(tmp_path / "empty")


def test_tables_may_have_blanks_capitals_and_comments(tmp_path: Path) -> None:
    root = nclt(tmp_path)
    path = next(root.glob("*.csv"))
    text = path.read_text().replace(",", ", ").replace("nan", "NaN")
    put_text(path, "# stamp, x, y, z, r, p, h\n\n" + text)
    assert open_dataset(root).poses[2, 0, 3] == pytest.approx(4)


LATITUDE, LONGITUDE = 49.0, 8.4
RADIUS_M = 6378137.0
FLATTENING = 1 / 298.257223563


def oxts_records(latitudes: object, longitudes: object) -> np.ndarray:
    rows = np.zeros((np.size(longitudes), 6))
    rows[:, 0], rows[:, 1], rows[:, 2] = latitudes, longitudes, 116
    return rows


def test_a_drive_along_a_parallel_is_as_long_as_on_the_sphere() -> None:
    longitudes = LONGITUDE + np.linspace(0, 0.0137, 11)  # a kilometre
    poses = oxts_poses(oxts_records(LATITUDE, longitudes))
    arcs = RADIUS_M * np.cos(np.radians(LATITUDE)) * np.radians(longitudes - LONGITUDE)
    assert 999 < arcs[-1] < 1001
    np.testing.assert_allclose(poses[:, 0, 3], arcs, atol=0.01)
    np.testing.assert_allclose(poses[:, 1:3, 3], 0, atol=1e-6)


def test_short_drives_are_right_on_the_ellipsoid_to_centimetres_and_long_to_0_2_percent() -> None:
    """Radii of curvature of WGS 84: of the prime vertical, and of the meridian."""
    sine_2 = np.sin(np.radians(LATITUDE)) ** 2
    square = FLATTENING * (2 - FLATTENING)
    vertical = RADIUS_M / np.sqrt(1 - square * sine_2)
    meridian = vertical * (1 - square) / (1 - square * sine_2)
    for metres in (10.0, 1000.0):
        step = np.degrees(metres / vertical / np.cos(np.radians(LATITUDE)))
        east = oxts_poses(oxts_records(LATITUDE, [LONGITUDE, LONGITUDE + step]))[1, 0, 3]
        step = np.degrees(metres / meridian)
        north = oxts_poses(oxts_records([LATITUDE, LATITUDE + step], [LONGITUDE] * 2))[1, 1, 3]
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
    angles = 0.1, -0.2, 2.5
    turn = Rotation.from_euler("xyz", angles).as_matrix()  # about fixed axes
    poses = oxts_poses(np.array([[0.0] * 6, [0, 0, 0, *angles]]))
    np.testing.assert_allclose(poses[1, :3, :3], turn, atol=1e-12)


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


def test_a_raw_drive_has_the_positions_of_its_receiver(tmp_path: Path) -> None:
    lines = {n: east(n) for n in range(3)}
    texts = lines[1].split()
    texts[23] = "0.25"  # pos_accuracy, by the data's dataformat.txt
    drive = raw_drive_with_oxts(tmp_path, lines | {1: " ".join(texts)})
    stamps = [f"2011-09-26 13:02:25.{n}12345678" for n in range(3)]
    put_text(drive / "oxts/timestamps.txt", "\n".join(stamps))
    dataset = open_dataset(drive)
    first, second, _ = dataset.fixes()
    np.testing.assert_array_equal(first.position, [LATITUDE, LONGITUDE, 116])
    assert first.covariance is None and second.stamp_ns - first.stamp_ns == 10**8
    np.testing.assert_array_equal(np.diag(second.covariance), [0.25**2, 0.25**2, 0.5**2])
    mount = dataset.robot_from_antenna()
    assert mount is not None and mount[0, 3] == pytest.approx(-0.8, abs=0.3)  # behind the scanner
    bare = raw_drive_with_oxts(tmp_path / "bare", {}, mounted=False)
    assert [*open_dataset(bare).fixes()] == []
    texts[23] = "much"
    put_text(drive / "oxts/data/0000000001.txt", " ".join(texts))
    with pytest.raises(DataError, match="pos_accuracy is 'much'"):
        [*dataset.fixes()]


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


def test_frames_without_a_record_have_no_pose_and_given_poses_come_first(tmp_path: Path) -> None:
    drive = raw_drive_with_oxts(tmp_path, {0: east(0), 2: east(2)})
    assert open_dataset(drive).numbers.tolist() == [0, 2]
    kept = open_dataset(drive, without_pose="keep")
    assert np.isfinite(kept.poses).all(axis=(1, 2)).tolist() == [True, False, True]
    put_text(drive / "oxts/data/0000000001.txt", "cut")
    put_text(tmp_path / "mine.txt", pose_lines(3, 7))
    assert open_dataset(drive, poses=tmp_path / "mine.txt").poses[2, 0, 3] == 14


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
def test_a_damaged_record_is_named_by_field(
    tmp_path: Path, line: str, code: str, field: str
) -> None:
    drive = raw_drive_with_oxts(tmp_path, {0: east(0), 1: line, 2: east(2)})
    with refuses(code, str(drive / "oxts/data/0000000001.txt"), field):
        open_dataset(drive)
