# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Rasterise triangles onto a grid over the ground, exactly and without gaps."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats

Cells = NDArray[np.int64]

# Most corners of a triangle cut by two planes.
_CORNERS = 5
# Pairs of polygon and cell tested at a time.
_PIECE = 1 << 20
# In cells: a point this close to the border of two cells counts as on it.
_ON_BORDER = 1e-4


def find_touched_cells(
    triangles: Floats,
    band: tuple[float, float],
    origin: tuple[float, float],
    shape: tuple[int, int],
    resolution_m: float,
) -> NDArray[np.bool_]:
    """Cells above or below any part of a triangle that lies between two heights.

    A point exactly on the border of two cells belongs to the upper or right one only.

    Args:
        triangles: float64 (T, 3, 3), metres.
        band: lowest and highest z.
        origin: x, y of the lower left corner of the grid.
        shape: (rows, columns).
        resolution_m: side of a cell.

    Returns:
        bool ``shape``, row 0 at the lowest y.
    """
    polygons = clip_triangles(triangles, band)
    plan = (polygons[:, :, :2] - np.asarray(origin)) / resolution_m
    low = np.floor(plan.min(axis=1) + _ON_BORDER).astype(np.int64)
    high = np.ceil(plan.max(axis=1) - _ON_BORDER).astype(np.int64) - 1
    limit = np.array([shape[1], shape[0]]) - 1
    high = np.minimum(np.maximum(high, low), limit)
    low = np.maximum(low, 0)
    touched = np.zeros(shape, dtype=bool)
    for polygon, cell in _pairs(low, high):
        hit = cell[_overlap(plan[polygon], cell)]
        touched[hit[:, 1], hit[:, 0]] = True
    return touched


def clip_triangles(triangles: Floats, band: tuple[float, float]) -> Floats:
    """The parts of triangles between two heights, float64 (P, 5, 3).

    Polygons with fewer corners repeat one (Sutherland and Hodgman 1974, two planes).
    """
    height = triangles[:, :, 2]
    meets = (height.max(axis=1) >= band[0]) & (height.min(axis=1) <= band[1])
    inside = (height >= band[0]).all(axis=1) & (height <= band[1]).all(axis=1)
    whole = triangles[inside]
    padded = np.concatenate([whole, np.repeat(whole[:, :1], _CORNERS - 3, axis=1)], axis=1)
    cut = [_cut(triangle, band) for triangle in triangles[meets & ~inside]]
    return np.concatenate([padded, np.array(cut).reshape(-1, _CORNERS, 3)])


def _cut(triangle: Floats, band: tuple[float, float]) -> Floats:
    """The part within the band of one triangle that meets it, (5, 3)."""
    corners = list(triangle)
    for bound, side in ((band[0], 1.0), (band[1], -1.0)):
        kept: list[Floats] = []
        for before, after in zip(corners[-1:] + corners[:-1], corners, strict=True):
            depth = side * (before[2] - bound), side * (after[2] - bound)
            if min(depth) < 0 <= max(depth):
                part = depth[0] / (depth[0] - depth[1])
                kept.append(before + part * (after - before))
            if depth[1] >= 0:
                kept.append(after)
        corners = kept
    return np.array((corners + corners[:1] * _CORNERS)[:_CORNERS])


def _pairs(low: Cells, high: Cells) -> Iterator[tuple[Cells, Cells]]:
    """Pairs of each polygon and the cells of its bounding rectangle, (K,) and (K, 2), in chunks.

    Args:
        low, high: int64 (P, 2), first and last column and row.
    """
    width, height = np.maximum(high - low + 1, 0).T
    ends = np.cumsum(width * height)
    total = int(ends[-1]) if len(ends) else 0
    for start in range(0, total, _PIECE):
        number = np.arange(start, min(start + _PIECE, total))
        polygon = np.searchsorted(ends, number, side="right")
        inside = number - (ends - width * height)[polygon]
        row, column = np.divmod(inside, width[polygon])
        yield polygon, low[polygon] + np.stack([column, row], axis=1)


def _overlap(polygons: Floats, cell: Cells) -> NDArray[np.bool_]:
    """True where convex polygons meet cells within their bounding rectangles, (K,).

    Separating axis test on the polygons' sides (the axes of the cells never separate them, by
    construction).

    Args:
        polygons: float64 (K, 5, 2), in cells.
        cell: int64 (K, 2), column and row.
    """
    centred = polygons - (cell + 0.5)[:, None]
    apart = np.zeros(len(cell), dtype=bool)
    for k in range(_CORNERS):
        side = centred[:, (k + 1) % _CORNERS] - centred[:, k]
        normal = np.stack([-side[:, 1], side[:, 0]], axis=1)
        reach = 0.5 * np.abs(normal).sum(axis=1)
        along = np.einsum("kij,kj->ki", centred, normal)
        # At least twice the shift that moved a line on a border into its cell's rectangle.
        slack = 4 * _ON_BORDER * reach
        apart |= (along.min(axis=1) > reach + slack) | (along.max(axis=1) < -reach - slack)
    return ~apart
