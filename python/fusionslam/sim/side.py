# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One side of a rectangle on the ground: a wall of a room, or a street edge of a block."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Side:
    """A line from ``start`` of ``length`` metres at ``yaw`` radians, the rectangle to its left.

    Positions are (along, inward): metres along the line, and into the rectangle.
    """

    start: tuple[float, float]
    yaw: float
    length: float

    def at(self, along: float, inward: float) -> tuple[float, float]:
        """x, y of a position, metres."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        x = self.start[0] + c * along - s * inward
        y = self.start[1] + s * along + c * inward
        return float(x), float(y)

    def along(self, x: float, y: float) -> tuple[float, float]:
        """(along, inward) of a point, metres."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        dx, dy = x - self.start[0], y - self.start[1]
        return float(c * dx + s * dy), float(c * dy - s * dx)
