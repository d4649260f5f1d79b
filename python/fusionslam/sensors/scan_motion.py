# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How far a robot moves while a scan is taken, by its odometry and the times of the points."""

import logging
from collections import deque

import numpy as np

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.geometry.se3 import inverse, log
from fusionslam.sensors.point_times import LONGEST_SWEEP_S, Span

logger = logging.getLogger(__name__)

_MOST_SCANS = 10_000
"""That are counted: a robot drives for days."""
_FEWEST = 2
"""Scans that are worth a word: the last one of a session may lack odometry to its end."""
_MUCH_DEG = 1.0
"""Less is hardly more than the errors of registered poses."""


class ScanMotion:
    """Follows odometry from frame to frame; says once that motion within scans is not undone.

    Attributes:
        turned: degrees by which the robot turned within each of the last scans where it is known.
    """

    def __init__(self) -> None:
        self.turned: deque[float] = deque(maxlen=_MOST_SCANS)
        self._stamp_ns, self._pose = 0, np.full((4, 4), np.nan)
        self._velocity: Floats | None = None
        self._has_warned = False

    def follow(self, stamp_ns: int | None, pose: Matrix | None) -> None:
        """Take the velocity since the last frame.

        Args:
            stamp_ns: of the frame; None or 0 if unknown.
            pose: float64 (4, 4), odom_from_cloud; None, or with NaN, if unknown.
        """
        last_ns, last = self._stamp_ns, self._pose
        self._stamp_ns = stamp_ns or 0
        self._pose = np.full((4, 4), np.nan) if pose is None else pose
        gap = (self._stamp_ns - last_ns) / 1e9 if last_ns else 0.0
        # Between frames farther apart it may have turned and stopped.
        is_known = 0 < gap <= LONGEST_SWEEP_S and np.isfinite([last, self._pose]).all()
        self._velocity = log(inverse(last) @ self._pose) / gap if is_known else None

    def within(self, span: Span | None) -> Floats | None:
        """Return the motion within the scan of the frame that was followed last.

        Returns:
            float64 (2, 6): small motions of the cloud's frame (x, y, z in metres, then rotations in
            radians) from the stamp to the first and to the last point; None if it is unknown.
        """
        if span is None or self._velocity is None:
            return None
        moved = np.outer(span, self._velocity)
        self.note(moved)
        return moved

    def note(self, moved: Floats) -> None:
        """Count a scan whose motion, as ``within`` returns it, is known already."""
        self.turned.append(float(np.degrees(np.linalg.norm(moved[1, 3:] - moved[0, 3:]))))

    def warn(self, name: str) -> None:
        """Log, once, how far the robot turned within scans, if in one by more than a degree."""
        turned = np.array(self.turned)
        much = int((turned > _MUCH_DEG).sum())
        if not much or len(turned) < _FEWEST or self._has_warned:
            return
        self._has_warned = True
        logger.warning(
            "%s: scans are taken as of one moment, but the robot turned within them, by a median "
            "of %.1f degrees and up to %.1f, by more than %g in %d of %d scans; poses may be off "
            "by as much, unless the driver undid the motion: let it do so, or give frames the "
            "odometry between scans, as bags and FrameBuilder do",
            name,
            np.median(turned),
            turned.max(),
            _MUCH_DEG,
            much,
            len(turned),
        )
