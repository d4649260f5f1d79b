# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of boxes and turned bodies, and points on them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError

Triangles = NDArray[np.float64]
"""Float64 (T, 3, 3): corners of triangles."""
Points = NDArray[np.float32]

_SEGMENTS = 20
# Corners of the six faces of a box, as signs of its half sizes.
_FACES = np.array(
    [
        [[s if a == axis else u[0] if a == (axis + 1) % 3 else u[1] for a in range(3)] for u in _U]
        for axis in range(3)
        for s in (-1, 1)
        for _U in [((-1, -1), (1, -1), (1, 1), (-1, 1))]
    ],
    np.float64,
)


def box(size: Sequence[float], at: Sequence[float] = (0, 0, 0)) -> Triangles:
    """A box of sizes x, y, z whose floor has its centre ``at`` x, y, z."""
    centre = np.array([at[0], at[1], at[2] + size[2] / 2])
    corners = _FACES * np.asarray(size, np.float64) / 2 + centre
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


def turned(
    profile: Sequence[tuple[float, float]],
    at: Sequence[float] = (0, 0, 0),
    segments: int = _SEGMENTS,
) -> Triangles:
    """The surface that a line of (radius, height) sweeps around the z axis through ``at``.

    Three or four segments make it a prism or a pyramid.
    """
    radius, height = np.asarray(profile, np.float64).T
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    x, y = (np.outer(radius, turn(angle)) for turn in (np.cos, np.sin))
    grid = np.stack([x, y, np.broadcast_to(height[:, None], x.shape)], axis=2) + np.asarray(at)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    return np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])


def cylinder(radius: float, height: float, at: Sequence[float] = (0, 0, 0)) -> Triangles:
    """A closed cylinder that stands on ``at``."""
    return turned([(0, 0), (radius, 0), (radius, height), (0, height)], at)


def cone(low: float, high: float, height: float, at: Sequence[float] = (0, 0, 0)) -> Triangles:
    """A closed cone or frustum of two radii that stands on ``at``."""
    return turned([(0, 0), (low, 0), (high, height), (0, height)], at)


def ball(radii: tuple[float, float], at: Sequence[float] = (0, 0, 0)) -> Triangles:
    """An ellipsoid of horizontal and vertical radius around ``at``."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 10)
    return turned([(radii[0] * np.cos(t), radii[1] * np.sin(t)) for t in angle], at)


def ring(radius: float, thickness: float, at: Sequence[float] = (0, 0, 0)) -> Triangles:
    """A torus around the z axis with its middle ``at``."""
    angle = np.linspace(0, 2 * np.pi, 11)
    return turned([(radius + thickness * np.cos(t), thickness * np.sin(t)) for t in angle], at)


def tipped(triangles: Triangles, axis: int, angle: float) -> Triangles:
    """Turned about the x (0), y (1) or z (2) axis by an angle, radians."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[first, first] = turn[second, second] = np.cos(angle)
    turn[second, first], turn[first, second] = np.sin(angle), -np.sin(angle)
    return triangles @ turn.T


def moved(triangles: Triangles, by: Sequence[float]) -> Triangles:
    """Shifted by x, y, z."""
    return triangles + np.asarray(by, np.float64)


def sample_surface(triangles: Triangles, count: int, rng: np.random.Generator) -> Points:
    """Points spread evenly over triangles.

    Args:
        triangles: float64 (T, 3, 3).
        count: how many points.
        rng: decides where.

    Returns:
        float32 (count, 3).

    Raises:
        DataError: the triangles have no area, or one that is not finite.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    total = float(area.sum())
    if not (np.isfinite(total) and total > 0):
        raise DataError(f"{len(triangles)} triangles of area {total / 2:g}, expected some surface")
    chosen = np.searchsorted(np.cumsum(area) / total, rng.random(count)).clip(max=len(area) - 1)
    # Square root: evenly over the triangle, not denser at a corner.
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    points: Points = np.einsum("nk,nkd->nd", weights, triangles[chosen]).astype(np.float32)
    return points
