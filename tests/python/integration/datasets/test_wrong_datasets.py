# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the readers say about recordings that are wrong."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from cli import error_of
from error_codes import has_code
from fusionslam.datasets import open_bag, open_dataset
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.recording import Recording
from kitti import (
    ODOMETRY_CALIB,
    P2,
    P3,
    POSE_LINE,
    folder,
    odometry,
    put_image,
    put_scan,
    put_text,
    raw_drive,
)
from rows import rows


def test_the_recording_in_a_folder_that_is_none_is_named(tmp_path: Path) -> None:
    odometry(tmp_path / "dataset")
    with pytest.raises(DataError, match=rf"but {tmp_path}/dataset is one") as error:
        open_dataset(tmp_path)
    assert error.value.code == "no-recording"


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
def test_a_wrong_calib_txt_is_named_with_the_key(
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


@rows("sequence", [3, "3", "03", "003"])
def test_a_sequence_may_be_named_by_its_number(tmp_path: Path, sequence: int | str) -> None:
    root = odometry(tmp_path)
    number = int(root.name)
    wanted = str(sequence).replace("3", str(number)) if isinstance(sequence, str) else number
    assert open_dataset(root.parent.parent, sequence=wanted).root == root
    assert open_dataset(root, sequence=wanted).root == root
    with pytest.raises(DataError, check=has_code("no-sequence", root.name)):
        open_dataset(root.parent.parent, sequence=77)


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
