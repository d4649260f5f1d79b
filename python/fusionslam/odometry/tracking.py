# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What odometry of recordings and of robots that drive have in common."""

from collections.abc import Iterator
from typing import Literal

import numpy as np

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.config import merged
from fusionslam.odometry.lidar_odometry import LidarOdometry, LidarOdometryConfig
from fusionslam.sensors.messages import NANOSECONDS, Imu

ScanOdometry = Literal["lidar", "inertial"]


def scan_odometry(kind: str, config: LidarOdometryConfig | None) -> LidarOdometryConfig:
    """The configuration for odometry of a kind: "inertial" needs an IMU, "lidar" does not."""
    return merged(config or LidarOdometryConfig(), {"imu": "always"} if kind == "inertial" else {})


def end_of(stamp_ns: int, point_seconds: Floats | None) -> int:
    """Time of a scan's last point, nanoseconds; that of its stamp where times are unknown."""
    if point_seconds is None or not len(point_seconds):
        return stamp_ns
    return stamp_ns + round(float(np.nanmax(point_seconds)) * NANOSECONDS)


def add_until(odometry: LidarOdometry, messages: Iterator[Imu], end_ns: int) -> None:
    """Add messages of an IMU until one is later than a time. Raises as ``LidarOdometry.add``."""
    for imu in messages:
        odometry.add(imu)
        if imu.stamp_ns > end_ns:
            return


def poses_of_body(scans: Matrix, first: Matrix, body_from_points: Matrix) -> Matrix:
    """Poses of the body of a scanner, each in that at the first scan.

    Args:
        scans: float64 (N, 4, 4), poses of the scanner.
        first: float64 (4, 4), that of the first scan.
        body_from_points: float64 (4, 4), where the scanner is on the body.
    """
    relative = np.linalg.inv(first) @ scans
    poses: Matrix = body_from_points @ relative @ np.linalg.inv(body_from_points)
    return poses
