# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Motion of a scanner within a scan, by odometry and the times of the points, and its undoing."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from fusionslam import _core
from fusionslam.base.arrays import Floats, Points
from fusionslam.geometry.se3 import inverse, log
from fusionslam.sensors.messages import NANOSECONDS, Scan
from fusionslam.sensors.robot_frames import RobotFrames
from fusionslam.sensors.transforms import TransformError

_POSES = 33
"""Along a scan. At 3 rad/s and 0.1 s they are half a degree apart: 0.2 mm at 20 m."""
_FASTEST_M_S = 100.0
_FASTEST_RAD_S = 15.0
"""Odometry that moves faster jumps."""


@dataclass(frozen=True, eq=False)
class Deskew:
    """Motion of a scanner while it took a scan, which is undone in its points.

    Attributes:
        source: what told the motion.
        span: seconds from the scan's stamp to the first and to the last point.
        poses: float64 (K, 4, 4), stamp_from_then, at even steps of time from the first point to the
            last.
    """

    source: Literal["odometry"]
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


def motion_within(scan: Scan, frames: RobotFrames) -> Deskew | None:
    """Return how a scanner moved while it took a scan.

    None where the times of its points or odometry are not known, or all points were measured at one
    time.

    Args:
        scan: each point in the scanner's frame when it was measured.
        frames: the robot's odometry, and where the scanner is on it.

    Raises:
        TransformError: odometry is not known at the time of a point, or jumps within the scan (code
            "odometry-jump").
    """
    if scan.span is None or scan.span[0] == scan.span[1]:
        return None
    times = np.r_[0.0, np.linspace(*scan.span, _POSES)]
    stamps_ns = scan.stamp_ns + np.round(times * NANOSECONDS).astype(np.int64)
    odometry = frames.odometry_from(scan.frame_id, stamps_ns)
    if odometry is None:
        return None
    poses = inverse(odometry[:1]) @ odometry[1:]
    _check_speed(poses, (scan.span[1] - scan.span[0]) / (_POSES - 1))
    return Deskew("odometry", scan.span, poses)


def _check_speed(poses: Floats, step_s: float) -> None:
    """Raise TransformError (code "odometry-jump") for poses along which no robot moves."""
    speeds = np.abs(log(inverse(poses[:-1]) @ poses[1:])) / step_s
    metres, radians = (np.linalg.norm(part, axis=1).max() for part in np.hsplit(speeds, 2))
    if metres > _FASTEST_M_S or radians > _FASTEST_RAD_S:
        raise TransformError(
            f"odometry moves at {metres:.3g} m/s and {radians:.3g} rad/s within the scan, expected "
            f"up to {_FASTEST_M_S:g} and {_FASTEST_RAD_S:g}",
            may_come=False,
            code="odometry-jump",
            fields=(f"{metres:.3g}", f"{radians:.3g}"),
        )
