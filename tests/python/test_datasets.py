# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The readers against real KITTI files, and what they say about files that are wrong."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from fusionslam.datasets import (
    match_poses,
    open_dataset,
    read_bin,
    read_calib_yaml,
    read_cloud,
    read_image,
    read_poses,
    read_poses_tum,
    read_times,
    read_timestamps,
    write_cloud,
    write_poses_tum,
)
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.sensors import Cloud

P2 = "700 0 2 45 0 700 1.5 0.1 0 0 1 0.003"
P3 = "700 0 2 -330 0 700 1.5 0.1 0 0 1 0.003"
TR = "0 -1 0 0.1 0 0 -1 0.2 1 0 0 0.3"
CALIB = f"P0: {P2}\nP1: {P3}\nP2: {P2}\nP3: {P3}\nTr: {TR}\n"
POSE_LINE = "1 0 0 {} 0 1 0 0 0 0 1 0\n"
RNG = np.random.default_rng(7)
POINTS = RNG.normal(size=(20, 3)).astype(np.float32)
COLORS = RNG.integers(0, 256, (20, 3), dtype=np.uint8)


def put_scan(path: Path) -> None:
    write_cloud(path, Cloud(POINTS))


def put_image(path: Path, size: tuple[int, int] = (4, 3)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, (10, 20, 30)).save(path)


def put_text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def odometry(root: Path, numbers: Iterable[int] = range(6)) -> Path:
    """A small sequence 03 of colour stereo pairs and scans."""
    sequence = root / "sequences" / "03"
    for number in numbers:
        put_scan(sequence / f"velodyne/{number:06d}.bin")
        put_image(sequence / f"image_2/{number:06d}.png")
        put_image(sequence / f"image_3/{number:06d}.png")
    put_text(sequence / "calib.txt", CALIB)
    put_text(sequence / "times.txt", "".join(f"{0.1 * n:e}\n" for n in range(6)))
    put_text(root / "poses" / "03.txt", "".join(POSE_LINE.format(n) for n in range(6)))
    return sequence


def folder(root: Path, stems: Iterable[str] = ("000", "001", "002"), suffix: str = ".ply") -> Path:
    for stem in stems:
        write_cloud(root / f"clouds/{stem}{suffix}", Cloud(POINTS, COLORS))
        put_image(root / f"images/{stem}.png")
    return root


# KITTI odometry, real files


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


# KITTI raw and object, real files


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
    texts = {}
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


# KITTI layouts, made up


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


def raw_drive(root: Path, name: str = "2011_09_26_drive_0001_sync") -> Path:
    size = "4.0 3.0"
    eye, zero = "1 0 0 0 1 0 0 0 1", "0 0 0"
    put_text(
        root / "calib_cam_to_cam.txt",
        f"calib_time: 09-Jan-2012 13:57:47\nR_rect_00: {eye}\nP_rect_02: {P2}\nS_rect_02: {size}\n",
    )
    put_text(root / "calib_velo_to_cam.txt", f"R: {eye}\nT: {zero}\n")
    for number in range(3):
        put_scan(root / name / f"velodyne_points/data/{number:010d}.bin")
        put_image(root / name / f"image_02/data/{number:010d}.png")
    stamps = (f"2011-09-26 13:02:25.96438944{n}\n" for n in range(3))
    put_text(root / name / "velodyne_points/timestamps.txt", "".join(stamps))
    return root / name


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


# Gaps


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


# Plain folders


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_a_folder_of_coloured_clouds_gives_colours(tmp_path: Path, suffix: str) -> None:
    dataset = open_dataset(folder(tmp_path, suffix=suffix))
    assert dataset.kind == "folder" and len(dataset) == 3 and dataset.pose_frame == "points"
    assert np.array_equal(dataset[1].points, POINTS)
    assert np.array_equal(dataset[1].colors, COLORS)
    assert dataset.cameras == {} and dataset[1].images["left"].shape == (3, 4, 3)


def test_clouds_may_lie_in_the_folder_itself(tmp_path: Path) -> None:
    for name in ("scan_9.bin", "scan_10.bin", "scan_11.bin"):
        put_scan(tmp_path / name)
    dataset = open_dataset(tmp_path)
    assert dataset.numbers.tolist() == [9, 10, 11] and dataset[0].colors is None


