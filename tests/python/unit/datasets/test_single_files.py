# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Single files: clouds, images, times and poses, whole and broken."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

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
from kitti import COLORS, POINTS, RNG, put_text


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
    with pytest.raises(DataError, match=rf"cloud{suffix}"):
        read_cloud(path)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd_files_of_every_encoding_are_read(tmp_path: Path, encoding: str) -> None:
    from pypcd4.pypcd4 import Encoding, PointCloud

    cloud = PointCloud.from_xyzi_points(np.c_[POINTS, POINTS[:, 0]])
    cloud.save(tmp_path / "cloud.pcd", Encoding(encoding))
    assert np.allclose(read_cloud(tmp_path / "cloud.pcd").points, POINTS, atol=1e-6)
    assert np.allclose(read_cloud(tmp_path / "cloud.pcd").intensities, POINTS[:, 0], atol=1e-6)
    (tmp_path / "cloud.pcd").write_bytes((tmp_path / "cloud.pcd").read_bytes()[:-30])
    with pytest.raises(DataError, match=r"cloud.pcd"):
        read_cloud(tmp_path / "cloud.pcd")


def test_a_bin_file_keeps_intensities(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    intensities = RNG.uniform(0, 1, len(POINTS)).astype(np.float32)
    write_cloud(path, Cloud(POINTS, None, intensities))
    assert np.array_equal(np.fromfile(path, "<f4").reshape(-1, 4)[:, 3], intensities)
    assert np.array_equal(read_cloud(path).intensities, intensities)
    with pytest.raises(ShapeError, match=r"intensities have shape \(3,\)"):
        write_cloud(path, Cloud(POINTS, None, intensities[:3]))


@pytest.mark.parametrize("kind", ["uchar", "float", "double"])
def test_intensities_of_a_ply_file_are_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.ply"
    header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
    header += f"property float z\nproperty {kind} intensity\nend_header\n"
    path.write_text(header + "1 2 3 40\n4 5 6 200\n")
    found = read_cloud(path).intensities
    assert found is not None and found.dtype == np.float32 and found.tolist() == [40, 200]


@pytest.mark.parametrize("suffix", [".pcd", ".ply"])
@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize(
    ("names", "code", "read"),
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
    rows = np.zeros(20, fields)
    for name, column in zip(names.split(), [*POINTS.T, *COLORS.T], strict=True):
        rows[name] = column
    if suffix == ".ply":
        kinds = ["float"] * 3 + [{"u1": "uchar", "f4": "float"}[code]] * 3
        header = f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\n"
        header += "element vertex 20\n" + "".join(
            f"property {kind} {name}\n" for kind, name in zip(kinds, names.split(), strict=True)
        )
        header += "end_header\n"
    else:
        header = f"VERSION 0.7\nFIELDS {names}\nSIZE 4 4 4{f' {code[1]}' * 3}\n"
        header += f"TYPE F F F{f' {code[0].upper()}' * 3}\nCOUNT 1 1 1 1 1 1\nWIDTH 20\nHEIGHT 1\n"
        header += f"POINTS 20\nDATA {'binary' if binary else 'ascii'}\n"
    text = "".join(" ".join(map(str, row)) + "\n" for row in rows.tolist())
    path.write_bytes(header.encode() + (rows.tobytes() if binary else text.encode()))
    cloud = read_cloud(path)
    assert np.allclose(cloud.points, POINTS)
    if read:
        assert cloud.colors.dtype == np.uint8 and np.array_equal(cloud.colors, COLORS)
    else:
        assert cloud.colors is None


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("lost", [1, 13, 121])
def test_a_pcd_that_is_cut_is_called_truncated(tmp_path: Path, encoding: str, lost: int) -> None:
    from pypcd4.pypcd4 import Encoding, PointCloud

    path = tmp_path / "a.pcd"
    # lzf compresses nothing random.
    points = np.repeat(POINTS, 5, axis=0)
    PointCloud.from_xyz_points(points).save(path, Encoding(encoding))
    assert f"DATA {encoding}\n".encode() in path.read_bytes()
    # Of the text, the end of a line, some of its columns, and some lines.
    path.write_bytes(path.read_bytes()[: -lost - (15 if encoding == "ascii" else 0)])
    with pytest.raises(DataError, check=has_code("truncated", path)):
        read_cloud(path)


def test_a_pcd_with_more_points_than_stated_is_refused_as_such(tmp_path: Path) -> None:
    from pypcd4.pypcd4 import Encoding, PointCloud

    path = tmp_path / "a.pcd"
    PointCloud.from_xyz_points(POINTS).save(path, Encoding.ASCII)
    path.write_text(path.read_text().replace("POINTS 20", "POINTS 19"))
    with pytest.raises(DataError, match=r"\b20\b.*\b19\b", check=has_code("more-points", path)):
        read_cloud(path)


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
    with pytest.raises(DataError, match=r"a\.ply .*\b1\b.*\b2\b"):
        read_cloud(tmp_path / "a.ply")
    put_text(tmp_path / "a.ply", header.replace("uchar", "float") + "1 2 3 1 0 0\n" * 2)
    with pytest.raises(DataError, match=r"a\.ply .*float32"):
        read_cloud(tmp_path / "a.ply")


def test_an_empty_scan_is_a_cloud_without_points(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"")
    assert read_bin(tmp_path / "a.bin").points.shape == (0, 3)


def test_a_cloud_of_another_shape_or_suffix_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"a\.las "):
        write_cloud(tmp_path / "a.las", Cloud(POINTS))
    with pytest.raises(ShapeError, match=r"points .*\(20, 2\)"):
        write_cloud(tmp_path / "a.ply", Cloud(POINTS[:, :2]))
    with pytest.raises(ShapeError, match=r"colors .*\(19, 3\)"):
        write_cloud(tmp_path / "a.ply", Cloud(POINTS, COLORS[1:]))
    assert not list(tmp_path.iterdir())


def test_images_are_grey_or_rgb_and_8_bit(tmp_path: Path) -> None:
    for mode, shape in (("L", (3, 4)), ("RGB", (3, 4, 3)), ("RGBA", (3, 4, 3)), ("P", (3, 4, 3))):
        Image.new(mode, (4, 3)).save(tmp_path / "a.png")
        image = read_image(tmp_path / "a.png")
        assert image.shape == shape and image.dtype == np.uint8
    Image.new("I;16", (4, 3)).save(tmp_path / "a.png")
    with pytest.raises(DataError, match=r"a\.png: .*I;16"):
        read_image(tmp_path / "a.png")


def test_a_truncated_image_is_named(tmp_path: Path) -> None:
    noise = RNG.integers(0, 256, (64, 64, 3), dtype=np.uint8)
    for name in ("a.png", "a.jpg"):
        Image.fromarray(noise).save(tmp_path / name)
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) // 2])
        with pytest.raises(DataError, check=has_code("damaged-file", tmp_path / name)):
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
        with pytest.raises(DataError, check=has_code("missing-file", tmp_path / name)):
            read(tmp_path / name)


