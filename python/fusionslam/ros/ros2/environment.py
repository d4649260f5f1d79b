# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find ROS 2 and the messages of fusionslam in this Python."""

from importlib import import_module
from importlib.util import find_spec

from fusionslam.doctor import Finding
from fusionslam.errors import FusionSlamError
from fusionslam.ros.ros2 import MESSAGES


def need_ros2() -> None:
    """Use the messages of ROS 2. Raises FusionSlamError, as ``find_ros2``."""
    find_ros2()
    from fusionslam.ros.messages.library import use_messages
    from fusionslam.ros.ros2.messages import ROS2_MESSAGES

    use_messages(ROS2_MESSAGES)


def find_ros2() -> None:
    """Find ROS 2 and our messages.

    Raises:
        FusionSlamError: ROS 2 or our messages are not installed; the message says what to do.
    """
    if find_spec("rclpy") is None:
        raise FusionSlamError(
            "this needs ROS 2, which this Python does not see: source its setup.bash, or make an "
            "environment with it (make ros2) and run .venv-ros2/bin/fusionslam",
            code="no-ros2",
        )
    if find_spec(MESSAGES) is None:
        raise FusionSlamError(
            f"this needs the ROS 2 messages of fusionslam: build {MESSAGES} in ros2/ by colcon and "
            "source its setup.bash, or make ros2",
            code="no-ros2-messages",
        )


def check_ros2() -> Finding:
    """Check that the nodes can run; ROS 2 is optional."""
    try:
        find_ros2()
    except FusionSlamError as error:
        return Finding("ros2", f"{error}, for the commands ros2", error.code, optional=True)
    return Finding("ros2", f"ROS 2, messages in {import_module(MESSAGES).__path__[0]}")
