# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The readers of MulRan and NCLT, whose scans are named by their stamps, against made folders."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cli import succeeds
from fusionslam.datasets import open_dataset
from fusionslam.datasets.streams import MissingSensorError
from kitti import POINTS, pose_lines, put_text
from public_data import MULRAN_STAMP, NCLT_STAMP, NCLT_STEPS, matrix_row, mulran, nclt
from refusals import refuses
from rows import rows


def test_a_mulran_scan_has_its_stamp_to_the_nanosecond_and_its_points(tmp_path: Path) -> None:
    dataset = open_dataset(mulran(tmp_path), without_pose="keep")
    assert (dataset.kind, dataset.name, len(dataset)) == ("mulran", "MulRan KAIST01", 4)
    stamps = [MULRAN_STAMP + frame * 100_000_000 for frame in range(4)]
    assert dataset.stamps_ns.tolist() == stamps and dataset.recorded == 4
    assert np.array_equal(dataset[3].points, POINTS)


def test_mulran_poses_are_interpolated_within_the_recorded_span_only(tmp_path: Path) -> None:
    """Poses run from 0.05 s to 0.25 s after the first scan: scans 1 and 2 are within."""
    sequence = mulran(tmp_path)
    kept = open_dataset(sequence, without_pose="keep")
    assert np.isfinite(kept.poses).all(axis=(1, 2)).tolist() == [False, True, True, False]
    np.testing.assert_allclose(kept.poses[1:3, 0, 3], [353_001, 353_002], atol=1e-9)
    dataset = open_dataset(sequence)
    assert dataset.numbers.tolist() == [1, 2]
    # As published, the scanner faces backwards: 1.7042 m ahead, -0.021 m left, 1.8047 m up.
    ahead = dataset.body_from_points @ [1, 0, 0, 1]
    np.testing.assert_allclose(ahead, [0.7042, -0.021 + 0.00584, 1.8047, 1], atol=1e-4)
    np.testing.assert_allclose(dataset.body_from_robot, np.eye(4), atol=1e-12)


def test_mulran_poses_between_two_rows_turn_half_way(tmp_path: Path) -> None:
    sequence = mulran(tmp_path)
    rows = []
    for seconds, yaw in ((0.05, 0.2), (0.15, 0.6), (0.35, 0.6)):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
        pose[:3, 3] = 10 * seconds, 0, 0
        rows.append(matrix_row(MULRAN_STAMP + int(seconds * 1e9), pose))
    put_text(sequence / "global_pose.csv", "".join(rows))
    first, second, third = open_dataset(sequence).poses
    np.testing.assert_allclose(first[:3, :3], Rotation.from_euler("z", 0.4).as_matrix(), atol=1e-9)
    np.testing.assert_allclose([first[0, 3], second[0, 3], third[0, 3]], [1, 2, 3], atol=1e-6)


@rows("gap_s, known", [(0.5, 4), (0.6, 2)])
def test_no_pose_is_interpolated_across_more_than_half_a_second(
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
def test_a_cut_scan_is_refused_when_it_is_read(
    make: Callable[[Path], Path], size: int, tmp_path: Path
) -> None:
    root = make(tmp_path)
    path = max(root.rglob("*.bin"))
    path.write_bytes(path.read_bytes()[: size + 3])
    dataset = open_dataset(root, without_pose="keep")
    with refuses("truncated", str(path)):
        _ = dataset[-1].points
    path.write_bytes(b"")
    assert open_dataset(root, without_pose="keep")[-1].points.shape == (0, 3)


@rows("make", [mulran, nclt])
def test_scans_without_poses_open_and_have_no_images(
    make: Callable[[Path], Path], tmp_path: Path
) -> None:
    root = make(tmp_path)
    text = " ".join(succeeds("info", root).stdout.split())
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
    make: Callable[[Path], Path], damage: Callable[[str], str], tmp_path: Path
) -> None:
    root = make(tmp_path)
    path = next(root.glob("*.csv"))
    lines = path.read_text().splitlines(keepends=True)
    lines[3] = damage(lines[3])
    put_text(path, "".join(lines))
    with refuses("damaged-file", str(path), "4"):
        open_dataset(root)


@rows("make", [mulran, nclt])
def test_poses_of_another_time_are_refused(make: Callable[[Path], Path], tmp_path: Path) -> None:
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
