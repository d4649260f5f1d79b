# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Occupancy maps: the free space that a robot can reach."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.base.arrays import Floats, Mask
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.sim.motion.rasterize import find_touched_cells
from fusionslam.sim.scene import Scene

# Margin around the obstacles, so that a robot can drive around a world without walls.
_MARGIN_M = 1.0
# An enclosed part of the map counts as a room if it covers at least this share of the map.
_ROOM_SHARE = 0.1
_MOST_CELLS = 100_000_000


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A grid over the ground, in the layout of ROS map_server.

    Attributes:
        occupied: bool (rows, columns), row 0 at the lowest y, column 0 at the lowest x.
        reachable: bool (rows, columns), connected free cells; False where occupied.
        resolution_m: side of a cell.
        origin: x, y of the lower left corner of cell (0, 0), metres.

    Raises:
        ShapeError: the grids are not two-dimensional, or differ in shape.
        DataError: a cell is both occupied and reachable, or the resolution is not positive.
    """

    occupied: Mask
    reachable: Mask
    resolution_m: float
    origin: tuple[float, float]

    def __post_init__(self) -> None:
        if self.occupied.ndim != 2 or self.occupied.shape != self.reachable.shape:
            raise ShapeError(
                f"occupied has shape {self.occupied.shape}, reachable {self.reachable.shape}, "
                "expected the same (rows, columns)"
            )
        if not (np.isfinite(self.resolution_m) and self.resolution_m > 0):
            raise DataError(f"the map's resolution is {self.resolution_m} m, expected more than 0")
        if (self.occupied & self.reachable).any():
            raise DataError("cells of the map are occupied and reachable, expected one of them")

    def cells(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.intp], Mask]:
        """Rows and columns of points in metres, any shape, and a mask of those on the map.

        Off the map, row and column are 0.
        """
        column = np.floor((np.asarray(x, np.float64) - self.origin[0]) / self.resolution_m)
        row = np.floor((np.asarray(y, np.float64) - self.origin[1]) / self.resolution_m)
        rows, columns = self.occupied.shape
        # Comparisons with NaN are False, so a NaN point is off the map.
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        clean = [np.where(inside, index, 0).astype(np.intp) for index in (row, column)]
        return clean[0], clean[1], inside

    def centres(self, row: ArrayLike, column: ArrayLike) -> tuple[Floats, Floats]:
        """x, y of the centres of cells, metres."""
        x = self.origin[0] + (np.asarray(column) + 0.5) * self.resolution_m
        y = self.origin[1] + (np.asarray(row) + 0.5) * self.resolution_m
        return x, y

    def is_free(self, x: ArrayLike, y: ArrayLike) -> Mask:
        """True where points in metres, any shape, are reachable; False off the map."""
        row, column, inside = self.cells(x, y)
        free: Mask = inside & self.reachable[row, column]
        return free

    def clearance(self) -> Floats:
        """Metres from each cell's centre to that of the nearest occupied cell, (rows, columns).

        float64. Cells beyond the map are unknown and count as occupied.
        """
        from scipy import ndimage

        free = np.pad(~self.occupied, 1)
        distance: Floats = ndimage.distance_transform_edt(free)[1:-1, 1:-1] * self.resolution_m
        return distance

    def inflate(self, radius_m: float) -> "OccupancyMap":
        """The map for the centre of a round robot: obstacles grown by its radius.

        Cells whose centre lies within ``radius_m`` of the centre of an occupied cell, or of one
        beyond the map, become occupied; of the remaining ``reachable`` cells, only the largest
        connected part is kept.

        Raises:
            ConfigError: the radius is negative or not finite.
        """
        if not (np.isfinite(radius_m) and radius_m >= 0):
            raise ConfigError(
                f"radius_m is {radius_m}: expected metres, 0 or more",
                code="out-of-range",
                fields=("radius_m", str(radius_m)),
            )
        # Tolerance: the distance transform's roots are rounded, but equal distances must match.
        near = self.clearance() <= radius_m * (1 + 1e-9)
        occupied = self.occupied | near
        reachable = largest_part(self.reachable & ~occupied)
        return OccupancyMap(occupied, reachable, self.resolution_m, self.origin)


def largest_part(free: Mask) -> Mask:
    """The largest 4-connected part of a grid."""
    labels, count = _label_parts(free)
    if not count:
        return np.zeros_like(free)
    sizes = np.bincount(labels.ravel())[1:]
    part: Mask = labels == 1 + int(np.argmax(sizes))
    return part


def occupancy_of(
    *scenes: Scene,
    low_m: float = 0.03,
    high_m: float = 0.32,
    resolution_m: float = 0.05,
    start: tuple[float, float] | None = None,
) -> OccupancyMap:
    """The map of a world: surfaces between two heights above z = 0 are obstacles.

    Every cell that a surface touches within the height band is occupied, so even the thinnest
    wall has no gap; parts of the map that walls cut off are not reachable. The grid covers
    everything in the band with a margin of 1 m; its origin is a multiple of the resolution.

    Args:
        scenes: collision shapes, and visual ones that a camera must not pass through.
        low_m: lower surfaces can be driven over.
        high_m: higher surfaces can be driven under.
        resolution_m: side of a cell.
        start: a point (x, y) that is reachable. Without it, the largest enclosed part that covers
            at least a tenth of the map is reachable; if there is none, the largest part.

    Raises:
        ConfigError: invalid heights or resolution, or a grid of more than 1e8 cells.
        DataError: the scene has no triangle, or one that is not finite; the start is not free.
    """
    if not (np.isfinite([low_m, high_m, resolution_m]).all() and low_m < high_m):
        raise ConfigError(f"low_m is {low_m} and high_m {high_m}: expected low_m < high_m")
    if resolution_m <= 0:
        raise ConfigError(
            f"resolution_m is {resolution_m}: expected more than 0",
            code="out-of-range",
            fields=("resolution_m", str(resolution_m)),
        )
    triangles = np.concatenate(
        [np.zeros((0, 3, 3)), *(scene.mesh.triangles for scene in scenes)], dtype=np.float64
    )
    origin, shape = _grid(triangles, low_m, high_m, resolution_m)
    occupied = find_touched_cells(triangles, (low_m, high_m), origin, shape, resolution_m)
    free = ~occupied
    if start is None:
        labels, _ = _label_parts(free)
        edge = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
        reachable = largest_part(free & ~np.isin(labels, edge))
        if reachable.sum() < _ROOM_SHARE * free.size:
            reachable = largest_part(free)
    else:
        bare = OccupancyMap(occupied, free, resolution_m, origin)
        if not bare.is_free(*start):
            raise DataError(
                f"the start {start} is occupied or off the map: expected a free place",
                code="not-free",
                fields=tuple(map(str, start)),
            )
        row, column, _ = bare.cells(*start)
        labels, _ = _label_parts(free)
        reachable = labels == labels[row, column]
    return OccupancyMap(occupied, reachable, resolution_m, origin)


def _grid(
    triangles: Floats, low: float, high: float, resolution: float
) -> tuple[tuple[float, float], tuple[int, int]]:
    """Origin and (rows, columns) of a grid around the triangles in the band, or all if none is."""
    if not len(triangles):
        raise DataError("the scene has no triangles: expected something to map", code="empty-world")
    if (bad := np.flatnonzero(~np.isfinite(triangles).all(axis=(1, 2)))).size:
        raise DataError(
            f"triangle {bad[0]} of the scene has a corner that is not finite",
            code="not-finite",
            fields=(str(bad[0]),),
        )
    height = triangles[:, :, 2]
    standing = (height.max(axis=1) >= low) & (height.min(axis=1) <= high)
    corners = triangles[standing if standing.any() else slice(None), :, :2].reshape(-1, 2)
    first = np.floor((corners.min(axis=0) - _MARGIN_M) / resolution + 1e-6)
    last = np.ceil((corners.max(axis=0) + _MARGIN_M) / resolution - 1e-6)
    columns, rows = (last - first).astype(np.int64)
    if columns * rows > _MOST_CELLS:
        raise ConfigError(
            f"resolution_m is {resolution}: the map would have {columns} x {rows} cells, "
            f"expected at most {_MOST_CELLS:.0e}"
        )
    x, y = first * resolution
    return (float(x), float(y)), (int(rows), int(columns))


def _label_parts(free: Mask) -> tuple[NDArray[np.int32], int]:
    """The connected part of each cell, numbered from 1 (0: not free), and the number of parts."""
    from scipy import ndimage

    labels, count = ndimage.label(free)
    return labels, count
