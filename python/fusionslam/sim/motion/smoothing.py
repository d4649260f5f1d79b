# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Smooth chains of grid cells into paths that a robot can follow, within the free space."""

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.sim.motion.occupancy import OccupancyMap

STEP_M = 0.05
# Rounds of averaging neighbours: corners are rounded over half a metre.
_ROUNDS = 200
_AFTER_DRIFT = 40
# Widths of the final filter in metres; the widest that stays in the free space is used.
_WIDTHS_M = (0.2, 0.1, 0.05)
# Length scale of the sideways drift, metres.
_DRIFT_M = 2.0


def smooth_path(
    path: Floats,
    room: OccupancyMap,
    bounds: OccupancyMap,
    wander_m: float,
    rng: np.random.Generator,
) -> Floats:
    """A smooth path with the same ends, (N, 2), points about ``STEP_M`` apart.

    Args:
        path: (M, 2) corners in metres; all of them free in ``room``.
        room: the space that points may be moved to.
        bounds: the space that the result stays within; wider than ``room`` by two cells.
        wander_m: standard deviation of a slow sideways drift; less where there is no room.
        rng: decides the drift.
    """
    straight = resample_path(path, STEP_M)
    relaxed = _relax(straight, room, _ROUNDS)
    drifted = _relax(_drift_sideways(relaxed, room, wander_m, rng), room, _AFTER_DRIFT)
    for points in (resample_path(drifted, STEP_M), resample_path(relaxed, STEP_M)):
        for width in _WIDTHS_M:
            filtered = _filter(points, width / STEP_M)
            dense = resample_path(filtered, STEP_M / 5)
            if bounds.is_free(dense[:, 0], dense[:, 1]).all():
                return filtered
    return straight


def resample_path(path: Floats, step_m: float) -> Floats:
    """Resample a polyline at equal steps of about ``step_m``, ends included, (N, 2)."""
    along = lengths(path)
    count = max(2, round(float(along[-1]) / step_m) + 1)
    return interpolate_path(np.linspace(0, along[-1], count), along, path)


def interpolate_path(where: Floats, along: Floats, path: Floats) -> Floats:
    """Points of a polyline ``where`` metres along it, (M, 2), given those of its corners."""
    return np.stack([np.interp(where, along, axis) for axis in path.T], axis=1)


def lengths(path: Floats) -> Floats:
    """Metres along the path from the start to each point, (N,)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def _relax(points: Floats, room: OccupancyMap, rounds: int) -> Floats:
    """Pull points towards their neighbours as long as they stay in the room."""
    points = points.copy()
    for _ in range(rounds):
        pulled = (points[:-2] + 2 * points[1:-1] + points[2:]) / 4
        free = room.is_free(pulled[:, 0], pulled[:, 1])
        points[1:-1][free] = pulled[free]
    return points


def _drift_sideways(
    points: Floats, room: OccupancyMap, wander_m: float, rng: np.random.Generator
) -> Floats:
    """Shift points sideways by a smooth random function of path length, less in narrow places."""
    from scipy.ndimage import gaussian_filter1d, minimum_filter1d

    width = _DRIFT_M / STEP_M
    # The filtered noise has deviation 1 / sqrt(2 width sqrt(pi)), from the Gaussian's energy.
    drift = gaussian_filter1d(rng.standard_normal(len(points)), width)
    aside = wander_m * drift * np.sqrt(2 * width * np.sqrt(np.pi))
    aside *= np.minimum(1, np.minimum(lengths(points), lengths(points[::-1])[::-1]) / _DRIFT_M)
    slope = np.gradient(points, axis=0)
    normal = np.stack([-slope[:, 1], slope[:, 0]], axis=1)
    normal /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9)
    share = np.zeros(len(points))
    for tried in (0.25, 0.5, 1.0):
        moved = points + tried * aside[:, None] * normal
        share[room.is_free(moved[:, 0], moved[:, 1])] = tried
    share = gaussian_filter1d(minimum_filter1d(share, round(width)), width / 4)
    shifted: Floats = points + (share * aside)[:, None] * normal
    return shifted


def _filter(points: Floats, width: float) -> Floats:
    """Apply a Gaussian filter to points, ``width`` in points; the ends stay fixed."""
    from scipy.ndimage import gaussian_filter1d

    reach = int(np.ceil(4 * width)) + 1
    padded = np.pad(points, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    found: Floats = gaussian_filter1d(padded, width, axis=0)[reach:-reach]
    found[[0, -1]] = points[[0, -1]]
    return found
