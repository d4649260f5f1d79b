# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Motion of the robot between two odometry messages, from poses or velocities."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import check_types
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.rigid import is_rigid
from fusionslam.geometry.se2 import wrap
from fusionslam.ratslam.events import Event, Motion
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import NANOSECONDS, Odometry

Ground = tuple[float, float, float]
"""x, y in metres and heading in radians."""


# Restarted odometry begins within this of its origin, after being farther away than _AWAY_*.
_ORIGIN_M, _ORIGIN_RAD = 0.05, 0.05
_AWAY_M, _AWAY_RAD = 0.5, 0.5


FORGOTTEN_NS = -(2**62) - 1
"""Stamp of odometry whose clock went back, earlier than that of any event."""


class Limits(NamedTuple):
    """Limits of plausible odometry: gap in seconds, speed in m/s, step length in metres.

    After a silence of ``max_silence`` seconds, the robot may have been carried.
    """

    gap: float
    max_speed: float
    max_way: float = math.inf
    max_silence: float = math.inf


class MotionStep(NamedTuple):
    """One odometry step: m/s forward, rad/s, duration in seconds, and a note.

    After a gap, or if it moved sideways, the path is a straight line instead of an arc: ``bearing``
    gives its direction, in radians relative to the heading before. If odometry was
    ``interrupted``, by a restart, a jump or a long silence, the robot may have been carried.
    """

    v: float
    w: float
    dt: float
    note: str = ""
    bearing: float | None = None
    interrupted: bool = False

    @property
    def legs(self) -> list[tuple[float, float, float]]:
        """The step as consecutive (v, w, dt)."""
        if self.bearing is None:
            return [(self.v, self.w, self.dt)]
        third, rest = self.dt / 3, self.w * self.dt - self.bearing
        return [
            (0.0, self.bearing / third, third),
            (3 * self.v, 0.0, third),
            (0.0, rest / third, third),
        ]


class Odometry2D(NamedTuple):
    """One odometry message: stamp, pose if known, velocity if known, m/s to the left."""

    stamp_ns: int
    pose: Ground | None
    speed: tuple[float, float] | None
    sideways: float = 0.0


def odometry_from(values: Any) -> Odometry2D | None:
    """Rebuild odometry from JSON. Raises TypeError or ValueError for other values."""
    if values is None:
        return None
    stamp_ns, pose, speed, sideways = values
    return check_types(Odometry2D(stamp_ns, pose and tuple(pose), speed and tuple(speed), sideways))


def odometry_of(event: Event) -> Odometry2D | None:
    """The odometry in an event, projected onto the ground; None if it has none.

    ``step_between`` prefers poses, because their differences hold at any rate. Velocities are used
    if the pose is not finite, and for ``Motion``, which has nothing else.

    Raises:
        DataError: neither pose nor velocity is finite, or a pose is no rotation and translation.
        ShapeError: wrong shapes.
    """
    if isinstance(event, Motion):
        speed = _finite_speed(event.v, event.w, event.sideways)
        odometry = Odometry2D(
            int(event.stamp_ns), None, speed, float(event.sideways) if speed else 0.0
        )
    elif isinstance(event, Odometry):
        for name, shape in (("pose", (4, 4)), ("linear", (3,)), ("angular", (3,))):
            _check_shape(event.stamp_ns, name, getattr(event, name), shape)
        speed = _finite_speed(float(event.linear[0]), float(event.angular[2]))
        odometry = Odometry2D(int(event.stamp_ns), _ground(event.stamp_ns, event.pose), speed)
    elif isinstance(event, Frame) and event.odometry is not None:
        _check_shape(event.stamp_ns, "odometry", event.odometry, (4, 4))
        odometry = Odometry2D(int(event.stamp_ns), _ground(event.stamp_ns, event.odometry), None)
    else:
        return None
    if odometry.pose is None and odometry.speed is None:
        raise DataError(f"odometry at {odometry.stamp_ns} ns: neither a finite pose nor velocity")
    return odometry


def step_between(before: Odometry2D | None, now: Odometry2D, limits: Limits) -> MotionStep | None:
    """The robot's motion from one message to the next; None for the first one.

    A gap longer than ``limits.gap`` is noted. Poses still give the motion over the gap; a velocity
    counts for ``limits.gap`` at most. Poses faster than ``limits.max_speed`` or farther than
    ``limits.max_way`` apart are a jump; a pose back at the origin after a gap is a restart of the
    driver, or of the robot where it stood. After either, the velocity counts if there is one, else
    the robot did not move. Jumps, restarts and silences longer than ``limits.max_silence`` are
    marked as ``interrupted``.

    Raises:
        DataError: a stamp that is not later, or neither two poses nor a velocity.
    """
    if before is None:
        return None
    if before.stamp_ns == FORGOTTEN_NS:
        step = _step_after_jump(before, now, limits)
        return step and step._replace(interrupted=True)
    dt = (now.stamp_ns - before.stamp_ns) / NANOSECONDS
    if dt <= 0:
        raise DataError(
            f"odometry at {now.stamp_ns} ns: expected a stamp later than {before.stamp_ns} ns"
        )
    silent = dt > limits.max_silence
    if before.pose is None or now.pose is None:
        return _step_by_speed(now, dt, limits)._replace(interrupted=silent)
    forward, turn = _displacement_between(before.pose, now.pose)
    way = _distance(before.pose, now.pose)
    known = now._replace(speed=now.speed or (0.0, 0.0))
    if way > min(limits.max_speed * dt, limits.max_way):
        jumped = _step_by_speed(known, dt, limits, f"odometry jumped {way:.4g} m, ignored")
        return jumped._replace(interrupted=True)
    if dt > limits.gap and _is_reset(before.pose, now.pose):
        note = f"odometry was reset after {dt:.2f} s: {way:.2f} m back to its origin, ignored"
        return _step_by_speed(known, dt, limits, note)._replace(interrupted=True)
    if dt <= limits.gap:
        return MotionStep(forward / dt, turn / dt, dt)
    note = f"odometry was silent for {dt:.2f} s: {way:.2f} m in one step"
    return _straight_step(before.pose, now.pose, dt, note)._replace(interrupted=silent)


