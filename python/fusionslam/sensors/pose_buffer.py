# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Interpolates a robot's pose on the ground at any time from odometry that may arrive late.

poses = PoseBuffer()
poses.add(odometry)
try:
    x, y, yaw = poses.at(stamp_ns)
except TransformError as error:
    wait = error.may_come      # else it will never be known
"""

from collections import deque
from dataclasses import replace
from math import atan2
from typing import Generic, TypeVar

from fusionslam.errors import ClockError, DataError
from fusionslam.sensors.messages import NANOSECONDS, Odometry
from fusionslam.sensors.synchronizer import SyncConfig
from fusionslam.sensors.transforms import TransformError, TransformTree

T = TypeVar("T")
Ground = tuple[float, float, float]
"""x, y in metres and yaw in radians."""


class PoseBuffer:
    """A buffer of one robot's odometry that interpolates poses.

    Use a new one after the clock jumped back.

    Args:
        history_s: how long odometry is kept, in seconds before the newest.
        jump_s: odometry that is older than the newest by more seconds means that the clock jumped
            back; if it is older by less, messages only arrived out of order.
    """

    def __init__(self, *, history_s: float = 30.0, jump_s: float = SyncConfig().jump) -> None:
        self._tree = TransformTree(history_s=history_s)
        self._jump_ns = round(jump_s * NANOSECONDS)
        self._names: tuple[str, str] | None = None

    def add(self, odometry: Odometry) -> None:
        """Add odometry.

        Raises:
            ClockError: it lies too far before the newest.
            DataError: the pose is invalid, or belongs to another robot or frame than before.
                Nothing is added then.
        """
        names = odometry.frame_id or "odometry", odometry.child_frame_id or "robot"
        if self._names not in (None, names):
            frame, robot = self._names or names
            raise DataError(
                f"odometry of '{names[1]}' in '{names[0]}', expected that of '{robot}' in "
                f"'{frame}' as before: do two nodes publish it?",
                code="two-robots",
            )
        newest = self._tree.newest(names[1])
        if newest is not None and newest - odometry.stamp_ns > self._jump_ns:
            back = (newest - odometry.stamp_ns) / NANOSECONDS
            raise ClockError(f"odometry lies {back:g} s before the newest")
        self._tree.add(replace(odometry.transform, parent=names[0], child=names[1]))
        self._names = names

    def at(self, stamp_ns: int) -> Ground:
        """x, y in metres and yaw in radians in the odometry's frame.

        Raises:
            TransformError: not known; ``may_come`` says whether later odometry may provide it.
        """
        if self._names is None:
            raise TransformError("there was no odometry yet", may_come=True, code="no-odometry")
        pose = self._tree.lookup(*self._names, stamp_ns)
        return float(pose[0, 3]), float(pose[1, 3]), atan2(pose[1, 0], pose[0, 0])


class PoseQueue(Generic[T]):
    """A queue of items that wait until odometry gives the robot's pose at their stamps.

    Args:
        history_s: how long odometry is kept, in seconds before the newest.
        most: maximum number of waiting items; beyond it the oldest is returned without a pose.

    Attributes:
        jumps: number of times the clock of odometry or of the items jumped back.
    """

    def __init__(self, *, history_s: float = 30.0, most: int = 1000) -> None:
        self.jumps = 0
        self._history_s, self._most = history_s, most
        self._start()

    def _start(self) -> None:
        self._poses = PoseBuffer(history_s=self._history_s)
        self._waiting: deque[tuple[int, T]] = deque()
        self._newest_ns: int | None = None

    def add(self, stamp_ns: int, item: T) -> list[tuple[int, T, Ground | None]]:
        """Add an item; returns what is now decided, in order: stamp, item, pose or None."""
        newest, done = self._newest_ns, []
        if newest is not None and newest - stamp_ns > NANOSECONDS * SyncConfig().jump:
            newest, done = None, self._restart()
        self._newest_ns = stamp_ns if newest is None else max(newest, stamp_ns)
        self._waiting.append((stamp_ns, item))
        return done + self._release()

    def move(self, odometry: Odometry) -> list[tuple[int, T, Ground | None]]:
        """Add odometry; returns what is now decided. Raises DataError as ``PoseBuffer.add``."""
        done = []
        try:
            self._poses.add(odometry)
        except ClockError:
            poses = PoseBuffer(history_s=self._history_s)
            poses.add(odometry)  # raises on invalid odometry, before anything changes
            done = self._restart()
            self._poses = poses
        return done + self._release()

    def flush(self) -> list[tuple[int, T, Ground | None]]:
        """Return all waiting items, with poses if known; no more odometry is expected."""
        return self._release(final=True)

    def _restart(self) -> list[tuple[int, T, Ground | None]]:
        """Return all waiting items and empty the buffers after the clock jumped back."""
        done = self._release(final=True)
        self.jumps += 1
        self._start()
        return done

    def _release(self, *, final: bool = False) -> list[tuple[int, T, Ground | None]]:
        done: list[tuple[int, T, Ground | None]] = []
        while self._waiting:
            stamp_ns, item = self._waiting[0]
            late = final or len(self._waiting) > self._most
            try:
                done.append((stamp_ns, item, self._poses.at(stamp_ns)))
            except TransformError as error:
                if error.may_come and not late:
                    break
                done.append((stamp_ns, item, None))
            self._waiting.popleft()
        return done
