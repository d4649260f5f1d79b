# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Small data sets in the layouts of KITTI raw's GPS/IMU, SemanticKITTI, KITTI-360, MulRan, NCLT."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitti import CALIB, POINTS, pose_lines, put_image, put_scan, put_text, raw_drive

IMU_TO_VELO = "R: 0 -1 0 1 0 0 0 0 1\nT: -0.8 0.3 -0.8\n"
KITTI_360_DRIVE = "2013_05_28_drive_0003_sync"
PERSPECTIVE = (
    "calib_time: 10-Aug-2021 12:00:00\ncorner_dist: 0.06\n"
    "S_rect_00: 4 3\nR_rect_00: 1 0 0 0 1 0 0 0 1\nP_rect_00: 5 0 2 0 0 5 1.5 0 0 0 1 0\n"
    "S_rect_01: 4 3\nR_rect_01: 1 0 0 0 1 0 0 0 1\nP_rect_01: 5 0 2 -3 0 5 1.5 0 0 0 1 0\n"
)
# Cameras look along the scanner's x axis, which is ahead; the GPS/IMU has y right and z down.
CAM_TO_VELO = "0 0 1 0.8 -1 0 0 0.3 0 -1 0 -0.2\n"
CAM_TO_POSE = "image_00: 0 0 1 1.6 1 0 0 0.1 0 1 0 -0.7\nimage_01: 0 0 1 1.6 1 0 0 0.7 0 1 0 -0.7\n"
MULRAN_STAMP = 1561000444390857630
NCLT_STAMP = 1326030975726043


def oxts_line(
    latitude: float,
    longitude: float,
    altitude: float = 116.0,
    angles: Sequence[float] = (0.0, 0.0, 0.0),
) -> str:
    """A record of KITTI's GPS/IMU: 30 numbers, of which only the first six are used."""
    pose = [latitude, longitude, altitude, *angles]
    return " ".join(f"{value:.17g}" for value in pose) + " 0" * 19 + " 4 11 4 4 0\n"


def raw_drive_with_oxts(root: Path, lines: Mapping[int, str], *, mounted: bool = True) -> Path:
    """A drive of KITTI raw of three frames, with GPS/IMU records by frame number."""
    drive = raw_drive(root)
    for number, line in lines.items():
        put_text(drive / f"oxts/data/{number:010d}.txt", line)
    if mounted:
        put_text(root / "calib_imu_to_velo.txt", f"calib_time: 25-May-2012 16:47:16\n{IMU_TO_VELO}")
    return drive


def semantic_kitti(root: Path) -> Path:
    """Sequence 03 of SemanticKITTI: scans, labels, and poses beside them; KITTI's poses, too."""
    sequence = root / "dataset/sequences/03"
    for number in range(3):
        put_scan(sequence / f"velodyne/{number:06d}.bin")
        label = sequence / f"labels/{number:06d}.label"
        label.parent.mkdir(exist_ok=True)
        np.full(len(POINTS), 40, "<u4").tofile(label)
    put_text(sequence / "calib.txt", CALIB)
    put_text(sequence / "times.txt", "".join(f"{0.1 * n:e}\n" for n in range(3)))
    put_text(sequence / "poses.txt", pose_lines(3, 2))
    put_text(root / "dataset/poses/03.txt", pose_lines(3))
    return sequence


def kitti_360(root: Path, *, posed: Iterable[int] = (1, 2, 4), frames: int = 6) -> Path:
    """A drive of KITTI-360 on its way east, of whose frames only some have poses."""
    scans, images = (root / raw / KITTI_360_DRIVE for raw in ("data_3d_raw", "data_2d_raw"))
    for number in range(frames):
        put_scan(scans / f"velodyne_points/data/{number:010d}.bin")
        for camera, color in ((0, (200, 0, 0)), (1, (0, 200, 0))):
            put_image(images / f"image_{camera:02d}/data_rect/{number:010d}.png", color=color)
        put_image(images / f"image_02/data_rgb/{number:010d}.png")
    stamps = (f"2013-05-28 08:46:02.90448{n}000\n" for n in range(frames))
    put_text(scans / "velodyne_points/timestamps.txt", "".join(stamps))
    # East, south and down in a world of east, north and up: the GPS/IMU faces east.
    lines = (f"{n} 1 0 0 {1000 + n} 0 -1 0 2000 0 0 -1 116 \n" for n in posed)
    put_text(root / "data_poses" / KITTI_360_DRIVE / "poses.txt", "".join(lines))
    put_text(root / "calibration/perspective.txt", PERSPECTIVE)
    put_text(root / "calibration/calib_cam_to_velo.txt", CAM_TO_VELO)
    put_text(root / "calibration/calib_cam_to_pose.txt", CAM_TO_POSE)
    return root


def matrix_row(stamp: int, matrix: NDArray[np.float64]) -> str:
    """A line of MulRan's global_pose.csv."""
    return ",".join([str(stamp), *(f"{value:.17g}" for value in matrix[:3].ravel())]) + "\n"


def mulran(root: Path, *, name: str = "KAIST01") -> Path:
    """Four scans 0.1 s apart; a car that drives east at 10 m/s, with poses of 20 Hz from 0.05 s."""
    sequence = root / name
    for frame in range(4):
        put_scan(sequence / f"sensor_data/Ouster/{MULRAN_STAMP + frame * 100_000_000}.bin")
    rows = []
    for step in range(5):
        pose = np.eye(4)
        pose[:3, 3] = 353_000 + 0.5 + 0.5 * step, 4_026_000, 19
        rows.append(matrix_row(MULRAN_STAMP + 50_000_000 * (step + 1), pose))
    put_text(sequence / "global_pose.csv", "".join(rows))
    return sequence


NCLT_STEPS = np.array([[20_200, 20_000, 20_600], [0, 65_535, 20_000], [30_000, 19_000, 19_999]])
"""Coordinates as stored: steps of 5 mm from -100 m."""


def nclt(root: Path, *, name: str = "2012-01-08") -> Path:
    """Three scans 0.2 s apart, and poses every 0.1 s with one row of NaN."""
    date = root / name
    (date / "velodyne_sync").mkdir(parents=True)
    records = np.zeros(len(NCLT_STEPS), [("xyz", "<u2", 3), ("rest", "u1", 2)])
    records["xyz"] = NCLT_STEPS
    records["rest"] = [[7, 0], [255, 31], [0, 5]]
    for frame in range(3):
        records.tofile(date / f"velodyne_sync/{NCLT_STAMP + 200_000 * frame}.bin")
    lines = [
        f"{NCLT_STAMP + 100_000 * step},{step},2.0,-3.0,0.1,0.2,0.3\n"
        if step != 1
        else f"{NCLT_STAMP + 100_000},nan,nan,nan,nan,nan,nan\n"
        for step in range(6)
    ]
    put_text(date / f"groundtruth_{name}.csv", "".join(lines))
    return date
