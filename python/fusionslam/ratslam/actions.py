# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Actions: what the pose cells tell the experience map to do."""

from typing import NamedTuple

from fusionslam._core import ActionKind


class Action(NamedTuple):
    """A change of the experience map.

    Attributes:
        kind: nothing, a new node, or an edge to a known one.
        source: id of the experience that the robot was at; 0 before the first one.
        target: id of the experience that it is at now.
        relative_rotation: rotation of the robot relative to the target, radians, counter-clockwise.
        relative_place: position of the robot in the target's frame, metres, x forward and y to the
            left; (0, 0) if it was not measured.
    """

    kind: ActionKind
    source: int = 0
    target: int = 0
    relative_rotation: float = 0.0
    relative_place: tuple[float, float] = (0.0, 0.0)
