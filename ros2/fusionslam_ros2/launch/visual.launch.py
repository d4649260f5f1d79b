# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The original RatSLAM: places recognised by images."""

from fusionslam_ros2.nodes import describe, ratslam, tools, views
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    return describe(
        ("image", "odom", "truth", "views_file", "map_file"),
        lambda given: [
            *views(given, "visual_templates"),
            ratslam(given),
            *tools(given, "visual"),
        ],
    )
