# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command that looks whether a robot has what the ROS nodes need."""

import logging
from typing import Annotated

import typer

from fusionslam.cli.guard import DATA
from fusionslam.cli.screen import print_findings, progress


def check(
    remappings: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME:=TOPIC]...",
            help="As data_fusion takes them: remappings, parameters (_fusion/source:=stereo).",
        ),
    ] = None,
    seconds: Annotated[
        float,
        typer.Option("--seconds", min=1, help="How long to wait for a sensor, and then to listen."),
    ] = 5.0,
) -> None:
    """Say whether a running robot, or a bag being played, has what the nodes need.

    Listens to topics, transforms and calibration, publishes nothing, fuses a first cloud. The exit
    code is 0 if data_fusion can work, else 1.
    """
    from fusionslam.ros.check import check_robot

    # The findings say all of it.
    logging.disable(logging.ERROR)
    with progress() as step:
        found = check_robot(remappings or [], seconds, step)
    print_findings(found.findings, "note")
    print(found.verdict)
    if found.launch:
        print("to start:", " ".join(["fusionslam ros launch", *found.launch]))
    if found.remappings:
        print("to check again:", " ".join(["fusionslam ros check", *found.remappings]))
    if not found.works:
        raise typer.Exit(DATA)
