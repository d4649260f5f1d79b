# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Single files: clouds, images, times and poses, whole and broken."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pypcd4.pypcd4 import Encoding, PointCloud
from scipy.spatial.transform import Rotation

from error_codes import has_code
from fusionslam.datasets import (
    match_poses,
    read_bin,
    read_cloud,
    read_image,
    read_poses,
    read_poses_tum,
    read_times,
    read_timestamps,
    write_cloud,
    write_poses_tum,
)
from fusionslam.errors import DataError, ShapeError
from fusionslam.sensors.frame import Cloud
from kitti import COLORS, POINTS, put_text
from rows import rows

Logs = pytest.LogCaptureFixture

Read = Callable[[Path], object]


@rows("suffix", [".ply", ".pcd", ".bin"])
@rows("count", [0, 1, 20])
@rows("colored", [True, False])
def test_clouds_come_back_as_written(
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


@rows("suffix", [".ply", ".pcd", ".bin"])
@rows("kept", [0.02, 0.5, 0.999])
def test_truncated_clouds_are_named(tmp_path: Path, suffix: str, kept: float) -> None:
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, Cloud(POINTS, COLORS))
    data = path.read_bytes()
    path.write_bytes(data[: min(int(len(data) * kept) | 1, len(data) - 1)])
    with pytest.raises(DataError, match=rf"cloud{suffix}"):
        read_cloud(path)


