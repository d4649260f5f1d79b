# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS of a test's own."""

import shutil

import pytest

from benchmarks.ros.world import Listener, RosWorld, wait_until
from fusionslam.ros.environment import has_ros

__all__ = ["Listener", "RosWorld", "needs_ros", "wait_until"]

needs_ros = pytest.mark.skipif(
    not has_ros() or shutil.which("roscore") is None,
    reason="ROS 1 is not installed: make ros installs it",
)
