# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where there is room for a robot."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.sim.motion.rasterize import cells_touched
from fusionslam.sim.scene import Scene
from fusionslam.storage.arrays import Floats, Mask

# Room around what stands in a world: worlds without walls are driven around, too.
_MARGIN_M = 1.0
# A part of the map that walls enclose is a room only from this share of the map on.
_ROOM_SHARE = 0.1
_MOST_CELLS = 100_000_000


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A grid over the ground, in the layout of ROS map_server.

    Attributes:
        occupied: bool (rows, columns), row 0 at the lowest y, column 0 at the lowest x.
        reachable: bool (rows, columns), free cells that belong together; False where occupied.
        resolution_m: side of a cell.
        origin: x, y of the lower left corner of cell (0, 0), metres.

    Raises:
        ShapeError: the two grids differ in shape, or are none.
        DataError: a cell is both, or the resolution is no length.
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
        """Rows and columns of places in metres, any shape, and whether they are on the map.

        Where they are not, row and column are 0.
        """
        column = np.floor((np.asarray(x, np.float64) - self.origin[0]) / self.resolution_m)
        row = np.floor((np.asarray(y, np.float64) - self.origin[1]) / self.resolution_m)
        rows, columns = self.occupied.shape
        # Comparisons with NaN are False: a place that is no number is not on the map.
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        clean = [np.where(inside, index, 0).astype(np.intp) for index in (row, column)]
        return clean[0], clean[1], inside

    def centres(self, row: ArrayLike, column: ArrayLike) -> tuple[Floats, Floats]:
        """x, y of the middles of cells, metres."""
        x = self.origin[0] + (np.asarray(column) + 0.5) * self.resolution_m
        y = self.origin[1] + (np.asarray(row) + 0.5) * self.resolution_m
        return x, y

    def is_free(self, x: ArrayLike, y: ArrayLike) -> Mask:
        """Whether places in metres, any shape, are reachable; False beyond the map."""
        row, column, inside = self.cells(x, y)
        free: Mask = inside & self.reachable[row, column]
        return free

    def clearance(self) -> Floats:
        """float64 (rows, columns): metres from each cell's middle to that of an occupied one.

        Nobody knows what lies beyond the map: cells there count as occupied.
        """
        from scipy import ndimage

        free = np.pad(~self.occupied, 1)
        distance: Floats = ndimage.distance_transform_edt(free)[1:-1, 1:-1] * self.resolution_m
        return distance

    def inflated(self, radius_m: float) -> "OccupancyMap":
        """The map for the middle of a round robot: obstacles grown by its radius.

        Cells whose middle lies within ``radius_m`` of the middle of an occupied one, or of one
        beyond the map, become occupied; of what is left of ``reachable``, the largest connected
        part stays.

        Raises:
            ConfigError: the radius is no length.
        """
        if not (np.isfinite(radius_m) and radius_m >= 0):
            raise ConfigError(f"radius_m is {radius_m}: expected metres, 0 or more")
        # The distance transform's roots are rounded: equal distances must compare as equal.
        near = self.clearance() <= radius_m * (1 + 1e-9)
        occupied = self.occupied | near
        reachable = largest_part(self.reachable & ~occupied)
        return OccupancyMap(occupied, reachable, self.resolution_m, self.origin)


def largest_part(free: Mask) -> Mask:
    """The largest part of a grid that hangs together over the sides of cells."""
    labels, count = _labelled(free)
    if not count:
        return np.zeros_like(free)
    sizes = np.bincount(labels.ravel())[1:]
    part: Mask = labels == 1 + int(np.argmax(sizes))
    return part


def part_holding(free: Mask, row: int, column: int) -> Mask:
    """The part of a grid that hangs together with a cell; empty where that cell is not free."""
    labels, _ = _labelled(free)
    part: Mask = (labels == labels[row, column]) & free
    return part if free[row, column] else np.zeros_like(free)


def occupancy_of(
    *scenes: Scene,
    low_m: float = 0.03,
    high_m: float = 0.32,
    resolution_m: float = 0.05,
    start: tuple[float, float] | None = None,
) -> OccupancyMap:
    """The map of a world: what stands between two heights above z = 0 is in a robot's way.

    Every cell that a surface touches within the band is occupied, so the thinnest wall has no
    gap; what walls enclose is not reachable. The grid covers what stands in the band and 1 m
    around it, its origin a multiple of the resolution.

    Args:
        scenes: collision shapes, and visual ones where a camera must not pass through them.
        low_m: what lies lower can be driven over.
        high_m: what lies higher can be driven under.
        resolution_m: side of a cell.
        start: a place (x, y) that is reachable. Without it, the largest part of the map that
            walls enclose and that takes at least a tenth of it; if there is none, the largest.

    Raises:
        ConfigError: heights or resolution without sense, or a grid of more than 1e8 cells.
        DataError: the scene has no triangle, or one that is not finite; the start is not free.
    """
    if not (np.isfinite([low_m, high_m, resolution_m]).all() and low_m < high_m):
        raise ConfigError(f"low_m is {low_m} and high_m {high_m}: expected low_m < high_m")
    if resolution_m <= 0:
        raise ConfigError(f"resolution_m is {resolution_m}: expected more than 0")
    triangles = np.concatenate(
        [np.zeros((0, 3, 3)), *(scene.mesh.triangles for scene in scenes)], dtype=np.float64
    )
    origin, shape = _grid(triangles, low_m, high_m, resolution_m)
    occupied = cells_touched(triangles, (low_m, high_m), origin, shape, resolution_m)
    free = ~occupied
    if start is None:
        reachable = _main_part(free)
    else:
        bare = OccupancyMap(occupied, free, resolution_m, origin)
        if not bare.is_free(*start):
            raise DataError(f"the start {start} is occupied or off the map: expected a free place")
        row, column, _ = bare.cells(*start)
        reachable = part_holding(free, int(row), int(column))
    return OccupancyMap(occupied, reachable, resolution_m, origin)


def _grid(
    triangles: Floats, low: float, high: float, resolution: float
) -> tuple[tuple[float, float], tuple[int, int]]:
    """Origin and (rows, columns) of a grid around what stands in the band, or around all."""
    if not len(triangles):
        raise DataError("the scene has no triangles: expected something to map")
    if (bad := np.flatnonzero(~np.isfinite(triangles).all(axis=(1, 2)))).size:
        raise DataError(f"triangle {bad[0]} of the scene has a corner that is not finite")
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


def _main_part(free: Mask) -> Mask:
    """The largest part that does not reach the map's edge, if it is a room; else the largest."""
    labels, _ = _labelled(free)
    edge = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    room = largest_part(free & ~np.isin(labels, edge))
    return room if room.sum() >= _ROOM_SHARE * free.size else largest_part(free)


def _labelled(free: Mask) -> tuple[NDArray[np.int32], int]:
    """The number of each cell's part from 1, 0 where it is not free, and how many there are."""
    from scipy import ndimage

    labels, count = ndimage.label(free)
    return labels, count
