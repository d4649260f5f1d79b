# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Loops closed by the descriptors of coloured clouds."""

from fusionslam_ros2.nodes import SENSORS, data_fusion, describe, loop_closure, tools
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    return describe(
        (*SENSORS, "loops_folder"),
        lambda given: [
            data_fusion(given, keep_ground=True),
            loop_closure(given),
            *tools(given, "loops"),
        ],
    )