def test_clouds_and_images_belong_together_by_the_number_in_their_names(tmp_path: Path) -> None:
    for number in range(3):
        put_scan(tmp_path / f"clouds/cloud_{number:03d}.bin")
        put_image(tmp_path / f"left/left_{number}.png")
        put_image(tmp_path / f"right/right_{number}.jpg")
    assert open_dataset(tmp_path).sensors == ("points", "left", "right")
    (tmp_path / "clouds/cloud_001.bin").unlink()
    with pytest.raises(DataError, match=r"clouds/cloud_001.bin is missing"):
        open_dataset(tmp_path)


def test_names_that_are_nanoseconds_are_times(tmp_path: Path) -> None:
    stems = ("1317354879229752001", "1317354879329752002")
    dataset = open_dataset(folder(tmp_path, stems))
    assert dataset.stamps_ns.tolist() == [int(stem) for stem in stems]
    assert dataset.numbers.tolist() == [0, 1]
    (tmp_path / f"images/{stems[1]}.png").unlink()
    with pytest.raises(DataError, match=rf"images/{stems[1]}.png is missing"):
        open_dataset(tmp_path)


def test_images_at_other_times_are_no_gaps_between_the_scans(tmp_path: Path) -> None:
    folder(tmp_path, ("1317354879000000000", "1317354879200000000"))
    put_image(tmp_path / "images/1317354879100000000.png")
    assert open_dataset(tmp_path, sensors=("points",)).numbers.tolist() == [0, 1]
    with pytest.raises(DataError, match=r"clouds/1317354879100000000.ply is missing"):
        open_dataset(tmp_path)
    with pytest.raises(DataError, match="has no files of sensor 'right'"):
        open_dataset(tmp_path, sensors=("right",))


def test_names_without_numbers_are_taken_in_their_order(tmp_path: Path) -> None:
    dataset = open_dataset(folder(tmp_path, ("kitchen", "attic")))
    assert dataset.streams["points"].files[0].stem == "attic"


def test_two_files_of_one_frame_are_refused(tmp_path: Path) -> None:
    folder(tmp_path)
    put_scan(tmp_path / "clouds/001.bin")
    with pytest.raises(DataError, match=r"001.bin and .*001.ply are both frame 1"):
        open_dataset(tmp_path)


def test_tum_poses_give_a_folder_its_times(tmp_path: Path) -> None:
    stamps = np.array([1_317_354_879_229_752_001, 1_317_354_879_329_752_002, 1 << 60])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = (1, 2, 3)
    write_poses_tum(tmp_path / "poses.txt", stamps, poses)
    dataset = open_dataset(folder(tmp_path))
    assert np.array_equal(dataset.stamps_ns, stamps)
    assert np.array_equal(dataset.poses, poses)


def test_tum_poses_are_matched_to_times_and_must_be_near(tmp_path: Path) -> None:
    put_text(tmp_path / "times.txt", "10.0\n10.1\n10.2\n")
    line = "{} {} 0 0 0 0 0 1\n"
    put_text(tmp_path / "poses.txt", "# t x\n" + "".join(map(line.format, (10.2, 10.1, 10), "210")))
    dataset = open_dataset(folder(tmp_path))
    assert dataset.poses[:, 0, 3].tolist() == [0, 1, 2]
    put_text(tmp_path / "poses.txt", "".join(map(line.format, (10, 10.15, 10.2), "012")))
    with pytest.raises(DataError, match=r"within 10 ms of 1 of 3 frames.*frame 1 at 10.1"):
        open_dataset(tmp_path)


def test_kitti_poses_of_a_folder_are_matched_by_number(tmp_path: Path) -> None:
    put_text(tmp_path / "poses.txt", "".join(POSE_LINE.format(n) for n in range(5)))
    dataset = open_dataset(folder(tmp_path, ("2", "3", "4")))
    assert dataset.poses[:, 0, 3].tolist() == [2, 3, 4]


def test_calib_yaml_describes_the_cameras_of_a_folder(tmp_path: Path) -> None:
    put_text(
        tmp_path / "calib.yaml",
        f"left:\n  projection: [{P2.replace(' ', ', ')}]\n  size: [4, 3]\n"
        "  rectified_from_points: [[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]\n",
    )
    camera = open_dataset(folder(tmp_path)).cameras["left"]
    assert camera.projection[0, 3] == 45 and camera.size == (4, 3)
    assert camera.rectified_from_points[2, 0] == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("left: {projection: [1, 2]}", "left.projection to be 3 x 4 numbers"),
        ("left: {projektion: [1, 2]}", "left has unknown key projektion, expected projection"),
        ("left: {size: [4, 3]}", "left lacks projection"),
        ("front: {}", "unknown key front, expected left, right"),
        ("left: [", "expected YAML"),
        ("just text", "no mapping"),
        ("right: {projection: [7, 0, 2, 0, 0, 7, 1, 0, 0, 0, 1, 0]}", "lacks camera 'left'"),
        ("left: {projection: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]}", "singular"),
    ],
)
def test_a_wrong_calib_yaml_is_named_with_what_was_expected(
    tmp_path: Path, text: str, message: str
) -> None:
    put_text(tmp_path / "calib.yaml", text)
    with pytest.raises(DataError, match=message) as error:
        open_dataset(folder(tmp_path))
    assert "calib.yaml" in str(error.value)


