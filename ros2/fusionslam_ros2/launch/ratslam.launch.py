# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The third experiment: a map of recognised places."""

from fusionslam_ros2.nodes import SENSORS, data_fusion, describe, ratslam, tools, views
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    return describe(
        (*SENSORS, "truth", "views", "views_file", "map_file"),
        lambda given: [
            data_fusion(given, keep_ground=given["views"] == "cm2dp"),
            *views(given, given["views"]),
            ratslam(given),
            *tools(given, "map"),
        ],
    )
