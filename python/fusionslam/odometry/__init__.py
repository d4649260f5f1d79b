# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The motion of a LiDAR from its scans, and what an IMU feels."""

from fusionslam.odometry.inertial_matcher import Felt
from fusionslam.odometry.lidar_odometry import Deviation, LidarOdometry, LidarOdometryConfig
from fusionslam.odometry.live_odometry import LiveOdometry

__all__ = [
    "Deviation",
    "Felt",
    "LidarOdometry",
    "LidarOdometryConfig",
    "LiveOdometry",
]