def _step_after_jump(before: Odometry2D, now: Odometry2D, limits: Limits) -> MotionStep | None:
    """The motion since the clock went back; its unknown duration is chosen to fit the limits."""
    if before.pose is None or now.pose is None:
        return None
    way = _distance(before.pose, now.pose)
    if way > limits.max_way:
        return None
    note = f"the clock went back, and odometry is {way:.2f} m from its last position"
    dt = max(limits.gap, 2 * way / limits.max_speed)
    return _straight_step(before.pose, now.pose, dt, note)


def _straight_step(before: Ground, now: Ground, dt: float, note: str) -> MotionStep:
    """The step along the straight line from one pose to another."""
    way, turn = _distance(before, now), wrap(now[2] - before[2])
    bearing = float(np.arctan2(now[1] - before[1], now[0] - before[0]))
    return _step_along(bearing - before[2], way, turn, dt, note)


def _step_along(bearing: float, way: float, turn: float, dt: float, note: str) -> MotionStep:
    """The step along a straight line at a bearing, radians relative to the heading before."""
    ahead = wrap(bearing)
    if abs(ahead) > np.pi / 2:  # backwards
        way, ahead = -way, ahead - float(np.copysign(np.pi, ahead))
    return MotionStep(way / dt, turn / dt, dt, note, ahead)


def _step_by_speed(now: Odometry2D, dt: float, limits: Limits, note: str = "") -> MotionStep:
    if now.speed is None:
        raise DataError(f"odometry at {now.stamp_ns} ns: no previous pose, and no velocity")
    v, w = now.speed
    speed = math.hypot(v, now.sideways)
    if speed > limits.max_speed or speed * min(dt, limits.gap) > limits.max_way:
        fast = math.copysign(speed, v)
        return MotionStep(0.0, 0.0, dt, f"odometry has a speed of {fast:.4g} m/s, ignored")
    if not note and dt > limits.gap:
        note = f"odometry was silent for {dt:.2f} s: its velocity counts for {limits.gap:g} s"
    dt = min(dt, limits.gap)
    if not now.sideways:
        return MotionStep(v, w, dt, note)
    bearing = w * dt / 2 + math.atan2(now.sideways, v)
    return _step_along(bearing, math.hypot(v, now.sideways) * dt, w * dt, dt, note)


def _distance(before: Ground, now: Ground) -> float:
    return float(np.hypot(now[0] - before[0], now[1] - before[1]))


def _is_reset(before: Ground, now: Ground) -> bool:
    """True if odometry is back at its origin and was elsewhere before."""
    away = np.hypot(*before[:2]) > _AWAY_M or abs(before[2]) > _AWAY_RAD
    return bool(away and np.hypot(*now[:2]) <= _ORIGIN_M and abs(now[2]) <= _ORIGIN_RAD)


def _displacement_between(before: Ground, now: Ground) -> tuple[float, float]:
    """Metres forward along the heading at mid-step, and turn in radians."""
    turn = wrap(now[2] - before[2])
    middle = before[2] + turn / 2
    dx, dy = now[0] - before[0], now[1] - before[1]
    return float(np.cos(middle) * dx + np.sin(middle) * dy), turn


def _check_shape(stamp_ns: int, name: str, found: Any, shape: tuple[int, ...]) -> None:
    if np.shape(found) != shape or np.asarray(found).dtype.kind not in "fiu":
        raise ShapeError(
            f"odometry at {stamp_ns} ns: {name} {found!r}, expected numbers {shape}",
            fields=(name,),
        )


def _ground(stamp_ns: int, pose: NDArray[np.float64]) -> Ground | None:
    if not np.isfinite(pose).all():
        return None
    if not is_rigid(pose):
        raise DataError(
            f"odometry at {stamp_ns} ns: the pose is no rotation and translation: {pose.tolist()}",
            code="not-a-rotation",
            fields=("pose",),
        )
    return float(pose[0, 3]), float(pose[1, 3]), float(np.arctan2(pose[1, 0], pose[0, 0]))


def _finite_speed(v: float, w: float, sideways: float = 0.0) -> tuple[float, float] | None:
    try:
        speed = float(v), float(w), float(sideways)
    except (TypeError, ValueError, OverflowError):
        found = f"v {v!r}, w {w!r}, sideways {sideways!r}"
        raise DataError(f"odometry {found}: expected numbers") from None
    return speed[:2] if np.isfinite(speed).all() else None
