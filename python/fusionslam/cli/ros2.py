# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ros2: run the nodes, play bags to them, and check a robot for them."""

from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli.console import progress
from fusionslam.cli.options import completed_from
from fusionslam.cli.ros import PASSED_ON, Passed, Seconds, list_nodes, print_check

app = typer.Typer(
    help="Run the ROS 2 nodes, with or without a colcon workspace.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command(context_settings=PASSED_ON)
def run(
    node: Annotated[
        str,
        typer.Argument(
            metavar="NODE", autocompletion=completed_from(list_nodes), help="Such as data_fusion."
        ),
    ],
    args: Passed = None,
) -> None:
    """Run one node, as ros2 run does: ARGS such as --ros-args -r a:=b -p name:=value."""
    from fusionslam.ros.ros2.start import start

    start(node, args or [])


@app.command(context_settings=PASSED_ON)
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
    from fusionslam.errors import ConfigError
    from fusionslam.ros.ros2.player import Playing, play_bag

    if not rate > 0:
        raise ConfigError(f"--rate is {rate:g}, expected more than 0")
    how = Playing(topics or None, rate, start, stop, clock, wait, args or [], until_idle)
    with progress() as step:
        count = play_bag(bag, how, step)
    print(f"{count} messages of {bag} are played")


@app.command(context_settings=PASSED_ON)
def check(
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

    print_check(connect, arguments or [], seconds, "ros2")
