# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The readers of KITTI against real files, and against layouts that are made up."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fusionslam.datasets import (
    open_dataset,
    write_poses_tum,
)
from fusionslam.errors import DataError
from kitti import P2, TR, folder, odometry, put_image, put_scan, put_text, raw_drive


def test_scans_of_kitti_00_come_with_their_numbers_times_and_poses(test_data: Path) -> None:
    dataset = open_dataset(test_data / "kitti", sequence="00", sensors=("points",), gaps="skip")
    times = np.loadtxt(test_data / "kitti/times/times_00.txt")
    rows = np.loadtxt(test_data / "kitti/poses/00.txt")
    assert (dataset.kind, dataset.name) == ("kitti-odometry", "KITTI odometry 00")
    assert dataset.numbers.tolist() == [0, 1, 94, 95, 198, 199]
    assert np.array_equal(dataset.stamps_ns, np.rint(times[dataset.numbers] * 1e9))
    assert np.array_equal(dataset.poses[:, :3].reshape(-1, 12), rows[dataset.numbers])
    assert len(dataset.gaps) == 194
    assert dataset.sensors == ("points",) and dataset.counts == {"points": 6}


def test_a_scan_of_kitti_00_has_the_values_of_its_file(test_data: Path) -> None:
    root = test_data / "kitti/sequences/00"
    frame = open_dataset(root, sensors=("points",), gaps="skip")[-1]
    raw = np.fromfile(root / "velodyne/000199.bin", dtype=np.float32).reshape(-1, 4)
    assert frame.points.dtype == np.float32 and frame.points.flags.c_contiguous
    assert np.array_equal(frame.points, raw[:, :3])
    assert frame.colors is None and frame.index == 5


def test_consecutive_scans_of_kitti_00_overlap_under_their_poses(test_data: Path) -> None:
    """body_from_points joins the scanner to the camera that the poses describe."""
    from scipy.spatial import cKDTree

    dataset = open_dataset(test_data / "kitti", sequence="00", sensors=("points",), gaps="skip")
    transforms = [dataset[i].pose @ dataset.body_from_points for i in (2, 3)]
    worlds = [
        dataset[i].points @ transform[:3, :3].T + transform[:3, 3]
        for i, transform in zip((2, 3), transforms, strict=True)
    ]
    distances, _ = cKDTree(worlds[0]).query(worlds[1][::20])
    assert np.median(distances) < 0.1


def test_the_stereo_sequence_02_has_both_colour_cameras(test_data: Path) -> None:
    dataset = open_dataset(test_data / "kitti/sequences/02")
    frame = dataset[3]
    assert len(dataset) == 6 and dataset.has_stereo and not dataset.has_points
    assert frame.points is None
    assert frame.images["left"].shape == frame.images["right"].shape == (376, 1241, 3)
    with Image.open(test_data / "kitti/sequences/02/image_3/000003.png") as image:
        assert np.array_equal(frame.images["right"], np.asarray(image))


def test_camera_2_of_the_odometry_data_projects_with_p2_and_tr(test_data: Path) -> None:
    dataset = open_dataset(test_data / "kitti/sequences/02")
    entries = dict(
        line.split(":", 1)
        for line in (test_data / "kitti/sequences/02/calib.txt").read_text().splitlines()
        if line
    )
    p2 = np.array(entries["P2"].split(), float).reshape(3, 4)
    tr = np.array([*entries["Tr"].split(), 0, 0, 0, 1], float).reshape(4, 4)
    assert np.allclose(dataset.cameras["left"].projection_from_points, p2 @ tr, rtol=0, atol=1e-9)
    assert dataset.cameras["left"].size is None


def test_the_grey_pair_serves_where_there_is_no_colour(test_data: Path) -> None:
    dataset = open_dataset(test_data / "kitti/sequences/00", sensors=("left", "right"))
    frame = dataset[0]
    assert len(dataset) == 1 and frame.images["left"].ndim == 2
    assert frame.cameras["right"].projection[0, 3] == -386.1448


