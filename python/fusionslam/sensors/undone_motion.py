# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a frame knows of the motion within its scan, once that is undone."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from fusionslam import _core
from fusionslam.base.arrays import Floats, Points
from fusionslam.geometry.se3 import log


@dataclass(frozen=True, eq=False)
class Deskew:
    """Motion of a scanner while it took a scan, which is undone in its points.

    Attributes:
        source: what told the motion.
        span: seconds from the scan's stamp to the first and to the last point.
        poses: float64 (K, 4, 4), stamp_from_then, at even steps of time from the first point to the
            last.
    """

    source: Literal["odometry", "imu", "imu and odometry"]
    span: tuple[float, float]
    poses: Floats

    def undo(self, points: Points, seconds: Floats) -> Points:
        """Return points as the scanner would have seen them at the stamp.

        Args:
            points: float32 (N, 3), metres, each in the scanner's frame when it was measured.
            seconds: float64 (N,), when that was, after the stamp.
        """
        return _core.deskew(points, seconds, self.poses, self.span)

    @cached_property
    def moved(self) -> Floats:
        """float64 (2, 6): motions from the stamp to the first and to the last point.

        In the scanner's frame at the stamp: x, y, z in metres, then a rotation in radians.
        """
        return log(self.poses[[0, -1]])

    @property
    def turned_deg(self) -> float:
        """Degrees by which the scanner turned from the first point to the last."""
        return float(np.degrees(np.linalg.norm(self.moved[1, 3:] - self.moved[0, 3:])))
