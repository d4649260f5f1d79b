# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One of the experiments on a bag, which is played as soon as all nodes listen."""

from pathlib import Path

from fusionslam_ros2.nodes import ARGUMENTS, PACKAGE, declare
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import IncludeLaunchDescription, OpaqueFunction, Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node

EXPERIMENTS = "first_stage", "two_stages", "ratslam", "visual", "loops", "mapper"


def generate_launch_description() -> LaunchDescription:
    arguments = {**ARGUMENTS, "use_sim_time": ("true", ARGUMENTS["use_sim_time"][1])}
    return LaunchDescription(
        [
            declare("bag", None, "the bag"),
            declare("rate", "1", "how much faster than it was recorded"),
            declare("experiment", "ratslam", ", ".join(EXPERIMENTS)),
            declare("stay", "false", "whether the nodes go on after the bag"),
            *(declare(name, *about) for name, about in arguments.items()),
            OpaqueFunction(function=_start),
        ]
    )


def _start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    given = context.launch_configurations
    path = Path(__file__).with_name(f"{given['experiment']}.launch.py")
    end = Shutdown(reason="the bag is played, and the nodes have processed it")
    player = Node(
        package=PACKAGE,
        executable="bag_player",
        name="bag_player",
        output="screen",
        arguments=[given["bag"], "--rate", given["rate"], "--until-idle"],
        on_exit=[] if given["stay"] == "true" else [end],
    )
    return [IncludeLaunchDescription(PythonLaunchDescriptionSource(str(path))), player]
