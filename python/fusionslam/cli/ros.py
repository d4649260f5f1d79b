# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ros and ros2: run the nodes, play bags to them, and check a robot for them."""

import logging
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli.console import print_findings, progress
from fusionslam.cli.failures import DATA
from fusionslam.cli.options import completed_from
from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.ros.check.robot import Connect

ros = typer.Typer(
    help="Run the ROS 1 nodes, with or without a catkin workspace.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

ros2 = typer.Typer(
    help="Run the ROS 2 nodes, with or without a colcon workspace.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

# All further arguments are for ROS, even if they look like options.
PASSED_ON = {"allow_extra_args": True, "ignore_unknown_options": True}
Passed = Annotated[list[str] | None, typer.Argument(metavar="[ARGS]...", show_default=False)]
Seconds = Annotated[
    float,
    typer.Option("--seconds", min=1, help="How long to wait for a sensor, and then to listen."),
]


def _list_nodes() -> Iterable[str]:
    from fusionslam.ros.nodes import NODES

    return NODES


NodeName = Annotated[
    str,
    typer.Argument(
        metavar="NODE", autocompletion=completed_from(_list_nodes), help="Such as data_fusion."
    ),
]


def _launch_files() -> Iterable[str]:
    from fusionslam.ros.ros1.files import package_folder

    return sorted(each.stem for each in (package_folder() / "launch").glob("*.launch"))


@ros.command()
def path() -> None:
    """Print the folder of the ROS package, for ROS_PACKAGE_PATH."""
    from fusionslam.ros.ros1.files import package_folder

    print(package_folder())


@ros.command(context_settings=PASSED_ON)
def run(
    node: NodeName,
    args: Passed = None,
) -> None:
    """Run one node, as rosrun does: ARGS are remappings (a:=b) and parameters (_name:=value)."""
    from fusionslam.ros.ros1.start import start

    start(node, args or [])


@ros.command(context_settings=PASSED_ON)
def launch(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            autocompletion=completed_from(_launch_files),
            help="A launch file, or the name of one that comes with fusionslam.",
        ),
    ],
    args: Passed = None,
) -> None:
    """Run a launch file, as roslaunch does: ARGS are its arguments (a:=b) and roslaunch's options.

    Its nodes run with the Python that this command runs with.
    """
    from fusionslam.ros.ros1.environment import need_ros
    from fusionslam.ros.ros1.files import guess_bag_topics, launch_file, roslaunch

    need_ros()
    path, arguments = launch_file(file), args or []
    if path.name == "bag.launch" and (guessed := guess_bag_topics(arguments)):
        print("topics of the bag, guessed by type:", shlex.join(guessed))
        arguments = [*arguments, *guessed]
    roslaunch(path, arguments)


@ros.command()
def check(
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME:=TOPIC]...",
            help="Topics as launch files take them (scan:=/points), or remappings and parameters "
            "as data_fusion does (_fusion/source:=stereo).",
        ),
    ] = None,
    seconds: Seconds = 5.0,
) -> None:
    """Check that a running robot, or a bag being played, has what the nodes need.

    Listens to topics, transforms and calibration and fuses a first cloud, but publishes nothing.
    The exit code is 0 if data_fusion can work, else 1.
    """
    from fusionslam.ros.ros1.robot import connect

    _print_check(connect, arguments or [], seconds, "ros")


@ros2.command("run", context_settings=PASSED_ON)
def run_ros2(
    node: NodeName,
    args: Passed = None,
) -> None:
    """Run one node, as ros2 run does: ARGS such as --ros-args -r a:=b -p name:=value."""
    from fusionslam.ros.ros2.start import start

    start(node, args or [])


@ros2.command(context_settings=PASSED_ON)
def play(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="Of ROS 1 or ROS 2, or MCAP.")],
    args: Passed = None,
    rate: Annotated[float, typer.Option("--rate", help="Speed, relative to the bag's.")] = 1.0,
    start: Annotated[float, typer.Option("--start", min=0, help="Seconds to leave out.")] = 0.0,
    stop: Annotated[
        float | None,
        typer.Option("--stop", min=0, help="Seconds of the bag to end at."),
    ] = None,
    topics: Annotated[
        list[str] | None, typer.Option("--topic", help="Play this topic only; repeatable.")
    ] = None,
    clock: Annotated[bool, typer.Option(help="Publish the bag's time on /clock.")] = True,
    wait: Annotated[
        float,
        typer.Option(
            "--wait",
            min=0,
            help="Begin these seconds after the last subscriber came; 0: at once.",
        ),
    ] = 2.0,
    until_idle: Annotated[
        bool, typer.Option("--until-idle", help="End once the nodes have processed everything.")
    ] = False,
) -> None:
    """Play a bag in ROS 2, and end once all messages are received.

    ARGS are for ROS: --ros-args -r FROM:=TO.
    """
    from fusionslam.ros.ros2.player import Playing, play_bag

    if not rate > 0:
        raise ConfigError(f"--rate is {rate:g}, expected more than 0")
    how = Playing(topics or None, rate, start, stop, clock, wait, args or [], until_idle)
    with progress() as step:
        count = play_bag(bag, how, step)
    print(f"{count} messages of {bag} are played")


@ros2.command("check", context_settings=PASSED_ON)
def check_ros2(
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME:=TOPIC]...",
            help="Remappings of data_fusion's topics (velodyne_points:=/points), also by the short "
            "names of launch files (scan:=/points), and its parameters (-p fusion.source:=stereo).",
        ),
    ] = None,
    seconds: Seconds = 5.0,
) -> None:
    """Check that a running robot, or a bag being played, has what the nodes need.

    Listens to topics, transforms and calibration and fuses a first cloud, but publishes none.
    The exit code is 0 if data_fusion can work, else 1.
    """
    from fusionslam.ros.ros2.robot import connect

    _print_check(connect, arguments or [], seconds, "ros2")


def _print_check(connect: "Connect", arguments: list[str], seconds: float, group: str) -> None:
    """Check a robot, print the result and exit with 1 if data_fusion cannot work.

    Args:
        connect: that of ROS 1 or ROS 2.
        arguments: of the command line.
        seconds: how long to wait for a sensor, and then to listen.
        group: of the command: "ros" or "ros2".
    """
    from fusionslam.ros.check.robot import check_robot

    # The findings already report it.
    logging.disable(logging.ERROR)
    try:
        with progress() as step:
            found = check_robot(connect, arguments, seconds, step)
    finally:
        logging.disable(logging.NOTSET)
    print(found.overview, end="\n\n")
    print_findings(found.findings, "note")
    print(found.verdict)
    if found.launch:
        print("to start:", shlex.join(found.launch))
    if found.again:
        print("to check again:", shlex.join(["fusionslam", group, "check", *found.again]))
    if not found.works:
        raise typer.Exit(DATA)
