# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What pose cells tell the experience map to do."""

from typing import NamedTuple

from fusionslam._core import ActionKind


class Action(NamedTuple):
    """What to do with the experience map.

    Attributes:
        kind: nothing, a new node, or an edge to a known one.
        source: id of the experience that the robot was at; 0 before the first one.
        target: id of the one it is at now.
        relative_rotation: radians, counter-clockwise, that the robot is turned against the target.
        relative_place: metres, x forward and y to the left, where the robot is in the frame of
            the target; (0, 0) where nobody measured it.
    """

    kind: ActionKind
    source: int = 0
    target: int = 0
    relative_rotation: float = 0.0
    relative_place: tuple[float, float] = (0.0, 0.0)
