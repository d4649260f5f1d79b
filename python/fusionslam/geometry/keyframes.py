# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""When a robot has moved so far that what it sees is worth keeping."""

from fusionslam.base.arrays import Matrix
from fusionslam.geometry.se3 import motion_size


def is_keyframe(step: Matrix, distance: float, turn: float) -> bool:
    """Tell whether a frame is a keyframe: the robot moved or turned so far since the last one.

    Args:
        step: float64 (4, 4), last_from_robot, metres.
        distance: least motion, metres.
        turn: least turn, degrees.
    """
    metres, degrees = motion_size(step)
    return metres >= distance or degrees >= turn
