# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find ROS 1 and the messages of fusionslam on this machine."""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from fusionslam.doctor import Finding
from fusionslam.errors import FusionSlamError

PACKAGE = "fusionslam_ros"
# Debian's Python modules, invisible to a virtual environment; the ones needed are pure Python.
_DEBIAN = "/usr/lib/python3/dist-packages"


def has_ros() -> bool:
    """Tell whether rospy can be imported, adding Debian's modules to the path if need be."""
    if find_spec("rospy") is None and Path(_DEBIAN, "rospy").is_dir():
        # Last, so that everything else comes from the current environment.
        sys.path.append(_DEBIAN)
    return find_spec("rospy") is not None


def need_ros() -> None:
    """Use the messages of ROS 1. Raises FusionSlamError, as ``find_ros``."""
    find_ros()
    from fusionslam.ros.messages.library import use_messages
    from fusionslam.ros.ros1.messages import ROS1_MESSAGES

    use_messages(ROS1_MESSAGES)


def find_ros() -> None:
    """Make ROS 1 and our messages importable.

    Raises:
        FusionSlamError: ROS is not installed, or fusionslam was built without its messages; the
            message says what to do.
    """
    if not has_ros():
        lines = Path(__file__).with_name("debian_packages.txt").read_text().splitlines()
        packages = " ".join(line for line in lines if not line.startswith("#"))
        raise FusionSlamError(
            "this needs ROS 1, which is not installed: make ros, or on Debian 12 "
            f"apt-get install --no-install-recommends {packages}",
            code="no-ros",
        )
    if find_spec(PACKAGE) is None:
        raise FusionSlamError(
            "fusionslam was built without its ROS messages: source a catkin workspace that holds "
            f"{PACKAGE}, or build fusionslam again now that python3-genpy is there (make ros does)",
            code="no-ros-messages",
        )


def check_ros() -> Finding:
    """Check that the nodes can run; ROS 1 is optional."""
    try:
        find_ros()
    except FusionSlamError as error:
        return Finding("ros", f"{error}, for the commands ros", error.code, optional=True)
    return Finding("ros", f"ROS 1, messages in {import_module(PACKAGE).__path__[0]}")
