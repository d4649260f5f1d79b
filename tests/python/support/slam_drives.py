# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that drives in circles past places that it knows again, as events for ``RatSlam``."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.geometry.odometry_noise import OdometryConfig, simulate_odometry
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.ratslam import RatSlam, Sighting, Step
from fusionslam.ratslam.events import Event
from fusionslam.sensors.messages import Odometry

SECOND = 1_000_000_000
RADIUS, SPEED, PLACES = 2.0, 0.5, 16
DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.03)


def circles(laps: float, radius: float = RADIUS) -> Trajectory:
    """Counter-clockwise from the origin along x."""
    seconds = np.linspace(0, laps * 2 * np.pi * radius / SPEED, round(400 * laps))
    yaw = seconds * SPEED / radius
    return Trajectory(seconds, radius * np.sin(yaw), radius * (1 - np.cos(yaw)), yaw)


def odometry(
    way: Trajectory, errors: OdometryConfig = DRIFT, rate_hz: float = 30.0
) -> list[Odometry]:
    track = simulate_odometry(way, errors, rate_hz)
    return [
        Odometry(
            stamp_ns=int(stamp_ns),
            frame_id="odom",
            child_frame_id="base",
            pose=pose,
            linear=linear,
            angular=angular,
        )
        for stamp_ns, pose, linear, angular in zip(*track, strict=True)
    ]


def sightings(way: Trajectory, rate_hz: float = 4.0) -> list[Sighting]:
    """Views by the part of the circle that the robot is in, and where it is against the first."""
    first: list[NDArray[np.float64]] = []
    seen = []
    for second in np.arange(0.1, way.seconds[-1], 1 / rate_hz):
        x, y, yaw = (float(value) for value in way.places(second))
        place = int(yaw / (2 * np.pi) * PLACES) % PLACES
        if place == len(first):
            first.append(np.array([x, y, yaw]))
        dx, dy, turn = np.array([x, y, yaw]) - first[place]
        c, s = np.cos(first[place][2]), np.sin(first[place][2])
        turn = float(np.angle(np.exp(1j * turn)))
        where = (float(c * dx + s * dy), float(c * dy - s * dx))
        seen.append(Sighting(round(second * 1e9), place, turn, where))
    return seen


def in_order(*series: Iterable[Event]) -> list[Event]:
    """By stamp; of equal ones the earlier series first."""
    events = [event for one in series for event in one]
    return sorted(events, key=lambda event: event.stamp_ns)


def circle_events(laps: float = 2.0, errors: OdometryConfig = DRIFT) -> list[Event]:
    way = circles(laps)
    return in_order(odometry(way, errors), sightings(way))


def take(slam: RatSlam, events: Iterable[Event]) -> list[Step]:
    return [slam.step(event) for event in events]


def left_out(slam: RatSlam, events: Iterable[Event]) -> list[str]:
    """The messages of the events that were refused."""
    said = []
    for event in events:
        try:
            slam.step(event)
        except DataError as error:
            said.append(str(error))
    return said


def everything(slam: RatSlam) -> dict[str, Any]:
    """Cells, maps, memory and views of a run, to be compared by ``same``."""
    arrays = {
        f"{name}.{key}": np.array(value)
        for name in ("cells", "map", "alone")
        for key, value in getattr(slam, name).state().items()
    }
    views = b"" if slam.views is None else slam.views.to_bytes()
    return arrays | {"memory": repr(slam.memory), "views": views}


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two are equal to the last bit."""
    return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    return bool(one == other)


def errors_of(poses: Sequence[Any] | NDArray[Any], truth: NDArray[np.float64]) -> float:
    """Root mean square distance in metres; both begin at the same pose."""
    apart = np.array(poses)[:, :2] - truth[:, :2]
    return float(np.sqrt((apart**2).sum(axis=1).mean()))
