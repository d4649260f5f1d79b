# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The readers of KITTI-360 and SemanticKITTI, against made folders of their layouts."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from cli import succeeds
from fusionslam.datasets import open_dataset
from fusionslam.datasets.pose_files import read_poses_kitti
from kitti import POINTS, pose_lines, put_text
from public_data import KITTI_360_DRIVE, PERSPECTIVE, kitti_360, semantic_kitti
from refusals import refuses
from rows import rows


def test_labels_beside_the_scans_are_no_trouble_and_the_poses_there_come_first(
    tmp_path: Path,
) -> None:
    sequence = semantic_kitti(tmp_path)
    dataset = open_dataset(tmp_path / "dataset", sequence="3")
    assert (dataset.kind, dataset.name) == ("kitti-odometry", "SemanticKITTI 03")
    assert dataset.sensors == ("points",) and np.array_equal(dataset[1].points, POINTS)
    assert dataset.poses_file == sequence / "poses.txt" and dataset.poses[2, 0, 3] == 4
    assert dataset.body_is_camera and dataset.body_from_points is not None
    chosen = open_dataset(sequence, poses=tmp_path / "dataset/poses/03.txt")
    assert chosen.poses[2, 0, 3] == 2
    assert "03/poses.txt" in succeeds("info", sequence).stdout
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


def test_frames_without_a_pose_keep_it_unknown_or_are_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    kept = open_dataset(kitti_360(tmp_path), without_pose="keep")
    known = np.isfinite(kept.poses).all(axis=(1, 2))
    assert known.tolist() == [False, True, True, False, True, False]
    assert np.isnan(kept[0].pose).all() and np.isfinite(kept[1].pose).all()
    caplog.clear()
    assert len(open_dataset(tmp_path)) == 3
    assert any(record.args[1:] == (3, 6) for record in caplog.records if record.args)


def test_the_fisheyes_are_counted_and_not_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert "image_02" not in open_dataset(kitti_360(tmp_path)).sensors
    assert "6 of image_02" in caplog.text
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
    text = succeeds("info", tmp_path).stdout
    assert "kitti-360" in text and f"{KITTI_360_DRIVE}/poses.txt" in " ".join(text.split())
    expected = np.eye(4)
    expected[:3, 3] = 1004, 2000, 116
    np.testing.assert_allclose(dataset.poses[2], expected, atol=1e-12)
    # By hand: camera 0 is (1.6, 0.1, -0.7) ahead, right and down of the IMU, the scanner 0.8 m
    # behind the camera, 0.3 m to its right and 0.2 m above it.
    np.testing.assert_allclose(dataset.body_from_points[:3, 3], [0.8, -0.4, 0.9], atol=1e-12)
    np.testing.assert_allclose(dataset.body_from_points[:3, :3], np.eye(3), atol=1e-12)


@rows("name", ["perspective.txt", "calib_cam_to_velo.txt"])
def test_without_calibration_the_scans_are_there_and_the_log_names_the_file(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    (kitti_360(tmp_path) / "calibration" / name).unlink()
    dataset = open_dataset(tmp_path)
    assert dataset.cameras == {} and len(dataset[0].points) == 20
    assert name in caplog.text


def test_what_a_drive_lacks_it_does_without(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
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


def test_other_poses_may_be_given(tmp_path: Path) -> None:
    put_text(tmp_path / "mine.txt", pose_lines(6, 3))
    dataset = open_dataset(kitti_360(tmp_path / "data"), poses=tmp_path / "mine.txt")
    assert np.array_equal(dataset.poses, read_poses_kitti(tmp_path / "mine.txt"))


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
def test_damaged_poses_are_named_with_the_line(
    tmp_path: Path, text: str, code: str, line: str
) -> None:
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
