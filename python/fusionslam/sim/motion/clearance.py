# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Check that a trajectory keeps its distance from obstacles."""

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.motion.occupancy import OccupancyMap


def check_trajectory(trajectory: Trajectory, grid: OccupancyMap, radius_m: float) -> None:
    """Raise DataError unless a round robot has room along the whole trajectory.

    Segments between poses are checked too, in steps of half a cell, so that no wall is skipped.

    Args:
        trajectory: to be driven.
        grid: map of the obstacles.
        radius_m: of the robot.

    Raises:
        DataError: the robot meets an obstacle (code "blocked") or leaves the map ("off-map");
            message and fields give the first time, its x and y, and the total time blocked.
        ConfigError: the radius is negative or not finite.
    """
    times = _dense_times(trajectory, grid.resolution_m / 2)
    x, y, _ = trajectory.places(times)
    row, column, inside = grid.cells(x, y)
    blocked = ~grid.is_free(x, y) | grid.inflate(radius_m).occupied[row, column]
    if blocked.any():
        first = int(np.argmax(blocked))
        seconds = float(np.gradient(times)[blocked].sum())
        what = "meets an obstacle" if inside[first] else "leaves the map"
        low, cells = np.array(grid.origin), np.array(grid.occupied.shape[::-1])
        high = low + cells * grid.resolution_m
        why = f"a robot of radius {radius_m} m has no room there"
        if not inside[first]:
            why = f"it has x from {low[0]:.2f} to {high[0]:.2f} m and y from {low[1]:.2f} to "
            why += f"{high[1]:.2f} m"
        at = (_digits(times[first]), f"{x[first]:.2f}", f"{y[first]:.2f}", _digits(seconds))
        raise DataError(
            f"the trajectory {what} at {at[0]} s at ({at[1]}, {at[2]}) m: {why}; {at[3]} s of "
            f"{_digits(trajectory.duration_s)} s are blocked",
            code="blocked" if inside[first] else "off-map",
            fields=at,
        )


def _digits(seconds: float) -> str:
    """Seconds with two decimals; times below 1 s with three significant digits."""
    return f"{seconds:.2f}" if abs(seconds) >= 1 or seconds == 0 else f"{seconds:.3g}"


def _dense_times(trajectory: Trajectory, step_m: float) -> Floats:
    """The trajectory's times, subdivided so that no step is longer than ``step_m``."""
    distance = np.hypot(np.diff(trajectory.x), np.diff(trajectory.y))
    counts = np.maximum(np.ceil(distance / step_m), 1).astype(np.int64)
    number = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(number)) - np.repeat(np.cumsum(counts) - counts, counts)
    gap = np.diff(trajectory.seconds)
    times = trajectory.seconds[number] + within / counts[number] * gap[number]
    return np.append(times, trajectory.seconds[-1])
