# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The second experiment: what the first stage is unsure of, the second one compares."""

from fusionslam_ros2.nodes import SENSORS, data_fusion, describe, tools, views
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    return describe(
        (*SENSORS, "truth", "views_file"),
        lambda given: [data_fusion(given), *views(given, "two_stages"), *tools(given, "clouds")],
    )
