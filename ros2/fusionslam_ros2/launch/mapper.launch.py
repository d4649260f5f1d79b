# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A map that lasts: extended by the robot's drive, or known, to find the robot on."""

from fusionslam_ros2.nodes import SENSORS, describe, mapper, tools
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    return describe(
        (*SENSORS, "fix", "site", "session", "read_only"),
        lambda given: [mapper(given), *tools(given, "mapper")],
    )
