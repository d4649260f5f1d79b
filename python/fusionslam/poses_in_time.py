# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot was on the ground at any time, out of odometry that may come late.

poses = PosesInTime()
poses.add(odometry)
try:
    x, y, yaw = poses.at(stamp_ns)
except TransformError as error:
    wait = error.may_come      # else it will never be known
"""

from math import atan2

from fusionslam.errors import ClockError, DataError
from fusionslam.messages import NANOSECONDS, FrameTransform, Odometry
from fusionslam.synchronizer import SyncConfig
from fusionslam.transforms import TransformError, TransformTree


class PosesInTime:
    """Odometry of one robot, kept for a while and interpolated.

    After the clock went back go on with a new one.

    Args:
        history_s: how long odometry is kept, in seconds before the newest.
        jump_s: odometry that lies further before the newest comes of a clock that went back; what
            lies less far back has only changed places with another message.
    """

    def __init__(self, *, history_s: float = 30.0, jump_s: float = SyncConfig().jump) -> None:
        self._tree = TransformTree(history_s=history_s)
        self._jump_ns = round(jump_s * NANOSECONDS)
        self._names: tuple[str, str] | None = None

    def add(self, odometry: Odometry) -> None:
        """Take odometry.

        Raises:
            ClockError: it lies too far before the newest.
            DataError: a pose that is none, or that of another robot or in another frame than
                before. Nothing is added where this raises.
        """
        names = odometry.frame_id or "odometry", odometry.child_frame_id or "robot"
        if self._names not in (None, names):
            frame, robot = self._names or names
            raise DataError(
                f"odometry of '{names[1]}' in '{names[0]}', expected that of '{robot}' in "
                f"'{frame}' as before: do two nodes publish it?"
            )
        newest = self._tree.newest(names[1])
        if newest is not None and newest - odometry.stamp_ns > self._jump_ns:
            back = (newest - odometry.stamp_ns) / NANOSECONDS
            raise ClockError(f"odometry lies {back:g} s before the newest")
        self._tree.add(
            FrameTransform(
                stamp_ns=odometry.stamp_ns,
                parent=names[0],
                child=names[1],
                parent_from_child=odometry.pose,
            )
        )
        self._names = names

    def at(self, stamp_ns: int) -> tuple[float, float, float]:
        """x, y in metres and yaw in radians in the odometry's frame.

        Raises:
            TransformError: not known; ``may_come`` says whether later odometry may tell.
        """
        if self._names is None:
            raise TransformError("there was no odometry yet", may_come=True)
        pose = self._tree.lookup(*self._names, stamp_ns)
        return float(pose[0, 3]), float(pose[1, 3]), atan2(pose[1, 0], pose[0, 0])
