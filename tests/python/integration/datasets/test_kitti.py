# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The readers of KITTI: real files, layouts that are made up, and recordings that are wrong."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cli import error_of
from error_codes import has_code
from fusionslam.datasets import open_bag, open_dataset, write_poses_tum
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.frame_check import first_cloud
from fusionslam.pipelines.recording import Recording
from kitti import (
    ODOMETRY_CALIB,
    P2,
    P3,
    POSE_LINE,
    TR,
    folder,
    odometry,
    pose_lines,
    put_image,
    put_scan,
    put_text,
    raw_drive,
)
from refusals import refuses
from rows import rows

Make = Callable[[Path], Path]
Logs = pytest.LogCaptureFixture


def test_scans_of_kitti_00_come_with_their_numbers_times_and_poses(test_data: Path) -> None:
    root = test_data / "kitti"
    dataset = open_dataset(root, sequence="00", sensors=("points",), gaps="skip")
    times = np.loadtxt(root / "times/times_00.txt")
    rows = np.loadtxt(root / "poses/00.txt")
    assert (dataset.kind, dataset.name) == ("kitti-odometry", "KITTI odometry 00")
    assert dataset.numbers.tolist() == [0, 1, 94, 95, 198, 199] and len(dataset.gaps) == 194
    assert np.array_equal(dataset.stamps_ns, np.rint(times[dataset.numbers] * 1e9))
    assert np.array_equal(dataset.poses[:, :3].reshape(-1, 12), rows[dataset.numbers])
    raw = np.fromfile(root / "sequences/00/velodyne/000199.bin", np.float32).reshape(-1, 4)
    assert np.array_equal(dataset[-1].points, raw[:, :3])
    # Consecutive scans overlap: body_from_points joins scanner and camera 0, which has the poses.
    worlds = []
    for frame in (dataset[2], dataset[3]):
        transform = frame.pose @ dataset.body_from_points
        worlds.append(frame.points @ transform[:3, :3].T + transform[:3, 3])
    distances, _ = cKDTree(worlds[0]).query(worlds[1][::20])
    assert np.median(distances) < 0.1


def test_scans_of_kitti_raw_and_object_project_into_their_images(test_data: Path) -> None:
    raw = open_dataset(test_data / "kitti/raw_2011_09_26")
    split, parent = (open_dataset(test_data / "kitti" / n) for n in ("object/training", "object"))
    assert (raw.kind, len(raw), split.kind) == ("kitti-raw", 10, "kitti-object")
    assert split.root == parent.root and split.stamps_ns.tolist() == [0]
    for frame, shape in ((raw[9], (375, 1242, 3)), (split[0], (370, 1224, 3))):
        points = frame.points[(frame.points[:, 0] > 10) & (np.abs(frame.points[:, 1]) < 2)]
        image, camera = frame.images["left"], frame.cameras["left"]
        pixels = np.c_[points, np.ones(len(points))] @ camera.projection_from_points.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        inside = ((pixels >= 0) & (pixels < [shape[1], shape[0]])).all(axis=1)
        assert image.shape == shape and camera.size in (None, (shape[1], shape[0]))
        assert inside.mean() > 0.99


