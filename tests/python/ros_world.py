# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS of a test's own."""

import shutil
from importlib.util import find_spec

import pytest

from benchmarks.ros.world import Listener, RosWorld, wait_until
from fusionslam.ros.environment import PACKAGE, has_ros

__all__ = ["Listener", "RosWorld", "lacking", "needs_ros", "wait_until"]


def _lacking() -> str:
    """Why there is no ROS; empty if there is."""
    if not has_ros() or shutil.which("roscore") is None:
        return "ROS 1 is not installed: make ros installs it"
    if find_spec(PACKAGE) is None:
        return "fusionslam was built without its ROS messages: make ros builds it with them"
    return ""


lacking = _lacking()
needs_ros = pytest.mark.skipif(bool(lacking), reason=lacking)