def test_frames_of_kitti_00_need_every_sensor_unless_told_otherwise(test_data: Path) -> None:
    with pytest.raises(DataError, match=r"image_0/000001.png is missing; 199 of 200 frames"):
        open_dataset(test_data / "kitti/sequences/00")
    assert open_dataset(test_data / "kitti/sequences/00", gaps="skip").numbers.tolist() == [0]


def test_a_root_with_several_sequences_lists_them(test_data: Path) -> None:
    with pytest.raises(DataError, match=r"choose with sequence=.* one of 00, 02, 08"):
        open_dataset(test_data / "kitti")
    with pytest.raises(DataError, match=r"no sequence 1:.* one of 00, 02, 08"):
        open_dataset(test_data / "kitti", sequence="1")


def test_ten_frames_of_kitti_raw_have_scan_image_and_calibration(
    test_data: Path, caplog: pytest.LogCaptureFixture
) -> None:
    dataset = open_dataset(test_data / "kitti/raw_2011_09_26")
    frame = dataset[9]
    assert dataset.kind == "kitti-raw" and len(dataset) == 10
    assert dataset.poses is None and not dataset.has_stereo
    assert frame.images["left"].shape == (375, 1242, 3)
    assert dataset.cameras["left"].size == (1242, 375)
    assert np.array_equal(dataset.stamps_ns, np.arange(10) * 100_000_000)
    assert "10 Hz" in caplog.text


def test_the_raw_calibration_agrees_with_an_independent_reader(test_data: Path) -> None:
    camera = open_dataset(test_data / "kitti/raw_2011_09_26").cameras["left"]
    texts: dict[str, Any] = {}
    for name in ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt"):
        lines = (test_data / "kitti/raw_2011_09_26" / name).read_text().splitlines()
        texts |= dict(line.split(": ", 1) for line in lines if ": " in line)
    rectify, transform = np.eye(4), np.eye(4)
    rectify[:3, :3] = np.array(texts["R_rect_00"].split(), float).reshape(3, 3)
    transform[:3, :3] = np.array(texts["R"].split(), float).reshape(3, 3)
    transform[:3, 3] = np.array(texts["T"].split(), float)
    p2 = np.array(texts["P_rect_02"].split(), float).reshape(3, 4)
    assert np.allclose(camera.projection_from_points, p2 @ rectify @ transform, rtol=1e-12)


@pytest.mark.parametrize("place", ["object", "object/training"])
def test_a_frame_of_kitti_object_projects_into_its_image(test_data: Path, place: str) -> None:
    dataset = open_dataset(test_data / "kitti" / place)
    frame = dataset[0]
    points = frame.points[(frame.points[:, 0] > 10) & (np.abs(frame.points[:, 1]) < 2)]
    pixels = np.c_[points, np.ones(len(points))] @ frame.cameras["left"].projection_from_points.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    height, width = frame.images["left"].shape[:2]
    inside = ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
    assert dataset.kind == "kitti-object" and dataset.stamps_ns.tolist() == [0]
    assert (height, width) == (370, 1224)
    assert inside.mean() > 0.99