def test_the_calib_yaml_of_the_documentation_is_valid(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs/datasets.md").read_text()
    put_text(tmp_path / "calib.yaml", page.split("```yaml\n")[1].split("```")[0])
    cameras = read_calib_yaml(tmp_path / "calib.yaml")
    assert cameras["left"].size == (1241, 376) and cameras["right"].size is None


# What is wrong is named


def test_opening_reads_no_scan_and_no_image(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    (sequence / "velodyne/000005.bin").write_bytes(b"123")
    (sequence / "image_2/000005.png").write_bytes(b"")
    frames = list(open_dataset(sequence))
    assert len(frames[4].points) == 20
    with pytest.raises(DataError, match=r"000005.bin has 3 bytes, expected a multiple of 16"):
        _ = frames[5].points
    with pytest.raises(DataError, match=r"000005.png cannot be read: expected an 8-bit"):
        _ = frames[5].images["left"]


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("P2", None, "lacks P2"),
        ("Tr", None, "lacks Tr"),
        ("P2", "1 2 3", "P2 has 3 numbers, expected 12"),
        ("P3", P3.replace("700", "seven"), "12 numbers behind P3"),
        ("P2", P2.replace("700", "nan"), "projection is not finite"),
        ("Tr", " ".join(["0"] * 12), "rectified_from_points is singular"),
    ],
)
def test_a_wrong_calib_txt_is_named_with_the_key(
    tmp_path: Path, key: str, text: str | None, message: str
) -> None:
    sequence = odometry(tmp_path)
    lines = [line for line in CALIB.splitlines() if not line.startswith(key)]
    put_text(sequence / "calib.txt", "\n".join(lines + ([f"{key}: {text}"] if text else [])))
    with pytest.raises(DataError, match=message) as error:
        open_dataset(sequence)
    assert str(sequence / "calib.txt") in str(error.value)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("poses.txt", POSE_LINE * 5, "has 5 lines, frame 5 needs 6"),
        ("poses.txt", "1 2 3\n" * 6, "has 3 columns: expected poses"),
        ("poses.txt", "1 0 0 x 0 1 0 0 0 0 1 0\n" * 6, "expected poses.*row 0, column 4"),
        ("poses.txt", "1 0 0 nan 0 1 0 0 0 0 1 0\n" * 6, "line 1: NaN or infinity"),
        ("poses.txt", "0 0 0 0 0 0 0 0\n" * 6, "line 1: a quaternion of zeros"),
        ("poses.txt", "", "is empty: expected poses"),
        ("times.txt", "0.0\n0.1\n", "has 2 lines, frame 5 needs 6"),
        ("times.txt", "0.0\nlate\n", "expected times in seconds"),
        ("times.txt", "0 1\n0 1\n", "has 2 columns: expected times in seconds"),
        ("times.txt", "1e99\n" * 6, "fit 64 bits"),
    ],
)
def test_a_wrong_file_of_poses_or_times_is_named(
    tmp_path: Path, file: str, text: str, message: str
) -> None:
    sequence = odometry(tmp_path)
    put_text(sequence / file, text.replace("{}", "0"))
    with pytest.raises(DataError, match=message) as error:
        open_dataset(sequence)
    assert str(sequence / file) in str(error.value)


def test_images_of_another_size_than_the_calibration_or_the_left_are_refused(
    tmp_path: Path,
) -> None:
    drive = raw_drive(tmp_path / "raw")
    put_image(drive / "image_02/data/0000000001.png", (5, 3))
    with pytest.raises(DataError, match=r"0000000001.png is 5x3, the calibration says 4x3"):
        _ = open_dataset(drive)[1].images["left"]
    sequence = odometry(tmp_path)
    put_image(sequence / "image_3/000002.png", (4, 4))
    with pytest.raises(DataError, match=r"image_3/000002.png is 4x4, the left image .* says 4x3"):
        _ = open_dataset(sequence)[2].images["right"]


