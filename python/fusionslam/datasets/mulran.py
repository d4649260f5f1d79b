# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the LiDAR of MulRan (Kim, Park, Cho, Jeong, Kim 2020): an Ouster OS1-64 on a car."""

from pathlib import Path

import numpy as np

from fusionslam.base.arrays import Matrix
from fusionslam.datasets.cloud_files import read_bin
from fusionslam.datasets.pose_files import read_matrices
from fusionslam.datasets.stamped_scans import StampedScans
from fusionslam.datasets.streams import find_existing

TRUTH = "global_pose.csv"
_YAW = np.radians(179.6654)
BASE_FROM_OUSTER: Matrix = np.array(
    [
        [np.cos(_YAW), -np.sin(_YAW), 0, 1.7042],
        [np.sin(_YAW), np.cos(_YAW), 0, -0.021],
        [0, 0, 1, 1.8047],
        [0, 0, 0, 1],
    ]
)
"""Published calibration: the scanner faces backwards. Its roll and pitch, 0.0001 and 0.0003
degrees, are taken as zero. The height is above the base, whose own is not published."""


def _scans(root: Path) -> Path | None:
    folder = root / "sensor_data" / "Ouster"
    if folder.is_dir():
        return folder
    # As unpacked without the folder that the data set's own player expects.
    folder = root / "Ouster"
    return folder if folder.is_dir() and (root / TRUTH).exists() else None


_LINE = "a stamp in nanoseconds and 12 numbers (row-major 3x4), with commas between them"

MULRAN = StampedScans(
    kind="mulran",
    title="MulRan",
    scans=_scans,
    read_scan=read_bin,
    unit_ns=1,
    truth=lambda root: find_existing(root / TRUTH),
    read_truth=lambda path: read_matrices(path, _LINE, delimiter=","),
    pose_frame="the car's base",
    body_from_points=BASE_FROM_OUSTER,
    robot_from_points=BASE_FROM_OUSTER,
)
