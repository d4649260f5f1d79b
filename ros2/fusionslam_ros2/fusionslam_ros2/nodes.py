# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes that launch files start, and the arguments that these files take."""

from collections.abc import Callable, Mapping
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

PACKAGE = "fusionslam_ros2"
SENSORS = "scan", "image", "camera_info", "odom", "imu"
COMMON = "parameters", "rviz", "live", "use_sim_time"
ARGUMENTS = {  # of each the default and a description; that of a topic is the nodes' name for it
    "scan": ("velodyne_points", "topic of the scans"),
    "image": ("camera/rgb/image_raw", "topic of the images, compressed or not"),
    "camera_info": ("camera/rgb/camera_info", "topic of their calibration"),
    "odom": ("odom", "topic of the odometry"),
    "imu": ("imu", "topic of the IMU, if there is one"),
    "fix": ("fix", "topic of a satellite receiver's fixes, if there is one"),
    "truth": ("", "topic of the true odometry, if views are to be judged"),
    "views": ("alignment", "what recognises places, as fusionslam ratslam --views"),
    "views_file": ("", ".npz that keeps the views for the next start"),
    "map_file": ("", ".npz that keeps the map for the next start"),
    "loops_folder": ("", "folder that keeps the descriptors for the next start"),
    "site": ("site.fsmap", "file of the map of mapper, made if it is missing"),
    "session": ("", "name of the drive; by default the date"),
    "read_only": ("false", "whether the robot is only found on the map"),
    "parameters": ("", "YAML of parameters, by node"),
    "rviz": ("false", "whether to show all in RViz 2"),
    "live": ("false", "whether to serve Foxglove, at ws://127.0.0.1:8765"),
    "use_sim_time": ("false", "whether the time is that of /clock"),
}
Given = Mapping[str, str]


def declare(name: str, default: str | None, description: str) -> DeclareLaunchArgument:
    """Declare an argument; one whose default is true or false takes nothing else."""
    choices = ["true", "false"] if default in ("true", "false") else None
    return DeclareLaunchArgument(
        name, default_value=default, description=description, choices=choices
    )


def describe(
    names: tuple[str, ...], start: Callable[[Given], list[LaunchDescriptionEntity]]
) -> LaunchDescription:
    """Describe a launch that takes these arguments; ``start`` gets their values."""

    def run(context: LaunchContext) -> list[LaunchDescriptionEntity]:
        return start(context.launch_configurations)

    arguments = (declare(name, *ARGUMENTS[name]) for name in (*names, *COMMON))
    return LaunchDescription([*arguments, OpaqueFunction(function=run)])


def data_fusion(given: Given, *, keep_ground: bool = False) -> Node:
    """Make coloured clouds of what the robot publishes.

    Args:
        given: the values of the arguments.
        keep_ground: whether clouds keep their ground, by which descriptors of whole clouds know
            places, too; a file of parameters may say otherwise.
    """
    defaults = {"fusion.ground": "none"} if keep_ground else None
    return _node(given, "data_fusion", _topics(given, *SENSORS), defaults=defaults)


def views(given: Given, source: str) -> list[Node]:
    """Recognise places by clouds, or by images, and judge that if the truth is known."""
    odometry_and_images = _topics(given, "odom", "image")
    own = {"source": source, **_kept(given["views_file"])}
    nodes = [_node(given, "lv_matching", odometry_and_images, own)]
    if source != "visual_templates":
        nodes.append(_node(given, "lv_builder", parameters={"source": source}))
    if given["truth"]:
        topics = {"ground_truth": given["truth"], **_topics(given, "image")}
        nodes.append(_node(given, "lv_analyzer", topics))
    return nodes


def ratslam(given: Given) -> Node:
    """Make a map of the places that were recognised."""
    return _node(given, "ratslam", _topics(given, "odom"), _kept(given["map_file"]))


def loop_closure(given: Given) -> Node:
    """Close loops by the descriptors of coloured clouds."""
    return _node(given, "loop_closure", parameters=_kept(given["loops_folder"]))


def mapper(given: Given) -> Node:
    """Extend a map that lasts, or find the robot on it."""
    of_the_map = {
        "map.file": given["site"],
        "map.session": given["session"],
        "map.read_only": given["read_only"] == "true",
    }
    return _node(given, "mapper", _topics(given, *SENSORS, "fix"), of_the_map)


def tools(given: Given, picture: str) -> list[Node]:
    """Show a picture in RViz 2, and serve a live view, if that is wanted."""
    shown = [_rviz(given, picture)] if given["rviz"] == "true" else []
    return [*shown, *([_node(given, "live_view")] if given["live"] == "true" else [])]


def _rviz(given: Given, picture: str) -> Node:
    path = Path(get_package_share_directory(PACKAGE)) / "rviz" / f"{picture}.rviz"
    return Node(
        package="rviz2",
        executable="rviz2",
        name="rviz",
        arguments=["-d", str(path)],
        parameters=[_clock(given)],
        remappings=[*_topics(given, "image").items()],
    )


def _node(
    given: Given,
    name: str,
    topics: Mapping[str, str] | None = None,
    parameters: Mapping[str, str | bool] | None = None,
    *,
    defaults: Mapping[str, str] | None = None,
) -> Node:
    """Start a node; of two values of a parameter it takes the later one."""
    before = [each for each in (defaults, given["parameters"]) if each]
    return Node(
        package=PACKAGE,
        executable=name,
        name=name,
        output="screen",
        parameters=[*before, {**_clock(given), **(parameters or {})}],
        remappings=[*(topics or {}).items()],
    )


def _topics(given: Given, *names: str) -> dict[str, str]:
    return {ARGUMENTS[name][0]: given[name] for name in names}


def _kept(path: str) -> dict[str, str]:
    return {"memory.file": path} if path else {}


def _clock(given: Given) -> dict[str, bool]:
    return {"use_sim_time": given["use_sim_time"] == "true"}