def test_what_is_no_dataset_is_named_with_what_was_looked_for(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="nowhere does not exist"):
        open_dataset(tmp_path / "nowhere")
    put_text(tmp_path / "notes.txt", "nothing")
    with pytest.raises(DataError, match=r"notes.txt is a file: expected the folder"):
        open_dataset(tmp_path / "notes.txt")
    with pytest.raises(DataError, match=r"(?s)kitti-object: .*kitti-odometry: .*velodyne/.*clouds"):
        open_dataset(tmp_path)


def test_an_empty_dataset_is_refused(tmp_path: Path) -> None:
    (tmp_path / "velodyne").mkdir()
    with pytest.raises(DataError, match="has no frames: expected scans or images"):
        open_dataset(tmp_path)
    with pytest.raises(DataError, match="has no frames: expected scans or images"):
        open_dataset(tmp_path, kind="folder")


def test_wrong_arguments_are_named(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    for arguments, message in (
        ({"kind": "kiti"}, "kind is 'kiti', expected one of kitti-object"),
        ({"gaps": "ignore"}, "gaps is 'ignore', expected one of error, skip"),
        ({"sensors": ()}, "sensors is '', expected one of points, left, right"),
        ({"sensors": ("radar",)}, "sensors is 'radar', expected one of points, left, right"),
    ):
        with pytest.raises(ConfigError, match=message):
            open_dataset(sequence, **arguments)
    assert open_dataset(sequence, sensors="left").sensors == ("left",)
    with pytest.raises(DataError, match="there is no sequence 05"):
        open_dataset(sequence, sequence="05")
    (tmp_path / "other/velodyne").mkdir(parents=True)
    put_scan(tmp_path / "other/velodyne/000000.bin")
    with pytest.raises(DataError, match="no files of sensor 'left', only of points"):
        open_dataset(tmp_path / "other", sensors=("left",))


# Single files


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".bin"])
@pytest.mark.parametrize("count", [0, 1, 20])
@pytest.mark.parametrize("colored", [True, False])
def test_clouds_come_back_as_they_were_written(
    tmp_path: Path, suffix: str, count: int, colored: bool
) -> None:
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, Cloud(POINTS[:count], COLORS[:count] if colored else None))
    cloud = read_cloud(path)
    assert cloud.points.dtype == np.float32 and cloud.points.flags.c_contiguous
    assert np.array_equal(cloud.points, POINTS[:count])
    if colored and count and suffix != ".bin":
        assert cloud.colors.dtype == np.uint8
        assert np.array_equal(cloud.colors, COLORS[:count])
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".bin"])
@pytest.mark.parametrize("kept", [0.02, 0.5, 0.999])
def test_truncated_clouds_are_named(tmp_path: Path, suffix: str, kept: float) -> None:
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, Cloud(POINTS, COLORS))
    data = path.read_bytes()
    path.write_bytes(data[: min(int(len(data) * kept) | 1, len(data) - 1)])
    with pytest.raises(DataError, match=rf"cloud{suffix} .*(expected|header)"):
        read_cloud(path)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd_files_of_every_encoding_are_read(tmp_path: Path, encoding: str) -> None:
    from pypcd4.pypcd4 import Encoding, PointCloud

    cloud = PointCloud.from_xyzi_points(np.c_[POINTS, POINTS[:, 0]])
    cloud.save(tmp_path / "cloud.pcd", Encoding(encoding))
    assert np.allclose(read_cloud(tmp_path / "cloud.pcd").points, POINTS, atol=1e-6)
    (tmp_path / "cloud.pcd").write_bytes((tmp_path / "cloud.pcd").read_bytes()[:-30])
    with pytest.raises(DataError, match=r"cloud.pcd"):
        read_cloud(tmp_path / "cloud.pcd")


def test_rays_without_return_in_a_pcd_are_left_out(tmp_path: Path) -> None:
    points = POINTS.copy()
    points[3] = np.nan
    write_cloud(tmp_path / "cloud.pcd", Cloud(points, COLORS))
    cloud = read_cloud(tmp_path / "cloud.pcd")
    assert np.array_equal(cloud.points, np.delete(POINTS, 3, axis=0))
    assert np.array_equal(cloud.colors, np.delete(COLORS, 3, axis=0))


