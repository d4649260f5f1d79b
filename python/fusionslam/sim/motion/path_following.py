# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of a differential-drive robot along paths: forwards, within its limits."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fusionslam.base.arrays import Floats
from fusionslam.config import Section, option
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.motion.smoothing import lengths

Places = Callable[[Floats], Floats]

# Metres between the points at which speeds are set; halved until no step turns more than _TURN_RAD.
_STEP_M = 0.01
_TURN_RAD = 0.05
_FEWEST_STEPS = 64
_MOST_STEPS = 1 << 20
_CORNER_RAD = np.deg2rad(60)
# Factor on the limits: curvature is known at the steps only, so the plan stays a little below.
_CAUTION = 0.98
# Steps are straight lines, a little shorter than the path.
_ROUNDING = 0.9999


class DriveLimits(Section):
    """Limits of a differential-drive robot. The defaults suit a TurtleBot3 Waffle Pi."""

    max_speed_m_s: float = option(0.69, "highest forward speed", unit="m/s", gt=0, le=50)
    max_turn_rad_s: float = option(1.2, "highest turn rate", unit="rad/s", gt=0, le=50)
    max_acceleration_m_s2: float = option(
        0.5, "highest acceleration and deceleration", unit="m/s^2", gt=0, le=100
    )
    max_turn_acceleration_rad_s2: float = option(
        2.0, "highest change of turn rate, up or down", unit="rad/s^2", gt=0, le=100
    )
    rate_hz: float = option(30.0, "poses per second", unit="1/s", ge=1, le=1000)


@dataclass(frozen=True)
class _Leg:
    """A part of a drive from stop to stop: its duration, and x, y, yaw (3, M) at times (M,)."""

    duration_s: float
    places: Places
    first_yaw: float
    last_yaw: float


def drive(paths: Sequence[ArrayLike], limits: DriveLimits) -> Trajectory:
    """Follow paths one after the other, turning on the spot between them.

    The robot stops at the end of each path, and at corners of more than 60 degrees. In between it
    always faces along the path, and slows down where curvature, or its change, would exceed the
    robot's limits: with speed v and curvature k, the turn rate is v k and its change is
    v' k + v^2 dk/ds; each of the two terms may use half the limit.

    Args:
        paths: (N, 2) each, N >= 2 points x, y in metres, not all the same, joined by a cubic
            spline; each path starts where the one before ends.
        limits: of the robot.

    """
    legs: list[_Leg] = []
    for path in chain.from_iterable(
        _without_corners(np.asarray(path, np.float64)) for path in paths
    ):
        leg = _follow(path, limits)
        if legs:
            legs.append(_turn(path[0], legs[-1].last_yaw, leg.first_yaw, limits))
        legs.append(leg)
    return _sample_legs(legs, limits.rate_hz)


def _without_corners(path: Floats) -> list[Floats]:
    """The parts of a path between its sharp corners, without repeated points."""
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-9
    path = path[np.concatenate([[True], moved])]
    ways = np.diff(path, axis=0)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    corners = 1 + np.flatnonzero((ways[1:] * ways[:-1]).sum(axis=1) < np.cos(_CORNER_RAD))
    edges = [0, *corners.tolist(), len(path) - 1]
    return [path[start : end + 1] for start, end in pairwise(edges)]


def _follow(path: Floats, limits: DriveLimits) -> _Leg:
    """Follow one path as fast as the limits allow."""
    from scipy.interpolate import CubicSpline

    along, points, yaw, curvature = _curve(path)
    speed = _speeds(along, curvature, limits)
    times = np.concatenate([[0.0], np.cumsum(2 * np.diff(along) / (speed[:-1] + speed[1:]))])
    places = CubicSpline(along, np.column_stack([points, yaw]))

    def at(seconds: Floats) -> Floats:
        """x, y, yaw at times, with constant acceleration between two points."""
        k = np.searchsorted(times, seconds, side="right").clip(1, len(times) - 1) - 1
        part = (seconds - times[k]).clip(0, times[k + 1] - times[k])
        gain = (speed[k + 1] - speed[k]) / (times[k + 1] - times[k])
        found: Floats = places(along[k] + speed[k] * part + gain * part**2 / 2).T
        return found

    return _Leg(float(times[-1]), at, float(yaw[0]), float(yaw[-1]))


