# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ros: run the nodes without a catkin workspace, and check a robot for them."""

import logging
import shlex
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli.console import print_findings, progress
from fusionslam.cli.failures import DATA
from fusionslam.cli.options import completed_from

if TYPE_CHECKING:
    from fusionslam.ros.check.robot import Connect

app = typer.Typer(
    help="Run the ROS 1 nodes, with or without a catkin workspace.",
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


def list_nodes() -> Iterable[str]:
    from fusionslam.ros.nodes import NODES

    return NODES


def _launch_files() -> Iterable[str]:
    from fusionslam.ros.ros1.files import package_folder

    return sorted(each.stem for each in (package_folder() / "launch").glob("*.launch"))


@app.command()
def path() -> None:
    """Print the folder of the ROS package, for ROS_PACKAGE_PATH."""
    from fusionslam.ros.ros1.files import package_folder

    print(package_folder())


@app.command(context_settings=PASSED_ON)
def run(
    node: Annotated[
        str,
        typer.Argument(
            metavar="NODE",
            autocompletion=completed_from(list_nodes),
            help="Such as data_fusion.",
        ),
    ],
    args: Passed = None,
) -> None:
    """Run one node, as rosrun does: ARGS are remappings (a:=b) and parameters (_name:=value)."""
    from fusionslam.ros.ros1.start import start

    start(node, args or [])


@app.command(context_settings=PASSED_ON)
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


@app.command()
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

    print_check(connect, arguments or [], seconds, "ros")


def print_check(connect: "Connect", arguments: list[str], seconds: float, group: str) -> None:
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