def test_stereo_alone_has_both_cameras_projecting_with_p_and_tr(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    put_image(sequence / "image_3/000003.png", (4, 3), (7, 8, 9))
    dataset = open_dataset(sequence, sensors=("left", "right"))
    frame = dataset[3]
    assert dataset.has_stereo and not dataset.has_points and frame.points is None
    assert np.unique(frame.images["right"]).tolist() == [7, 8, 9]
    tr = np.array([*TR.split(), 0, 0, 0, 1], float).reshape(4, 4)
    for name, text in (("left", P2), ("right", P3)):
        expected = np.array(text.split(), float).reshape(3, 4) @ tr
        np.testing.assert_allclose(frame.cameras[name].projection_from_points, expected, rtol=1e-12)
        assert frame.cameras[name].size is None


def test_the_grey_pair_serves_where_there_is_no_colour(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    for color, grey in ((2, 0), (3, 1)):
        (sequence / f"image_{color}").rename(sequence / f"image_{grey}")
    put_text(sequence / "calib.txt", ODOMETRY_CALIB.replace(P3, P3.replace("330", "386"), 1))
    assert open_dataset(sequence)[0].cameras["right"].projection[0, 3] == -386


def test_the_raw_calibration_joins_rectification_and_scanner(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path)
    rectify, transform = np.eye(4), np.eye(4)
    rectify[:3, :3] = Rotation.from_euler("xyz", (0.01, -0.02, 0.005)).as_matrix()
    transform[:3, :3] = Rotation.from_euler("xyz", (-1.5, 0.02, -1.6)).as_matrix()
    transform[:3, 3] = -0.004, -0.08, -0.27
    rows = {"R": transform[:3, :3], "T": transform[:3, 3], "R_rect_00": rectify[:3, :3]}
    texts = {key: " ".join(map(repr, rows[key].ravel().tolist())) for key in rows}
    put_text(tmp_path / "calib_velo_to_cam.txt", f"R: {texts['R']}\nT: {texts['T']}\n")
    cam = tmp_path / "calib_cam_to_cam.txt"
    put_text(cam, cam.read_text().replace("1 0 0 0 1 0 0 0 1", texts["R_rect_00"]))
    camera = open_dataset(drive).cameras["left"]
    expected = np.array(P2.split(), float).reshape(3, 4) @ rectify @ transform
    np.testing.assert_allclose(camera.projection_from_points, expected, rtol=1e-12)
    assert camera.size == (4, 3)


@rows("direct", [True, False])
def test_a_linked_sequence_has_the_poses_beside_the_link(tmp_path: Path, direct: bool) -> None:
    stored = odometry(tmp_path / "stored")
    (stored / "times.txt").rename(tmp_path / "stored/times.txt")
    # Of another drive, under the number of the link.
    put_text(tmp_path / "stored/poses/06.txt", "".join(POSE_LINE.format(9) for _ in range(6)))
    linked = tmp_path / "linked/sequences/06"
    linked.parent.mkdir(parents=True)
    linked.symlink_to(stored, target_is_directory=True)
    data = linked if direct else tmp_path / "linked"
    assert open_dataset(data).poses[5, 0, 3] == 5  # those of the sequence that is linked to
    put_text(tmp_path / "linked/poses/06.txt", pose_lines(6, 2))
    put_text(tmp_path / "linked/times/times_06.txt", "".join(f"{n}\n" for n in range(6)))
    dataset = open_dataset(data)
    assert dataset.name == "KITTI odometry 06" and dataset.poses[5, 0, 3] == 10
    assert dataset.stamps_ns[5] == 5_000_000_000
    drive = raw_drive(tmp_path / "day")  # whose calibration is that of its day
    (tmp_path / "mine").symlink_to(drive, target_is_directory=True)
    assert open_dataset(tmp_path / "mine").cameras["left"].size == (4, 3)


def test_poses_may_be_given_and_frames_after_their_end_are_left_out(tmp_path: Path) -> None:
    sequence, mine, stood = odometry(tmp_path), tmp_path / "mine.txt", np.tile(np.eye(4), (6, 1, 1))
    stamps = open_dataset(sequence).stamps_ns
    write_poses_tum(mine, stamps + 3_000_000, stood)
    assert np.array_equal(open_dataset(sequence, poses=mine).poses[5], np.eye(4))
    write_poses_tum(mine, stamps[::2], stood[::2])  # a slower truth
    dataset = open_dataset(sequence, poses=mine)
    assert dataset.numbers.tolist() == [0, 1, 2, 3, 4] and np.isfinite(dataset.poses).all()
    assert [frame.number for frame in dataset] == dataset.numbers.tolist()


@rows("make", [odometry, raw_drive])
def test_poses_by_time_need_a_recording_with_times(make: Make, tmp_path: Path) -> None:
    root, given = make(tmp_path / "drive"), tmp_path / "mine.txt"
    for name in ("times.txt", "timestamps.txt"):
        for path in root.rglob(name):
            path.unlink()
    assumed = open_dataset(root).stamps_ns
    poses = np.tile(np.eye(4), (len(assumed), 1, 1))
    for apart in (5 * assumed, assumed + 3_000_000):
        write_poses_tum(given, apart, poses)
        with refuses("no-times", str(given)):
            open_dataset(root, poses=given)
    write_poses_tum(given, assumed, poses)
    assert len(open_dataset(root, poses=given)) == len(assumed)


def test_a_sequence_without_times_runs_at_10_hz_and_says_so(tmp_path: Path, caplog: Logs) -> None:
    sequence = odometry(tmp_path)
    (sequence / "times.txt").unlink()
    assert open_dataset(sequence).stamps_ns.tolist() == [n * 100_000_000 for n in range(6)]
    assert str(sequence / "times.txt") in caplog.text


def test_without_calibration_there_are_scans(tmp_path: Path, caplog: Logs) -> None:
    sequence = odometry(tmp_path)
    calib = sequence / "calib.txt"
    calib.unlink()
    assert open_dataset(sequence, sensors=["points"]).body_from_points is None
    assert not caplog.records  # scans alone need none
    dataset = open_dataset(sequence)
    assert (dataset.cameras, dataset.body_from_points) == ({}, None)
    assert [str(calib) in text for text in caplog.messages] == [True]
    assert Recording.at(sequence).sources() == ("cloud",)
    assert first_cloud(dataset).status == "not possible"
    put_text(calib, "P2: 1 2 3\n")
    with pytest.raises(DataError, match=r"calib\.txt"):
        open_dataset(sequence)


def test_published_raw_drives_lie_under_their_date_and_have_exact_times(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path)
    exact = np.datetime64("2011-09-26T13:02:25.964389442", "ns").astype(np.int64)
    for dataset in (open_dataset(drive), open_dataset(tmp_path)):
        assert dataset.root == drive and len(dataset) == 3
        assert dataset.stamps_ns[2] == exact
    other = raw_drive(tmp_path, "2011_09_26_drive_0002_sync")
    assert open_dataset(tmp_path, sequence="0002").root == other
    with pytest.raises(DataError, check=has_code("no-sequence", drive.name, other.name)):
        open_dataset(tmp_path)
    # Sequences of odometry, too, are listed where there are several.
    odometry(tmp_path / "several").rename(tmp_path / "several/sequences/00")
    odometry(tmp_path / "several")
    for wanted in (None, "1"):
        with pytest.raises(DataError, check=has_code("no-sequence", "00", "03")):
            open_dataset(tmp_path / "several", sequence=wanted)


@rows("name", ["calib_cam_to_cam.txt", "calib_velo_to_cam.txt"])
def test_a_raw_drive_without_calibration_gives_its_scans_and_names_both_places(
    tmp_path: Path, caplog: Logs, name: str
) -> None:
    drive = raw_drive(tmp_path)
    (tmp_path / name).unlink()
    dataset = open_dataset(drive)
    assert (dataset.cameras, dataset.body_from_points) == ({}, None)
    assert all(str(folder / name) in caplog.text for folder in (drive, tmp_path))
    assert Recording.at(drive).sources() == ("cloud",)


def test_object_frames_have_their_own_calibration_and_no_gaps(tmp_path: Path) -> None:
    root = tmp_path / "training"
    for number, focal in ((3, 700), (8, 800)):
        put_scan(root / f"velodyne/{number:06d}.bin")
        put_image(root / f"image_2/{number:06d}.png")
        text = f"P2: {P2.replace('700', str(focal))}\nR0_rect: 1 0 0 0 1 0 0 0 1\n"
        put_text(root / f"calib/{number:06d}.txt", f"{text}Tr_velo_to_cam: {TR}\n")
    dataset = open_dataset(tmp_path)
    assert dataset.numbers.tolist() == [3, 8] and dataset.gaps == []
    assert [frame.cameras["left"].projection[0, 0] for frame in dataset] == [700, 800]
    assert dataset.stamps_ns.tolist() == [3_000_000_000, 8_000_000_000]
    (root / "calib/000008.txt").unlink()
    with pytest.raises(DataError, check=has_code("gaps", root / "calib/000008.txt", 1)):
        open_dataset(tmp_path)


def test_a_gap_in_the_middle_is_an_error_unless_skipped(tmp_path: Path, caplog: Logs) -> None:
    sequence = odometry(tmp_path, (0, 1, 4, 5))
    with pytest.raises(DataError, check=has_code("gaps", sequence / "velodyne/000002.bin", 2)):
        open_dataset(sequence)
    dataset = open_dataset(sequence, gaps="skip")
    assert dataset.numbers.tolist() == [0, 1, 4, 5] and dataset.gaps == [2, 3]
    assert dataset.poses[:, 0, 3].tolist() == [0, 1, 4, 5]
    assert "velodyne/000002.bin" in caplog.text
    whole = odometry(tmp_path / "whole")
    hole = whole / "image_3/000005.png"
    hole.unlink()  # a gap only for those who need it
    with pytest.raises(DataError, check=has_code("gaps", hole, 1)):
        open_dataset(whole)
    assert len(open_dataset(whole, sensors=("points", "left"))) == 6


def test_sensors_that_never_meet_and_names_that_do_not_count_are_refused(tmp_path: Path) -> None:
    apart = folder(tmp_path / "apart")
    for number in (0, 1, 2):
        (apart / f"images/00{number}.png").rename(apart / f"images/00{number + 3}.png")
    with pytest.raises(DataError, check=has_code("no-frames", "points", "left")):
        open_dataset(apart, gaps="skip")
    for name in ("0000000001", "1317354879229752000"):
        put_scan(tmp_path / f"uncounted/velodyne/{name}.bin")
    with pytest.raises(DataError, check=has_code("no-frame-numbers")):
        open_dataset(tmp_path / "uncounted", gaps="skip")


@rows("make", [odometry, raw_drive, folder])
def test_poses_of_another_drive_are_refused_by_their_number(make: Make, tmp_path: Path) -> None:
    root = make(tmp_path / "drive")
    count = len(open_dataset(root))
    if make is folder:
        put_text(root / "times.txt", "".join(f"{n}\n" for n in range(count)))
    given = tmp_path / "other.txt"
    put_text(given, pose_lines(9))
    with refuses("other-drive", str(given), "9", str(count)):
        open_dataset(root, poses=given)
    put_text(given, pose_lines(count))
    assert len(open_dataset(root, poses=given)) == count


def test_poses_fit_the_frames_that_are_here_or_all_that_were_recorded(tmp_path: Path) -> None:
    odometry(tmp_path, range(4))
    given = tmp_path / "given.txt"
    for lines in (4, 6):  # times.txt has 6
        put_text(given, pose_lines(lines))
        assert open_dataset(tmp_path, poses=given).poses[:, 0, 3].tolist() == [0, 1, 2, 3]
    put_text(given, pose_lines(5))
    with refuses("other-drive", str(given), "5", "6"):
        open_dataset(tmp_path, poses=given)


def test_lines_beyond_the_frames_are_logged(tmp_path: Path, caplog: Logs) -> None:
    sequence = odometry(tmp_path)
    put_text(tmp_path / "poses/03.txt", pose_lines(9))
    assert open_dataset(tmp_path).poses[:, 0, 3].tolist() == [0, 1, 2, 3, 4, 5]
    (sequence / "times.txt").unlink()
    open_dataset(tmp_path, poses=tmp_path / "poses/03.txt")
    # Beside the data, not named; and named.
    assert [record.args[1] for record in caplog.records if len(record.args) > 1] == [9, 9]


def test_scans_without_tr_are_an_error_and_not_left_out_for_stereo(tmp_path: Path) -> None:
    calib = odometry(tmp_path) / "calib.txt"
    put_text(calib, calib.read_text().replace("Tr:", "No:"))
    recording = Recording.at(calib.parent)
    for act in (recording.open, recording.sources):
        with pytest.raises(DataError, check=has_code("calibration-key", calib, "Tr")) as error:
            act()
    assert "--source stereo" in str(error.value)
    assert recording.open("stereo").sensors == ("left", "right")


def test_opening_reads_no_scan_and_no_image(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    (sequence / "velodyne/000005.bin").write_bytes(b"123")
    (sequence / "image_2/000005.png").write_bytes(b"")
    frames = list(open_dataset(sequence))
    assert len(frames[4].points) == 20
    with pytest.raises(DataError, match=r"000005\.bin .*\b3\b.*\b16\b"):
        _ = frames[5].points
    with pytest.raises(DataError, check=has_code("damaged-file", sequence / "image_2/000005.png")):
        _ = frames[5].images["left"]


@rows(
    "key, text, message",
    [
        ("P2", None, "P2"),
        ("Tr", None, "Tr"),
        ("P2", "1 2 3", "P2 .*3.*12"),
        ("P3", P3.replace("700", "seven"), "P3"),
        ("P2", P2.replace("700", "nan"), "projection"),
        ("Tr", " ".join(["0"] * 12), "rectified_from_points"),
    ],
)
def test_a_wrong_calib_txt_is_named(
    tmp_path: Path, key: str, text: str | None, message: str
) -> None:
    sequence = odometry(tmp_path)
    lines = [line for line in ODOMETRY_CALIB.splitlines() if not line.startswith(key)]
    put_text(sequence / "calib.txt", "\n".join(lines + ([f"{key}: {text}"] if text else [])))
    with pytest.raises(DataError, match=message) as error:
        open_dataset(sequence)
    assert str(sequence / "calib.txt") in str(error.value)


@rows(
    "file, text, message",
    [
        ("poses.txt", POSE_LINE * 5, "5 .*frame 5 .*6"),
        ("poses.txt", "1 2 3\n" * 6, "3 columns"),
        ("poses.txt", "1 0 0 x 0 1 0 0 0 0 1 0\n" * 6, "line 1: "),
        ("poses.txt", "1 0 0 nan 0 1 0 0 0 0 1 0\n" * 6, "line 1: "),
        ("poses.txt", "0 0 0 0 0 0 0 0\n" * 6, "line 1: .*quaternion"),
        ("poses.txt", "", "empty"),
        ("times.txt", "0.0\n0.1\n", "2 .*frame 5 .*6"),
        ("times.txt", "0.0\nlate\n", "seconds"),
        ("times.txt", "0 1\n0 1\n", "2 columns"),
        ("times.txt", "1e99\n" * 6, "64 bits"),
    ],
)
def test_wrong_poses_and_times_are_named(
    tmp_path: Path, file: str, text: str, message: str
) -> None:
    sequence = odometry(tmp_path)
    put_text(sequence / file, text.replace("{}", "0"))
    with pytest.raises(DataError, match=message) as error:
        open_dataset(sequence)
    assert str(sequence / file) in str(error.value)


@rows("step, unit", [(0.1, ""), (9.0, ""), (100, "milliseconds"), (1e5, "micro"), (5e7, "nano")])
def test_times_in_another_unit_than_seconds_are_told(
    tmp_path: Path, step: float, unit: str, caplog: pytest.LogCaptureFixture
) -> None:
    sequence = odometry(tmp_path)
    put_text(sequence / "times.txt", "".join(f"{n * step}\n" for n in range(6)))
    assert np.ptp(open_dataset(sequence).stamps_ns) == 5 * round(step * 1e9)
    said = [each for each in caplog.messages if str(sequence / "times.txt") in each]
    assert [unit in each for each in said] == [True] * bool(unit)


def test_images_of_another_size_than_the_calibration_or_the_left_are_refused(
    tmp_path: Path,
) -> None:
    drive, sequence = raw_drive(tmp_path / "raw"), odometry(tmp_path)
    left, right = drive / "image_02/data/0000000001.png", sequence / "image_3/000002.png"
    put_image(left, (5, 3))
    with pytest.raises(DataError, check=has_code("image-size", left)):
        _ = open_dataset(drive)[1].images["left"]
    put_image(right, (4, 4))
    with pytest.raises(DataError, check=has_code("image-size", right)):
        _ = open_dataset(sequence)[2].images["right"]


def test_what_is_no_dataset_is_named_with_what_was_looked_for(tmp_path: Path) -> None:
    put_text(tmp_path / "notes.txt", "nothing")
    for path, code in (
        (tmp_path / "nowhere", "missing-file"),
        (tmp_path / "notes.txt", "no-recording"),
        (tmp_path, "no-recording"),
    ):
        with pytest.raises(DataError, check=has_code(code, path)):
            open_dataset(path)
    odometry(tmp_path / "dataset")
    near, check = rf"but {tmp_path}/dataset is one", has_code("no-recording")
    with pytest.raises(DataError, match=near, check=check):
        open_dataset(tmp_path)
    (tmp_path / "velodyne").mkdir()
    for kind in (None, "folder"):
        with pytest.raises(DataError, check=has_code("no-frames")):
            open_dataset(tmp_path, kind=kind)


def test_wrong_arguments_are_named(tmp_path: Path) -> None:
    sequence = odometry(tmp_path)
    for arguments, message in (
        ({"kind": "kiti"}, "kind .*'kiti'.* kitti-object"),
        ({"gaps": "ignore"}, "gaps .*'ignore'.* error, skip"),
        ({"sensors": ()}, "sensors .*''.* points, left, right"),
        ({"sensors": ("radar",)}, "sensors .*'radar'.* points, left, right"),
    ):
        with pytest.raises(ConfigError, match=message):
            open_dataset(sequence, **arguments)
    assert open_dataset(sequence, sensors="left").sensors == ("left",)
    with pytest.raises(DataError, check=has_code("no-sequence", "03")):
        open_dataset(sequence, sequence="05")
    (tmp_path / "other/velodyne").mkdir(parents=True)
    put_scan(tmp_path / "other/velodyne/000000.bin")
    with pytest.raises(DataError, check=has_code("missing-sensor", "left")):
        open_dataset(tmp_path / "other", sensors=("left",))


@rows("folder", ["velodyne", "image_2", "."])
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
    with pytest.raises(DataError, check=has_code("unreadable", hidden)):
        open_dataset(root, kind=kind)


@rows("sequence", [None, 3, "3", "03", "003"])
def test_a_sequence_is_opened_by_folder_or_root(tmp_path: Path, sequence: int | str | None) -> None:
    root = odometry(tmp_path)
    for path in (root, tmp_path):
        dataset = open_dataset(path, sequence=sequence)
        assert dataset.root == root and len(dataset) == 6
        assert dataset.poses[5, 0, 3] == 5 and dataset.stamps_ns[5] == 500_000_000
        assert [frame.index for frame in dataset] == list(range(6))
    with pytest.raises(DataError, check=has_code("no-sequence", "03")):
        open_dataset(tmp_path, sequence=77)


def test_a_recording_that_belongs_to_somebody_else_is_named(tmp_path: Path) -> None:
    root, user = odometry(tmp_path), os.geteuid()
    root.chmod(0)
    try:
        if user == 0:
            os.seteuid(65534)  # nobody: root may read everything
        with pytest.raises(DataError, check=has_code("unreadable")):
            open_dataset(root)
    finally:
        os.seteuid(user)
        root.chmod(0o755)


@rows("name", ["x", "x.npz", "x.bag", "x.mcap", "x.db3", "x.glb"])
def test_a_pipe_or_device_is_no_recording(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    for opened in (open_dataset, lambda path: Recording.at(path).open(), open_bag):
        with pytest.raises(DataError, check=has_code("not-a-file", tmp_path / name)):
            opened(tmp_path / name)
    assert error_of(1, "info", tmp_path / name).code == "not-a-file"
    with pytest.raises(DataError, check=has_code("not-a-file", "/dev/zero")):
        open_dataset("/dev/zero")


@rows("file", ["clouds/000.ply", "images/000.png", "poses.txt", "calib.yaml"])
def test_a_pipe_or_device_among_the_files_is_named(tmp_path: Path, file: str) -> None:
    folder(tmp_path)
    (tmp_path / file).unlink(missing_ok=True)
    os.mkfifo(tmp_path / file)
    with pytest.raises(DataError, check=has_code("not-a-file", tmp_path / file)):
        frame = open_dataset(tmp_path)[0]
        assert frame.points is not None and frame.images["left"] is not None
