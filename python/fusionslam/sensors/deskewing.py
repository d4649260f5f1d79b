# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Motion of a scanner within a scan, by odometry, an IMU or both, and its undoing."""

from contextlib import suppress

import numpy as np

from fusionslam.base.arrays import Floats, Integers, Points
from fusionslam.geometry.se3 import inverse, log
from fusionslam.sensors.messages import NANOSECONDS, Scan
from fusionslam.sensors.robot_frames import RobotFrames
from fusionslam.sensors.transforms import TransformError
from fusionslam.sensors.undone_motion import Deskew

_POSES = 33
"""Along a scan. At 3 rad/s and 0.1 s they are half a degree apart: 0.2 mm at 20 m."""
_LEAST_S = 1e-6
_SLOW_S = 0.06
"""Between poses of odometry, so long that an IMU tells more of the turn."""
_SILENT_NS = NANOSECONDS // 5
"""An IMU that is so far behind is not waited for where odometry tells the motion."""
_APART_DEG = 3.0
"""An IMU may tell more of a turn than slow odometry by so much and half of the turn."""
_BEFORE_S = 0.15
"""Before a scan, odometry is looked at, too."""
_JUMP_M_S = 5.0
_JUMP_RAD_S = 5.0
"""From one moment to the next no robot's velocity changes by so much."""


def points_of(scan: Scan, motion: Deskew | None) -> Points:
    """Return the points of a scan, with a motion within it undone."""
    if motion is None or scan.point_seconds is None:
        return scan.points
    return motion.undo(scan.points, scan.point_seconds)


def motion_within(
    scan: Scan, frames: RobotFrames, stamp_ns: int | None = None, *, late: bool = True
) -> Deskew | None:
    """Return how a scanner moved while it took a scan.

    Odometry tells it; where its poses are more than 0.06 s apart, an IMU tells the turn; without
    odometry, the turn alone. None where neither is known, or the times of points are not, or all
    points were measured at the stamp.

    Args:
        scan: each point in the scanner's frame when it was measured.
        frames: the robot's odometry, its IMU, and where the scanner is on it.
        stamp_ns: of the scan by the clock of odometry, if that is another one than the scan's.
        late: whether nothing is waited for any more that may yet come.

    Raises:
        TransformError: odometry is not known at the time of a point, or lacks around it for more
            than 0.25 s (code "gap"), or jumps within the scan ("odometry-jump"), and no IMU tells
            the turn.
    """
    if scan.span is None or np.abs(scan.span).max() < _LEAST_S:
        return None
    times = np.r_[0.0, np.linspace(*scan.span, _POSES)]
    stamps_ns = (scan.stamp_ns if stamp_ns is None else stamp_ns) + _nanoseconds(times)
    moved, failure = None, None
    try:
        odometry = frames.odometry_from(scan.frame_id, stamps_ns)
        if odometry is not None:
            _check_speed(scan, frames, stamps_ns[1:], odometry[1:])
            moved = inverse(odometry[:1]) @ odometry[1:]
    except TransformError as error:
        if error.may_come and not late:
            raise
        failure = error
    if moved is not None and frames.odometry_step(stamps_ns) <= _SLOW_S:
        return Deskew("odometry", scan.span, moved)
    newest = frames.imu.newest
    if moved is not None and newest is not None and stamps_ns.max() - newest > _SILENT_NS:
        late = True  # it would hold up what odometry tells
    turned = _turn(scan, frames, stamps_ns, late)
    if turned is not None and moved is not None:
        turned[:, :3, 3] = moved[:, :3, 3]
        if _contradict(turned, moved, frames):
            return Deskew("odometry", scan.span, moved)
        return Deskew("imu and odometry", scan.span, turned)
    if turned is not None:
        return Deskew("imu", scan.span, turned)
    if failure is not None:
        raise failure
    return None if moved is None else Deskew("odometry", scan.span, moved)


def _turn(scan: Scan, frames: RobotFrames, stamps_ns: Integers, late: bool) -> Floats | None:
    """stamp_from_then by the IMU, (K, 4, 4), a copy; None if it does not tell."""
    try:
        turned = frames.turned_by_imu(scan.frame_id, stamps_ns)
    except TransformError as error:
        if error.may_come and not late:
            raise
        return None
    return None if turned is None else turned[1:].copy()


def _contradict(turned: Floats, moved: Floats, frames: RobotFrames) -> bool:
    """Whether an IMU turns so differently from odometry that one of them means something else."""
    turns = [log(inverse(each[:1]) @ each[-1:])[0, 3:] for each in (turned, moved)]
    sizes = [float(np.degrees(np.linalg.norm(turn))) for turn in turns]
    off = float(np.degrees(np.linalg.norm(turns[0] - turns[1])))
    if off <= _APART_DEG + 0.5 * sizes[1]:
        return False
    frames.imu.distrust(*sizes)
    return True


def _nanoseconds(seconds: Floats) -> Integers:
    """Nanoseconds of times to a microsecond, which float32 does not spoil."""
    return np.round(seconds * 1e6).astype(np.int64) * 1000


def _check_speed(scan: Scan, frames: RobotFrames, stamps_ns: Integers, odometry: Floats) -> None:
    """Raise TransformError (code "odometry-jump") for a motion that no robot makes."""
    before = stamps_ns[0] - _nanoseconds(np.linspace(_BEFORE_S, 0, 6)[:-1])
    with suppress(TransformError):  # odometry begins with the scan
        earlier = frames.odometry_from(scan.frame_id, before)
        if earlier is not None:
            odometry = np.concatenate([earlier, odometry])
            stamps_ns = np.concatenate([before, stamps_ns])
    steps_s = np.diff(stamps_ns) / NANOSECONDS
    moved = steps_s > 0
    if not moved.any():
        return
    changes = log(inverse(odometry[:-1]) @ odometry[1:])[moved] / steps_s[moved, None]
    off = np.abs(changes - np.median(changes, axis=0))
    metres, radians = (float(np.linalg.norm(part, axis=1).max()) for part in np.hsplit(off, 2))
    if metres > _JUMP_M_S or radians > _JUMP_RAD_S:
        raise TransformError(
            f"odometry jumps: in {steps_s.sum():.2f} s its velocity changes by {metres:.3g} m/s "
            f"and {radians:.3g} rad/s, expected up to {_JUMP_M_S:g} and {_JUMP_RAD_S:g}",
            may_come=False,
            code="odometry-jump",
            fields=(f"{metres:.3g}", f"{radians:.3g}"),
        )