def test_ascii_ply_is_read_and_must_be_complete(tmp_path: Path) -> None:
    header = (
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\n"
        "property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "end_header\n"
    )
    put_text(tmp_path / "a.ply", header + "1 2 3 255 0 7\n4 5 6 1 2 3\n")
    cloud = read_cloud(tmp_path / "a.ply")
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.colors.tolist() == [[255, 0, 7], [1, 2, 3]]
    put_text(tmp_path / "a.ply", header + "1 2 3 255 0 7\n")
    with pytest.raises(DataError, match="holds 1 points, its header says 2"):
        read_cloud(tmp_path / "a.ply")
    put_text(tmp_path / "a.ply", header.replace("uchar", "float") + "1 2 3 1 0 0\n" * 2)
    with pytest.raises(DataError, match="colours of type float32, expected uchar"):
        read_cloud(tmp_path / "a.ply")


def test_an_empty_scan_is_a_cloud_without_points(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"")
    assert read_bin(tmp_path / "a.bin").points.shape == (0, 3)


def test_a_cloud_of_another_shape_or_suffix_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"a.las is no cloud file: expected one of .bin, .pcd"):
        write_cloud(tmp_path / "a.las", Cloud(POINTS))
    with pytest.raises(ShapeError, match=r"points have shape \(20, 2\)"):
        write_cloud(tmp_path / "a.ply", Cloud(POINTS[:, :2]))
    with pytest.raises(ShapeError, match=r"colors have shape \(19, 3\)"):
        write_cloud(tmp_path / "a.ply", Cloud(POINTS, COLORS[1:]))
    assert not list(tmp_path.iterdir())


def test_images_are_grey_or_rgb_and_8_bit(tmp_path: Path) -> None:
    for mode, shape in (("L", (3, 4)), ("RGB", (3, 4, 3)), ("RGBA", (3, 4, 3)), ("P", (3, 4, 3))):
        Image.new(mode, (4, 3)).save(tmp_path / "a.png")
        image = read_image(tmp_path / "a.png")
        assert image.shape == shape and image.dtype == np.uint8
    Image.new("I;16", (4, 3)).save(tmp_path / "a.png")
    with pytest.raises(DataError, match=r"a.png has pixels of mode I;16, expected 8 bits"):
        read_image(tmp_path / "a.png")


def test_a_truncated_image_is_named(tmp_path: Path) -> None:
    noise = RNG.integers(0, 256, (64, 64, 3), dtype=np.uint8)
    for name in ("a.png", "a.jpg"):
        Image.fromarray(noise).save(tmp_path / name)
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) // 2])
        with pytest.raises(DataError, match=rf"{name} cannot be read: expected an 8-bit .*trunc"):
            read_image(tmp_path / name)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    for read, name in (
        (read_cloud, "a.bin"),
        (read_cloud, "a.pcd"),
        (read_cloud, "a.ply"),
        (read_image, "a.png"),
        (read_poses, "a.txt"),
        (read_times, "a.txt"),
        (read_timestamps, "a.txt"),
    ):
        with pytest.raises(DataError, match=rf"{name} is missing: expected"):
            read(tmp_path / name)


def test_times_are_exact_nanoseconds(tmp_path: Path) -> None:
    put_text(tmp_path / "times.txt", "1.037359e-01\n1317354879.229752001\n")
    assert read_times(tmp_path / "times.txt").tolist() == [103_735_900, 1_317_354_879_229_752_001]


@pytest.mark.parametrize("text", ["2011-09-26 13:02\n\n2011-09-26 13:03\n", "noon\n", ""])
def test_wrong_timestamps_are_named(tmp_path: Path, text: str) -> None:
    put_text(tmp_path / "timestamps.txt", text)
    with pytest.raises(DataError, match=r"timestamps.txt.* expected"):
        read_timestamps(tmp_path / "timestamps.txt")


@given(
    st.integers(0, 2**62),
    st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
)
def test_tum_poses_come_back_as_they_were_written(
    tmp_path_factory: pytest.TempPathFactory,
    stamp: int,
    position: list[float],
    quaternion: list[float],
) -> None:
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    pose[:3, 3] = position
    path = tmp_path_factory.mktemp("poses") / "poses.txt"
    write_poses_tum(path, np.array([stamp]), pose[None])
    stamps, poses = read_poses_tum(path)
    assert stamps.tolist() == [stamp]
    assert np.array_equal(poses[0, :3, 3], position)
    assert np.allclose(poses[0], pose, rtol=0, atol=1e-9)