def test_a_sequence_is_opened_from_its_folder_and_from_the_root(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    for dataset in (
        open_dataset(sequence),
        open_dataset(tmp_path),
        open_dataset(tmp_path, sequence="3"),
    ):
        assert dataset.root == sequence and len(dataset) == 6
        assert dataset.poses[5, 0, 3] == 5 and dataset.stamps_ns[5] == 500_000_000
        assert [frame.index for frame in dataset] == list(range(6))


def test_another_file_of_poses_may_be_given(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    stamps = np.arange(6) * 100_000_000
    write_poses_tum(tmp_path / "mine.txt", stamps + 3_000_000, np.tile(np.eye(4), (6, 1, 1)))
    assert np.array_equal(open_dataset(sequence, poses=tmp_path / "mine.txt").poses[5], np.eye(4))


def test_a_sequence_without_times_runs_at_10_hz_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    sequence = odometry(tmp_path)
    (sequence / "times.txt").unlink()
    assert open_dataset(sequence).stamps_ns.tolist() == [n * 100_000_000 for n in range(6)]
    assert "no " in caplog.text and "times.txt" in caplog.text


def test_scans_alone_need_no_calibration(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    (sequence / "calib.txt").unlink()
    assert open_dataset(sequence, sensors=["points"]).body_from_points is None
    with pytest.raises(DataError, match=r"calib.txt is missing: expected KITTI calibration"):
        open_dataset(sequence)


def test_published_raw_drives_lie_under_their_date_and_have_exact_times(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path)
    exact = np.datetime64("2011-09-26T13:02:25.964389442", "ns").astype(np.int64)
    for dataset in (open_dataset(drive), open_dataset(tmp_path)):
        assert dataset.root == drive and len(dataset) == 3
        assert dataset.stamps_ns[2] == exact
    raw_drive(tmp_path, "2011_09_26_drive_0002_sync")
    assert open_dataset(tmp_path, sequence="0002").root.name == "2011_09_26_drive_0002_sync"
    with pytest.raises(DataError, match="drive_0001_sync, 2011_09_26_drive_0002_sync"):
        open_dataset(tmp_path)


def test_a_raw_drive_without_calibration_names_both_places(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path)
    (tmp_path / "calib_cam_to_cam.txt").unlink()
    with pytest.raises(DataError, match=r"drive_0001_sync/calib_cam_to_cam.txt is missing, and"):
        open_dataset(drive)


def test_object_frames_have_their_own_calibration_and_no_gaps_between_numbers(
    tmp_path: Path,
) -> None:
    root = tmp_path / "training"
    for number, focal in ((3, 700), (8, 800)):
        put_scan(root / f"velodyne/{number:06d}.bin")
        put_image(root / f"image_2/{number:06d}.png")
        put_text(
            root / f"calib/{number:06d}.txt",
            f"P2: {P2.replace('700', str(focal))}\nR0_rect: 1 0 0 0 1 0 0 0 1\n"
            f"Tr_velo_to_cam: {TR}\n",
        )
    dataset = open_dataset(tmp_path)
    assert dataset.numbers.tolist() == [3, 8] and dataset.gaps == []
    assert [frame.cameras["left"].projection[0, 0] for frame in dataset] == [700, 800]
    assert dataset.stamps_ns.tolist() == [3_000_000_000, 8_000_000_000]
    (root / "calib/000008.txt").unlink()
    with pytest.raises(DataError, match=r"calib/000008.txt is missing; 1 of 2 frames"):
        open_dataset(tmp_path)


def test_a_gap_in_the_middle_is_an_error_unless_it_may_be_skipped(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    sequence = odometry(tmp_path, (0, 1, 4, 5))
    with pytest.raises(DataError) as error:
        open_dataset(sequence)
    assert f"{sequence}/velodyne/000002.bin is missing; 2 of 6 frames" in str(error.value)
    assert 'gaps="skip"' in str(error.value) and "--skip-gaps" in str(error.value)
    dataset = open_dataset(sequence, gaps="skip")
    assert dataset.numbers.tolist() == [0, 1, 4, 5] and dataset.gaps == [2, 3]
    assert dataset.poses[:, 0, 3].tolist() == [0, 1, 4, 5]
    assert "2 of 6 frames" in caplog.text


def test_a_hole_in_one_sensor_is_a_gap_only_for_those_who_need_it(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    (sequence / "image_3/000005.png").unlink()
    with pytest.raises(DataError, match=r"image_3/000005.png is missing; 1 of 6 frames"):
        open_dataset(sequence)
    assert len(open_dataset(sequence, sensors=("points", "left"))) == 6


def test_sensors_that_never_meet_leave_no_frame(tmp_path: Path) -> None:
    folder(tmp_path)
    for number in (0, 1, 2):
        (tmp_path / f"images/00{number}.png").rename(tmp_path / f"images/00{number + 3}.png")
    with pytest.raises(DataError, match="no frame has a file from each of points, left"):
        open_dataset(tmp_path, gaps="skip")


def test_names_that_do_not_count_frames_are_no_endless_gap(tmp_path: Path) -> None:
    for name in ("0000000001", "1317354879229752000"):
        put_scan(tmp_path / f"velodyne/{name}.bin")
    with pytest.raises(DataError, match="do not count frames"):
        open_dataset(tmp_path, gaps="skip")