@rows("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd_files_of_every_encoding_are_read(tmp_path: Path, encoding: str) -> None:
    stored = PointCloud.from_xyzi_points(np.c_[POINTS, POINTS[:, 0]])
    stored.save(tmp_path / "cloud.pcd", Encoding(encoding))
    cloud = read_cloud(tmp_path / "cloud.pcd")
    assert np.allclose(cloud.points, POINTS, atol=1e-6)
    assert np.allclose(cloud.intensities, POINTS[:, 0], atol=1e-6)


@rows("suffix", [".npy", ".npz", ".ply", ".pcd"])
def test_a_bin_file_that_is_of_another_kind_is_called_so(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / "cloud.bin"
    other = path.with_suffix(suffix)
    if suffix == ".npy":
        np.save(other, POINTS)
    elif suffix == ".npz":
        np.savez(other, points=POINTS)
    else:
        write_cloud(other, Cloud(POINTS))
    other.rename(path)
    with pytest.raises(DataError, match=rf"{suffix}\)", check=has_code("bad-header")):
        read_cloud(path)


def test_a_bin_file_keeps_intensities(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    intensities = np.random.default_rng(8).uniform(0, 1, len(POINTS)).astype(np.float32)
    write_cloud(path, Cloud(POINTS, None, intensities))
    assert np.array_equal(np.fromfile(path, "<f4").reshape(-1, 4)[:, 3], intensities)
    assert np.array_equal(read_cloud(path).intensities, intensities)
    with pytest.raises(ShapeError, match=r"intensities have shape \(3,\)"):
        write_cloud(path, Cloud(POINTS, None, intensities[:3]))


def ply_header(encoding: str, count: int, properties: Iterable[str]) -> str:
    lines = "".join(f"property {each}\n" for each in properties)
    return f"ply\nformat {encoding} 1.0\nelement vertex {count}\n{lines}end_header\n"


@rows("kind", ["uchar", "float", "double"])
def test_intensities_of_a_ply_file_are_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.ply"
    header = ply_header("ascii", 2, ("float x", "float y", "float z", f"{kind} intensity"))
    path.write_text(header + "1 2 3 40\n4 5 6 200\n")
    found = read_cloud(path).intensities
    assert found is not None and found.dtype == np.float32 and found.tolist() == [40, 200]


@rows("suffix", [".pcd", ".ply"])
@rows("binary", [False, True])
@rows(
    "names, code, read",
    [
        ("red green blue", "u1", True),
        ("r g b", "u1", True),
        ("diffuse_red diffuse_green diffuse_blue", "u1", True),
        ("r g b", "f4", False),
        ("r g c", "u1", False),
    ],
)
def test_separate_colours_of_8_bits_are_read(
    tmp_path: Path, suffix: str, binary: bool, names: str, code: str, read: bool
) -> None:
    path, names = tmp_path / f"a{suffix}", f"x y z {names}"
    fields = [(name, "<f4" if k < 3 else code) for k, name in enumerate(names.split())]
    table = np.zeros(20, fields)
    for name, column in zip(names.split(), [*POINTS.T, *COLORS.T], strict=True):
        table[name] = column
    if suffix == ".ply":
        kinds = ["float"] * 3 + [{"u1": "uchar", "f4": "float"}[code]] * 3
        encoding = "binary_little_endian" if binary else "ascii"
        header = ply_header(encoding, 20, map(" ".join, zip(kinds, names.split(), strict=True)))
    else:
        header = f"VERSION 0.7\nFIELDS {names}\nSIZE 4 4 4{f' {code[1]}' * 3}\n"
        header += f"TYPE F F F{f' {code[0].upper()}' * 3}\nCOUNT 1 1 1 1 1 1\nWIDTH 20\nHEIGHT 1\n"
        header += f"POINTS 20\nDATA {'binary' if binary else 'ascii'}\n"
    text = "".join(" ".join(map(str, row)) + "\n" for row in table.tolist())
    path.write_bytes(header.encode() + (table.tobytes() if binary else text.encode()))
    cloud = read_cloud(path)
    assert np.allclose(cloud.points, POINTS)
    if read:
        assert cloud.colors.dtype == np.uint8 and np.array_equal(cloud.colors, COLORS)
    else:
        assert cloud.colors is None


@rows("encoding", ["ascii", "binary", "binary_compressed"])
@rows("lost", [1, 13, 121])
def test_a_pcd_that_is_cut_is_called_truncated(tmp_path: Path, encoding: str, lost: int) -> None:
    path = tmp_path / "a.pcd"
    # lzf compresses nothing random.
    points = np.repeat(POINTS, 5, axis=0)
    PointCloud.from_xyz_points(points).save(path, Encoding(encoding))
    assert f"DATA {encoding}\n".encode() in path.read_bytes()
    # Of the text, the end of a line, some of its columns, and some lines.
    path.write_bytes(path.read_bytes()[: -lost - (15 if encoding == "ascii" else 0)])
    with pytest.raises(DataError, check=has_code("truncated", path)):
        read_cloud(path)


def test_rays_without_return_in_a_pcd_are_left_out(tmp_path: Path) -> None:
    points = POINTS.copy()
    points[3] = np.nan
    write_cloud(tmp_path / "cloud.pcd", Cloud(points, COLORS))
    cloud = read_cloud(tmp_path / "cloud.pcd")
    assert np.array_equal(cloud.points, np.delete(POINTS, 3, axis=0))
    assert np.array_equal(cloud.colors, np.delete(COLORS, 3, axis=0))


def test_ascii_ply_is_read_and_must_be_complete(tmp_path: Path) -> None:
    names = ("double x", "double y", "double z", "uchar red", "uchar green", "uchar blue")
    header = ply_header("ascii", 2, names)
    put_text(tmp_path / "a.ply", header + "1 2 3 255 0 7\n4 5 6 1 2 3\n")
    cloud = read_cloud(tmp_path / "a.ply")
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.colors.tolist() == [[255, 0, 7], [1, 2, 3]]
    put_text(tmp_path / "a.ply", header + "1 2 3 255 0 7\n")
    with pytest.raises(DataError, match=r"a\.ply .*\b1\b.*\b2\b"):
        read_cloud(tmp_path / "a.ply")
    put_text(tmp_path / "a.ply", header.replace("uchar", "float") + "1 2 3 1 0 0\n" * 2)
    with pytest.raises(DataError, match=r"a\.ply .*float32"):
        read_cloud(tmp_path / "a.ply")


def test_a_cloud_of_another_shape_or_suffix_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"a\.las "):
        write_cloud(tmp_path / "a.las", Cloud(POINTS))
    with pytest.raises(ShapeError, match=r"points .*\(20, 2\)"):
        write_cloud(tmp_path / "a.ply", Cloud(POINTS[:, :2]))
    with pytest.raises(ShapeError, match=r"colors .*\(19, 3\)"):
        write_cloud(tmp_path / "a.ply", Cloud(POINTS, COLORS[1:]))
    assert not list(tmp_path.iterdir())


def test_images_are_grey_or_rgb_and_8_bit(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    for mode, shape in (("L", (3, 4)), ("RGB", (3, 4, 3)), ("RGBA", (3, 4, 3)), ("P", (3, 4, 3))):
        Image.new(mode, (4, 3)).save(path)
        image = read_image(path)
        assert image.shape == shape and image.dtype == np.uint8
    Image.new("I;16", (4, 3)).save(path)
    with pytest.raises(DataError, match=r"a\.png: .*I;16"):
        read_image(path)


def test_a_truncated_image_is_named(tmp_path: Path) -> None:
    noise = np.random.default_rng(9).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    for name in ("a.png", "a.jpg"):
        Image.fromarray(noise).save(tmp_path / name)
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) // 2])
        with pytest.raises(DataError, check=has_code("damaged-file", tmp_path / name)):
            read_image(tmp_path / name)


@rows(
    "read, name",
    [(read_cloud, "a.bin"), (read_cloud, "a.pcd"), (read_cloud, "a.ply"), (read_image, "a.png")]
    + [(read, "a.txt") for read in (read_poses, read_times, read_timestamps)],
)
def test_a_file_that_is_not_there_is_named(tmp_path: Path, read: Read, name: str) -> None:
    with pytest.raises(DataError, check=has_code("missing-file", tmp_path / name)):
        read(tmp_path / name)


def test_tum_poses_come_back_as_written_and_times_are_exact_nanoseconds(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    stamps = np.append(np.sort(rng.integers(1, 2**62, 300)), 2**62)
    poses = np.tile(np.eye(4), (len(stamps), 1, 1))
    poses[:, :3, :3] = Rotation.random(len(stamps), rng=rng).as_matrix()
    poses[:, :3, 3] = rng.uniform(-1e6, 1e6, (len(stamps), 3)) * [[1, 1e-9, 0]]
    write_poses_tum(tmp_path / "poses.txt", stamps, poses)
    found, read = read_poses_tum(tmp_path / "poses.txt")
    assert np.array_equal(found, stamps) and np.array_equal(read[:, :3, 3], poses[:, :3, 3])
    assert np.allclose(read, poses, rtol=0, atol=1e-9)
    put_text(tmp_path / "times.txt", "1.037359e-01\n1317354879.229752001\n")
    assert read_times(tmp_path / "times.txt").tolist() == [103_735_900, 1_317_354_879_229_752_001]


def test_tum_quaternions_have_their_real_part_last_and_one_stamp_each(tmp_path: Path) -> None:
    path, half = tmp_path / "poses.txt", np.sqrt(0.5)
    put_text(path, f"0 1 2 3 0 0 {half} {half}\n")
    (pose,) = read_poses_tum(path)[1]
    assert np.allclose(pose, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    with pytest.raises(ShapeError, match=r"\(2, 4, 4\)"):
        write_poses_tum(path, np.zeros(2, dtype=np.int64), pose[None])


def test_the_nearest_pose_is_found_whatever_the_order_of_the_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(10)
    stamps = rng.permutation(100) * 5_000_000
    poses = np.tile(np.eye(4), (100, 1, 1))
    poses[:, 0, 3] = stamps
    write_poses_tum(tmp_path / "poses.txt", stamps, poses)
    wanted = np.sort(rng.integers(0, 99 * 5_000_000, 30))
    found = match_poses(tmp_path / "poses.txt", np.arange(30), wanted)[:, 0, 3]
    brute = stamps[np.abs(stamps[None] - wanted[:, None]).argmin(axis=1)]
    assert np.array_equal(np.abs(found - wanted), np.abs(brute - wanted))


def test_poses_at_half_the_rate_are_interpolated(tmp_path: Path, caplog: Logs) -> None:
    # A constant screw motion along z: 3 degrees and 0.2 m every 0.1 s, poses every 0.2 s.
    stamps = np.arange(11) * 100_000_000
    angles = np.radians(3.0) * np.arange(11)
    poses = np.tile(np.eye(4), (11, 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angles)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(angles), -np.sin(angles)
    poses[:, 2, 3] = 0.2 * np.arange(11)
    path = tmp_path / "poses.txt"
    write_poses_tum(path, stamps[::2], poses[::2])
    np.testing.assert_allclose(
        match_poses(path, np.arange(11), stamps, recorded=11), poses, atol=1e-12
    )
    assert "5 of 11" in caplog.text
    write_poses_tum(path, stamps[::6], poses[::6])
    with pytest.raises(DataError, check=has_code("no-pose", path, 1)):
        match_poses(path, np.arange(10), stamps[:10], recorded=11)


def test_frames_just_outside_of_the_poses_have_none(tmp_path: Path, caplog: Logs) -> None:
    stamps, path = np.arange(12) * 100_000_000, tmp_path / "poses.txt"
    poses = np.tile(np.eye(4), (12, 1, 1))
    write_poses_tum(path, stamps[1::2], poses[1::2])
    found = match_poses(path, np.arange(12), stamps, recorded=12)
    assert np.isfinite(found).all(axis=(1, 2)).tolist() == [False, *[True] * 11]
    assert [record.args[:3] for record in caplog.records] == [(path, 5, 12), (path, 1, 12)]
    for first, last, unknown in ((4, 10, 1), (1, 8, 9)):
        write_poses_tum(path, stamps[first:last:2], poses[first:last:2])
        with pytest.raises(DataError, check=has_code("no-pose", path, unknown)):
            match_poses(path, np.arange(1, 12), stamps[1:], recorded=12)
    write_poses_tum(path, stamps[:4:2], poses[:4:2])
    found = match_poses(path, np.array([2, 3]), stamps[2:4], recorded=12)
    assert np.isfinite(found).all(axis=(1, 2)).tolist() == [True, False]
    with pytest.raises(DataError, check=has_code("no-pose", path, 3)):
        match_poses(path, np.array([3]), stamps[3:4], recorded=12)  # no frame would be left


STANDING = "1 0 0 0 0 1 0 0 0 0 1 0\n# comment\n"
TUM = "# t x\n1 0 0 0 0 0 0 1\n"
DATE = "2011-09-26 13:02:25"
STAMPS = (
    ("1403715273262142976", "nanoseconds"),
    ("1403715273262142", "microseconds"),
    ("1403715273262", "milliseconds"),
)


@rows(
    "read, text, code, line, words",
    [
        (read_poses, TUM + "1,2,3,4,5,6,7,8\n", "damaged-file", None, "line 3"),
        (read_poses, TUM + "1 2 3 4 5 6 7\n", "damaged-file", None, "line 3"),
        (read_poses, TUM + "1 2 3 4 5 6 7 eight\n", "damaged-file", None, "line 3"),
        (read_poses, STANDING + "2 0 0 0 0 2 0 0 0 0 2 0\n", "not-a-rotation", 3, ""),  # scaled
        (read_poses, STANDING + "1 0 0 0 0 1 0 0 0 0 -1 0\n", "not-a-rotation", 3, ""),  # mirrored
        (read_poses, STANDING + "1 0.2 0 5 0 1 0 5 0 0 1 5\n", "not-a-rotation", 3, ""),  # sheared
        (read_timestamps, f"{DATE}\n\n{DATE}\n", "data", None, ""),
        (read_timestamps, "noon\n", "damaged-file", None, ""),
        (read_timestamps, "", "data", None, ""),
        (read_timestamps, f"{DATE}.9\n{DATE}.8\n", "stamps-decrease", 2, ""),
        (read_times, "# seconds\n0.0\n0.1\n0.1\n\n0.05\n", "stamps-decrease", 6, ""),
        *((read_times, f"# EuRoC\n{stamp}\n", "not-seconds", 2, unit) for stamp, unit in STAMPS),
        *(
            (read_poses_tum, f"# EuRoC\n{stamp} 0 0 0 0 0 0 1\n", "not-seconds", 2, unit)
            for stamp, unit in STAMPS
        ),
    ],
)
def test_a_damaged_file_of_poses_or_times_is_named(
    tmp_path: Path, read: Read, text: str, code: str, line: int | None, words: str
) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text)
    fields = (path,) if line is None else (path, line)
    with pytest.raises(DataError, match=words or ".") as refused:
        read(path)
    assert str(path) in str(refused.value)
    assert code == "data" or has_code(code, *fields)(refused.value)


@rows("suffix", [".ply", ".pcd"])
@rows("kept", [0, 1, 3, 20, 60, 100])
def test_a_cut_header_is_named_in_plain_words(tmp_path: Path, suffix: str, kept: int) -> None:
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, Cloud(POINTS, COLORS))
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(DataError, check=has_code("bad-header", path)) as caught:
        read_cloud(path)
    assert type(caught.value.__cause__) is DataError  # not one of the library that reads it


def test_a_pcd_that_contradicts_itself_is_refused_in_our_words(tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    PointCloud.from_xyz_points(POINTS).save(path, Encoding.ASCII)
    text = path.read_text()
    path.write_text(text.replace("POINTS 20", "POINTS 19"))
    with pytest.raises(DataError, match=r"\b20\b.*\b19\b", check=has_code("more-points", path)):
        read_cloud(path)
    path.write_text(text.replace("FIELDS", "FYELDS"))
    with pytest.raises(DataError, match="fields", check=has_code("damaged-file", path)) as refused:
        read_cloud(path)
    assert not any(word in str(refused.value) for word in ("\n", "pydantic", "type="))


@rows("columns, warned", [(5, True), (4, False)])
def test_bin_files_of_other_columns_are_read_with_a_warning(
    tmp_path: Path, caplog: Logs, columns: int, warned: bool
) -> None:
    values = np.random.default_rng(0).uniform(-9, 9, (40, 5)).astype(np.float32)
    values[:, 3:] = 1
    values[:, :columns].tofile(tmp_path / "a.bin")
    read_bin(tmp_path / "a.bin")
    (tmp_path / "b.bin").write_bytes(b"")
    assert read_bin(tmp_path / "b.bin").points.shape == (0, 3)
    assert [str(tmp_path / "a.bin") in text for text in caplog.messages] == [True] * warned