def test_tum_quaternions_have_their_real_part_last(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    put_text(tmp_path / "poses.txt", f"0 1 2 3 0 0 {half} {half}\n")
    _, poses = read_poses_tum(tmp_path / "poses.txt")
    assert np.allclose(poses[0], [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def test_poses_need_one_stamp_each(tmp_path: Path) -> None:
    with pytest.raises(ShapeError, match=r"expected \(2, 4, 4\)"):
        write_poses_tum(tmp_path / "poses.txt", np.zeros(2, dtype=np.int64), np.eye(4)[None])


def test_the_nearest_pose_is_found_whatever_the_order_of_the_file(tmp_path: Path) -> None:
    stamps = RNG.permutation(100) * 5_000_000
    poses = np.tile(np.eye(4), (100, 1, 1))
    poses[:, 0, 3] = stamps
    write_poses_tum(tmp_path / "poses.txt", stamps, poses)
    wanted = np.sort(RNG.integers(0, 99 * 5_000_000, 30))
    found = match_poses(tmp_path / "poses.txt", np.arange(30), wanted)[:, 0, 3]
    brute = stamps[np.abs(stamps[None] - wanted[:, None]).argmin(axis=1)]
    assert np.array_equal(np.abs(found - wanted), np.abs(brute - wanted))


@pytest.mark.parametrize("folder", ["velodyne", "image_2", "."])
def test_a_folder_that_may_not_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str
) -> None:
    root = odometry(tmp_path)
    hidden, look = (root / folder).resolve(), Path.iterdir

    def iterdir(path: Path) -> Iterator[Path]:
        if path.resolve() == hidden:
            raise PermissionError(13, "Permission denied", str(path))
        return look(path)

    monkeypatch.setattr(Path, "iterdir", iterdir)  # the tests may run as root
    kind = "folder" if folder == "." else None
    with pytest.raises(DataError, match=rf"{hidden} cannot be read: Permission denied"):
        open_dataset(root, kind=kind)


@pytest.mark.parametrize("sequence", [3, "3", "03", "003"])
def test_a_sequence_may_be_named_by_its_number(tmp_path: Path, sequence: int | str) -> None:
    root = odometry(tmp_path)
    number = int(root.name)
    wanted = str(sequence).replace("3", str(number)) if isinstance(sequence, str) else number
    assert open_dataset(root.parent.parent, sequence=wanted).root == root
    assert open_dataset(root, sequence=wanted).root == root
    with pytest.raises(DataError, match="sequence 77"):
        open_dataset(root.parent.parent, sequence=77)


def test_times_that_run_backwards_are_named_with_their_line(tmp_path: Path) -> None:
    path = tmp_path / "times.txt"
    path.write_text("# seconds\n0.0\n0.1\n0.1\n\n0.05\n")
    with pytest.raises(DataError, match=r"times\.txt, line 6: earlier than the line before"):
        read_times(path)
    path.write_text("2011-09-26 13:02:25.9\n2011-09-26 13:02:25.8\n")
    with pytest.raises(DataError, match=r"times\.txt, line 2: earlier"):
        read_timestamps(path)


@pytest.mark.parametrize(
    "row",
    ["2 0 0 0 0 2 0 0 0 0 2 0", "1 0 0 0 0 1 0 0 0 0 -1 0", "1 0.2 0 5 0 1 0 5 0 0 1 5"],
    ids=["scaled", "mirrored", "sheared"],
)
def test_poses_that_are_no_rotation_are_named_with_their_line(tmp_path: Path, row: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(f"1 0 0 0 0 1 0 0 0 0 1 0\n# comment\n{row}\n")
    with pytest.raises(DataError, match=r"poses\.txt, line 3: .* no rotation"):
        read_poses(path)


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
@pytest.mark.parametrize("kept", [0, 1, 3, 20, 60, 100])
def test_a_header_that_is_cut_is_named_in_plain_words(
    tmp_path: Path, suffix: str, kept: int
) -> None:
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, Cloud(POINTS, COLORS))
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(
        DataError, match=r"does not begin like|is cut short in its header"
    ) as caught:
        read_cloud(path)
    assert "pydantic" not in str(caught.value) and "index out of range" not in str(caught.value)


def test_a_recording_that_belongs_to_somebody_else_is_named(tmp_path: Path) -> None:
    root, user = odometry(tmp_path), os.geteuid()
    root.chmod(0)
    try:
        if user == 0:
            os.seteuid(65534)  # nobody: root may read everything
        with pytest.raises(DataError, match="cannot be read: Permission denied"):
            open_dataset(root)
    finally:
        os.seteuid(user)
        root.chmod(0o755)