def _curve(path: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Sample a path densely: metres along it (M,), points (M, 2), yaw (M,), curvature (M,)."""
    from scipy.interpolate import CubicSpline

    chord = lengths(path)
    # Straight ends: the robot starts and stops without turning.
    spline = CubicSpline(chord, path, bc_type="natural")
    steps = max(_FEWEST_STEPS, int(np.ceil(chord[-1] / _STEP_M)))
    yaw = _yaw(spline, chord[-1], steps)
    while np.abs(np.diff(yaw)).max() > _TURN_RAD and steps < _MOST_STEPS:
        steps *= 2
        yaw = _yaw(spline, chord[-1], steps)
    where = np.linspace(0, chord[-1], steps + 1)
    points, slope, bend = spline(where), spline(where, 1), spline(where, 2)
    along = lengths(points)
    cross = slope[:, 0] * bend[:, 1] - slope[:, 1] * bend[:, 0]
    return along, points, yaw, cross / np.maximum(np.linalg.norm(slope, axis=1) ** 3, 1e-9)


def _yaw(spline: Any, length: float, steps: int) -> Floats:
    """The direction of a spline at equal steps, continuous, (steps + 1,)."""
    slope = spline(np.linspace(0, length, steps + 1), 1)
    return np.unwrap(np.arctan2(slope[:, 1], slope[:, 0]))


def _speeds(along: Floats, curvature: Floats, limits: DriveLimits) -> Floats:
    """The highest speed at each step within all limits, 0 at both ends, (M,).

    A forward pass bounds acceleration, a backward pass deceleration (as Kunz and Stilman 2012 do
    for robot arms).
    """
    turning = _CAUTION * limits.max_turn_acceleration_rad_s2 / 2
    bent = np.maximum(_widest(np.abs(curvature)), 1e-9)
    change = np.maximum(_widest(np.abs(np.gradient(curvature, along))), 1e-9)
    highest = np.minimum(_CAUTION * limits.max_turn_rad_s / bent, np.sqrt(turning / change))
    squared = np.minimum(highest, _ROUNDING * limits.max_speed_m_s) ** 2
    squared[0] = squared[-1] = 0
    growth = np.minimum(_CAUTION * limits.max_acceleration_m_s2, turning / bent)
    gain = 2 * np.diff(along) * np.minimum(growth[1:], growth[:-1])
    for k in range(1, len(squared)):
        squared[k] = min(squared[k], squared[k - 1] + gain[k - 1])
    for k in range(len(squared) - 2, -1, -1):
        squared[k] = min(squared[k], squared[k + 1] + gain[k])
    speed: Floats = np.sqrt(squared)
    return speed


def _widest(values: Floats) -> Floats:
    """The maximum of each value and its two neighbours."""
    padded = np.pad(values, 1, mode="edge")
    return np.maximum(np.maximum(padded[:-2], padded[2:]), values)


def _turn(place: Floats, before: float, after: float, limits: DriveLimits) -> _Leg:
    """Turn on the spot the shorter way round: accelerate, turn at a constant rate, decelerate."""
    angle = (after - before + np.pi) % (2 * np.pi) - np.pi
    growth = _CAUTION * limits.max_turn_acceleration_rad_s2
    rate = min(_CAUTION * limits.max_turn_rad_s, float(np.sqrt(abs(angle) * growth)))
    ramp = rate / growth
    duration = abs(angle) / rate + ramp if rate > 0 else 0.0

    def at(seconds: Floats) -> Floats:
        up = np.minimum(seconds, ramp) ** 2 / 2
        down = np.maximum(seconds - (duration - ramp), 0) ** 2 / 2
        steady = np.maximum(seconds - ramp, 0) * ramp
        turned = np.sign(angle) * growth * (up + steady - down)
        return np.stack([np.full_like(turned, place[0]), np.full_like(turned, place[1]), turned])

    return _Leg(duration, at, 0.0, float(angle))


def _sample_legs(legs: Sequence[_Leg], rate_hz: float) -> Trajectory:
    """Sample the legs at a fixed rate, from 0 to the first sample at or after their end."""
    ends = np.cumsum([leg.duration_s for leg in legs])
    seconds = np.arange(int(np.ceil(ends[-1] * rate_hz - 1e-9)) + 1) / rate_hz
    leg_at = np.searchsorted(ends, seconds, side="left").clip(max=len(legs) - 1)
    found = np.empty((3, len(seconds)))
    yaw = legs[0].first_yaw
    for number, leg in enumerate(legs):
        chosen = leg_at == number
        within = seconds[chosen] - (ends[number] - leg.duration_s)
        found[:, chosen] = leg.places(within.clip(0, leg.duration_s))
        # Each leg has its own zero of yaw; the robot's yaw continues without a jump.
        found[2, chosen] += yaw - leg.first_yaw
        yaw += leg.last_yaw - leg.first_yaw
    return Trajectory(seconds, *found)
