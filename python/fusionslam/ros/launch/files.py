# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Launch files and nodes found without a catkin workspace."""

import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from fusionslam.datasets.bags import open_bag
from fusionslam.errors import ConfigError, FusionSlamError
from fusionslam.ros.check.observed_topics import INPUTS, LAUNCH_ARGUMENTS, choose
from fusionslam.ros.environment import PACKAGE

_PLACES = (Path(__file__).parents[1] / "share" / PACKAGE, Path(__file__).parents[4] / "ros")
"""Of the ROS package: in an installation, and in the source."""


def package_folder() -> Path:
    """The ROS package, to put into ROS_PACKAGE_PATH.

    Raises:
        FusionSlamError: this installation lacks it.
    """
    for folder in _PLACES:
        if (folder / "package.xml").is_file():
            return folder
    raise FusionSlamError(f"this installation of fusionslam lacks {PACKAGE}: install it again")


def launch_file(name: str) -> Path:
    """A launch file by its path, or one of the package by its name, "ratslam" say.

    Raises:
        ConfigError: there is none; the message lists those of the package.
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
    """The arguments of bag.launch that a bag needs whose topics have other names than expected.

    Topics are guessed by type and name, as ``fusionslam info`` does. True poses are not guessed:
    giving them starts another node.

    Args:
        arguments: those given to the launch file (``bag:=drive.bag``, ``scan:=/points``), which
            are left as they are.

    Returns:
        One ``name:=/topic`` for each topic that is neither given nor called as the nodes expect.

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
    """This process's environment, but roslaunch finds the package, and its nodes this Python."""
    # Launch files complete relative paths by PWD, which only shells keep up to date.
    environment = {**os.environ, "PWD": str(Path.cwd())}
    for name, first in (
        ("ROS_PACKAGE_PATH", package_folder()),
        # The nodes begin with "/usr/bin/env python3".
        ("PATH", Path(sys.executable).parent),
    ):
        others = environment.get(name)
        environment[name] = f"{first}{os.pathsep}{others}" if others else str(first)
    return environment


def roslaunch(path: Path, arguments: list[str]) -> None:
    """Become roslaunch with a launch file; does not return.

    Raises:
        FusionSlamError: roslaunch is not installed.
    """
    program = shutil.which("roslaunch")
    if program is None:
        raise FusionSlamError("roslaunch is not on PATH: on Debian 12, python3-roslaunch has it")
    sys.stdout.flush()
    os.execve(program, [program, str(path), *arguments], launch_environment())
