# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find launch files and nodes without a catkin workspace."""

import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from fusionslam.datasets.bags import open_bag
from fusionslam.errors import ConfigError, FusionSlamError
from fusionslam.ros.messages.library import OWN
from fusionslam.ros.topic_choice import INPUTS, LAUNCH_ARGUMENTS, choose

_PLACES = (Path(__file__).parents[1] / "share" / OWN, Path(__file__).parents[4] / "ros")
"""Folders of the ROS package: in an installation, and in the source tree."""


def package_folder() -> Path:
    """Return the folder of the ROS package, for ROS_PACKAGE_PATH.

    Raises:
        FusionSlamError: this installation lacks the package.
    """
    for folder in _PLACES:
        if (folder / "package.xml").is_file():
            return folder
    raise FusionSlamError(
        f"this installation of fusionslam lacks {OWN}: install it again",
        code="no-package",
        fields=(OWN,),
    )


def launch_file(name: str) -> Path:
    """Find a launch file by its path, or one of the package by its name, such as "ratslam".

    Raises:
        ConfigError: no such launch file; the message lists those of the package.
    """
    if Path(name).is_file():
        return Path(name)
    folder = package_folder() / "launch"
    path = folder / Path(name).with_suffix(".launch").name
    if not path.is_file():
        names = ", ".join(sorted(each.stem for each in folder.glob("*.launch")))
        raise ConfigError(f"FILE is {name!r}, expected the path of a launch file or one of {names}")
    return path


def guess_bag_topics(arguments: Sequence[str]) -> list[str]:
    """Return the arguments of bag.launch for a bag whose topics have unexpected names.

    Topics are guessed by type and name, as ``fusionslam info`` does. The ground truth is not
    guessed: giving it starts another node.

    Args:
        arguments: given to the launch file (``bag:=drive.bag``, ``scan:=/points``); not changed.

    Returns:
        One ``name:=/topic`` for each topic that is not given and has an unexpected name.

    Raises:
        DataError: the bag cannot be read.
    """
    given = {name: value for name, sign, value in (a.partition(":=") for a in arguments) if sign}
    if not given.get("bag"):
        return []
    with open_bag(Path(given["bag"]).expanduser()) as bag:
        topics = bag.topics
    asked = {
        role: f"/{given.get(name, INPUTS[role]).lstrip('/')}"
        for role, name in LAUNCH_ARGUMENTS.items()
        if role != "truth"
    }
    return [
        f"{name}:={choice.topic}"
        for role, choice in choose(topics, {}, asked).items()
        if choice.is_guess and (name := LAUNCH_ARGUMENTS[role]) not in given
    ]


def launch_environment() -> dict[str, str]:
    """Return this process's environment, changed so that roslaunch finds package and Python."""
    # Launch files resolve relative paths against PWD, which only shells keep up to date.
    environment = {**os.environ, "PWD": str(Path.cwd())}
    for name, first in (
        ("ROS_PACKAGE_PATH", package_folder()),
        # The nodes start with "/usr/bin/env python3".
        ("PATH", Path(sys.executable).parent),
    ):
        others = environment.get(name)
        environment[name] = f"{first}{os.pathsep}{others}" if others else str(first)
    return environment


def roslaunch(path: Path, arguments: list[str]) -> None:
    """Replace this process by roslaunch with a launch file; does not return.

    Raises:
        FusionSlamError: roslaunch is not installed.
    """
    program = shutil.which("roslaunch")
    if program is None:
        raise FusionSlamError("roslaunch is not on PATH: on Debian 12, python3-roslaunch has it")
    sys.stdout.flush()
    os.execve(program, [program, str(path), *arguments], launch_environment())