def test_times_are_exact_nanoseconds(tmp_path: Path) -> None:
    put_text(tmp_path / "times.txt", "1.037359e-01\n1317354879.229752001\n")
    assert read_times(tmp_path / "times.txt").tolist() == [103_735_900, 1_317_354_879_229_752_001]


@pytest.mark.parametrize("text", ["2011-09-26 13:02\n\n2011-09-26 13:03\n", "noon\n", ""])
def test_wrong_timestamps_are_named(tmp_path: Path, text: str) -> None:
    put_text(tmp_path / "timestamps.txt", text)
    with pytest.raises(DataError, match=r"timestamps\.txt"):
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
    with pytest.raises(ShapeError, match=r"\(2, 4, 4\)"):
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


def test_poses_at_half_the_rate_of_the_frames_are_interpolated(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
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


def test_frames_just_outside_of_the_poses_have_none_and_are_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
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


@pytest.mark.parametrize("bad", ["1,2,3,4,5,6,7,8", "1 2 3 4 5 6 7", "1 2 3 4 5 6 7 eight"])
def test_a_line_that_is_no_row_of_poses_is_named(tmp_path: Path, bad: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(f"# t x\n1 0 0 0 0 0 0 1\n{bad}\n")
    with pytest.raises(DataError, match="line 3", check=has_code("damaged-file", path)):
        read_poses(path)


@pytest.mark.parametrize(
    "row",
    ["2 0 0 0 0 2 0 0 0 0 2 0", "1 0 0 0 0 1 0 0 0 0 -1 0", "1 0.2 0 5 0 1 0 5 0 0 1 5"],
    ids=["scaled", "mirrored", "sheared"],
)
def test_poses_that_are_no_rotation_are_named_with_their_line(tmp_path: Path, row: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(f"1 0 0 0 0 1 0 0 0 0 1 0\n# comment\n{row}\n")
    with pytest.raises(DataError, check=has_code("not-a-rotation", path, 3)):
        read_poses(path)


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
@pytest.mark.parametrize("kept", [0, 1, 3, 20, 60, 100])
def test_a_header_that_is_cut_is_named_in_plain_words(
    tmp_path: Path, suffix: str, kept: int
) -> None:
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, Cloud(POINTS, COLORS))
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(DataError, check=has_code("bad-header", path)) as caught:
        read_cloud(path)
    assert type(caught.value.__cause__) is DataError  # not one of the library that reads it


def test_a_pcd_without_fields_is_refused_in_our_words(tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    write_cloud(path, Cloud(np.ones((5, 3), np.float32)))
    path.write_bytes(path.read_bytes().replace(b"FIELDS", b"FYELDS"))
    with pytest.raises(DataError, check=has_code("damaged-file", path)) as refused:
        read_cloud(path)
    assert "fields" in str(refused.value) and "\n" not in str(refused.value)
    assert "pydantic" not in str(refused.value) and "type=" not in str(refused.value)


def test_bin_files_of_other_columns_are_read_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    five = np.random.default_rng(0).uniform(-9, 9, (40, 5)).astype(np.float32)
    five[:, 3:] = 1
    for rows, warned in ((five, True), (five[:, :4], False)):
        caplog.clear()
        rows.tofile(tmp_path / "a.bin")
        read_bin(tmp_path / "a.bin")
        assert [str(tmp_path / "a.bin") in record.message for record in caplog.records] == (
            [True] if warned else []
        )
