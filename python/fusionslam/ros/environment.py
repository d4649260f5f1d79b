# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where ROS 1 and the messages of fusionslam are on this machine."""

import sys
from importlib.util import find_spec
from pathlib import Path

from fusionslam.errors import FusionSlamError

PACKAGE = "fusionslam_ros"
SHARE = Path(__file__).parent / "share"
"""The folder that holds the ROS package, for ROS_PACKAGE_PATH."""

# Debian's Python modules, pure Python all that is needed; a virtual environment does not see them.
_DEBIAN = "/usr/lib/python3/dist-packages"
_DEBIAN_PACKAGES = (
    "ros-base python3-rosbag python3-tf2-ros ros-std-msgs python3-std-msgs python3-sensor-msgs "
    "python3-nav-msgs python3-geometry-msgs python3-visualization-msgs python3-diagnostic-msgs"
)


def has_ros() -> bool:
    """Whether rospy can be imported, after ``need_ros`` has made Debian's visible if need be."""
    if find_spec("rospy") is None and Path(_DEBIAN, "rospy").is_dir():
        # Last, so that all else comes from the environment that this runs in.
        sys.path.append(_DEBIAN)
    return find_spec("rospy") is not None


def need_ros() -> None:
    """Make ROS 1 and our messages importable.

    Raises:
        FusionSlamError: ROS is not installed, or fusionslam was built without its messages; the
            message says what to do.
    """
    if not has_ros():
        raise FusionSlamError(
            "this needs ROS 1, which is not installed: make ros, or on Debian 12 "
            f"apt-get install --no-install-recommends {_DEBIAN_PACKAGES}"
        )
    if find_spec(PACKAGE) is None:
        raise FusionSlamError(
            "fusionslam was built without its ROS messages: source a catkin workspace that holds "
            f"{PACKAGE}, or install fusionslam again now that python3-genpy is there"
        )
