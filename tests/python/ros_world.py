# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS of a test's own."""

import shutil

import pytest

from benchmarks.ros.world import Listener, RosWorld, wait_until
from fusionslam.errors import FusionSlamError
from fusionslam.ros.environment import need_ros

__all__ = ["Listener", "RosWorld", "needs_ros", "wait_until"]


def _lacking() -> str:
    """Why there is no ROS; empty if there is."""
    if shutil.which("roscore") is None:
        return "ROS 1 is not installed: make ros installs it"
    try:
        need_ros()
    except FusionSlamError as error:
        return str(error)
    return ""


needs_ros = pytest.mark.skipif(bool(_lacking()), reason=_lacking() or "ROS is there")
