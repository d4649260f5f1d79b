# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Grids of a map seen from above: where a robot can drive, and how high things are."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Floats32, Matrix, Points
from fusionslam.base.files import PathLike, atomic_path, write_file
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError, DataError

_MOST_CELLS = 400_000_000
_HIT, _MISS, _CERTAIN = 17, -8, 100
"""Twentieths of log-odds: probabilities 0.7 and 0.4 a view, clamped at 5 (Hornung et al.,
Autonomous Robots 2013, section 3.4)."""


class GridConfig(Section):
    """How clouds are drawn into grids."""

    resolution: float = option(0.05, "side of a cell", unit="m", ge=0.01, le=100)
    lowest: float = option(
        0.3,
        "points less than this above the ground are no obstacles",
        unit="m",
        allow_inf_nan=False,
    )
    highest: float = option(
        2.0, "points more than this above the ground are no obstacles", unit="m"
    )
    max_range: float = option(30.0, "points beyond are left out", unit="m", gt=0, le=1000)
    spacing: float = option(
        0.1, "points of a surface are this far apart: nothing is seen between them", unit="m", gt=0
    )


class PlacedCloud(NamedTuple):
    """A cloud of a map.

    Attributes:
        points: float32 (N, 3), metres, the sensor at the origin.
        map_from_cloud: float64 (4, 4).
        ground_level: height of the ground in the cloud's frame, metres.
    """

    points: Points
    map_from_cloud: Matrix
    ground_level: float


@dataclass(frozen=True)
class OccupancyGrid:
    """Where a robot can drive.

    Attributes:
        cells: int8 (rows, columns): 100 occupied, 0 free, -1 unknown, as nav_msgs/OccupancyGrid;
            rows go along y, columns along x.
        resolution: side of a cell, metres.
        origin: x, y of the corner of cell (0, 0), metres.
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float]

    def save(self, path: PathLike) -> list[Path]:
        """Write it for ROS's map_server: an image (.pgm) and what it means (.yaml) beside it.

        Returns:
            Both paths.

        Raises:
            DataError: a file cannot be written.
        """
        import yaml
        from PIL import Image

        image, about = Path(path).with_suffix(".pgm"), Path(path).with_suffix(".yaml")
        grey = np.full(self.cells.shape, 205, np.uint8)
        grey[self.cells == 0] = 254
        grey[self.cells == 100] = 0
        with atomic_path(image) as temporary:
            Image.fromarray(np.flipud(grey)).save(temporary, format="PPM")
        content = {
            "image": image.name,
            "mode": "trinary",
            "resolution": self.resolution,
            "origin": [*self.origin, 0.0],
            "negate": 0,
            "occupied_thresh": 0.65,
            "free_thresh": 0.196,
        }
        write_file(about, yaml.safe_dump(content, sort_keys=False))
        return [image, about]


@dataclass(frozen=True)
class HeightGrid:
    """How high the highest point of each cell is.

    Attributes:
        heights: float32 (rows, columns), metres in the map's frame, NaN where nothing was seen;
            rows go along y, columns along x.
        resolution: side of a cell, metres.
        origin: x, y of the corner of cell (0, 0), metres.
    """

    heights: Floats32
    resolution: float
    origin: tuple[float, float]

    def save(self, path: PathLike) -> None:
        """Write it as an ESRI ASCII grid (.asc), which geographic programs read.

        Raises:
            DataError: the file cannot be written.
        """
        rows, columns = self.heights.shape
        header = (
            f"ncols {columns}\nnrows {rows}\nxllcorner {self.origin[0]}\n"
            f"yllcorner {self.origin[1]}\ncellsize {self.resolution}\nNODATA_value -9999"
        )
        shown = np.where(np.isnan(self.heights), -9999, self.heights)
        with atomic_path(Path(path)) as temporary:
            np.savetxt(temporary, np.flipud(shown), fmt="%.3f", header=header, comments="")


def draw_occupancy(
    clouds: Iterable[PlacedCloud], positions: Floats, config: GridConfig | None = None
) -> OccupancyGrid:
    """Draw where a robot can drive: cells with obstacles, and cells that rays pass.

    In each direction rays end at the nearest obstacle, else at the farthest point that was seen.
    What several clouds say of a cell adds up (log-odds).

    Args:
        clouds: one after the other, so that not all need to be in memory.
        positions: float64 (n, 2 or more): x, y of all of them, metres.

    Raises:
        ConfigError: ``highest`` is not above ``lowest``, or the map is too wide for the resolution.
        DataError: no cloud.
    """
    config = config or GridConfig()
    if not config.highest > config.lowest:
        raise ConfigError(f"highest is {config.highest:g}, expected more than {config.lowest:g} m")
    canvas = _Canvas(positions, config)
    scores = np.zeros(canvas.shape, np.int8)
    rays = _Rays(config)
    for cloud in clouds:
        points, x, y = _turn(cloud, config.max_range)
        above = points[:, 2] - cloud.ground_level
        obstacles = points[(above >= config.lowest) & (above <= config.highest)]
        seen = points[above <= config.highest]
        row, column = canvas.cell_of(x, y)
        patch = scores[canvas.patch(row, column)]
        change = np.where(rays.free(seen, obstacles), _MISS, 0).astype(np.int16)
        hit_rows, hit_columns = canvas.cells_of(obstacles, x, y)
        change[hit_rows - row + canvas.reach, hit_columns - column + canvas.reach] = _HIT
        patch[:] = np.clip(patch + change, -_CERTAIN, _CERTAIN)
    rows, columns = _known(scores != 0)
    kept = scores[rows, columns]
    cells = np.select([kept > 0, kept < 0], [100, 0], -1).astype(np.int8)
    return OccupancyGrid(cells, config.resolution, canvas.corner(rows.start, columns.start))


def draw_heights(
    clouds: Iterable[PlacedCloud], positions: Floats, config: GridConfig | None = None
) -> HeightGrid:
    """Draw the height of the highest point of each cell.

    Arguments and errors as of ``draw_occupancy``.
    """
    config = config or GridConfig()
    canvas = _Canvas(positions, config)
    heights = np.full(canvas.shape, -np.inf, np.float32)
    for cloud in clouds:
        points, x, y = _turn(cloud, config.max_range)
        highest = points[:, 2] + np.float32(cloud.map_from_cloud[2, 3])
        np.maximum.at(heights, canvas.cells_of(points, x, y), highest)
    seen = np.isfinite(heights)
    rows, columns = _known(seen)
    kept: Floats32 = np.where(seen, heights, np.float32(np.nan))[rows, columns]
    return HeightGrid(kept, config.resolution, canvas.corner(rows.start, columns.start))


class _Canvas:
    """The cells about all positions."""

    def __init__(self, positions: Floats, config: GridConfig) -> None:
        if not len(positions):
            raise DataError("a map without clouds has no grid", code="empty")
        self._cell = config.resolution
        self.reach = int(np.ceil(config.max_range / config.resolution)) + 1
        first = np.floor(np.min(positions[:, :2], axis=0) / self._cell).astype(int) - self.reach
        last = np.floor(np.max(positions[:, :2], axis=0) / self._cell).astype(int) + self.reach
        self._column, self._row = first.tolist()
        columns, rows = (last - first + 1).tolist()
        if rows * columns > _MOST_CELLS:
            raise ConfigError(
                f"the map has {rows} x {columns} cells of {self._cell:g} m, expected at most "
                f"{_MOST_CELLS}: choose a coarser resolution",
                code="choice",
                fields=("resolution", f"{self._cell:g}"),
            )
        self.shape = (rows, columns)

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a position."""
        row, column = np.floor(y / self._cell), np.floor(x / self._cell)
        return int(row) - self._row, int(column) - self._column

    def cells_of(self, points: Points, x: float, y: float) -> tuple[NDArray[np.int64], ...]:
        """Rows and columns of points about a position."""
        rows = np.floor((points[:, 1].astype(np.float64) + y) / self._cell).astype(np.int64)
        columns = np.floor((points[:, 0].astype(np.float64) + x) / self._cell).astype(np.int64)
        return rows - self._row, columns - self._column

    def patch(self, row: int, column: int) -> tuple[slice, slice]:
        """The cells within reach of a cell."""
        return (
            slice(row - self.reach, row + self.reach + 1),
            slice(column - self.reach, column + self.reach + 1),
        )

    def corner(self, row: int, column: int) -> tuple[float, float]:
        """x, y of the corner of a cell."""
        return (column + self._column) * self._cell, (row + self._row) * self._cell


class _Rays:
    """Cells about a sensor by direction and range, computed once for all clouds."""

    def __init__(self, config: GridConfig) -> None:
        reach = int(np.ceil(config.max_range / config.resolution)) + 1
        self._directions = min(int(np.ceil(2 * np.pi * reach)), 3600)
        self._spacing = config.spacing
        offsets = np.arange(-reach, reach + 1) * config.resolution
        x, y = offsets[None, :], offsets[:, None]
        # The far side of the cell, so that no wall is cleared.
        self._ranges = (np.hypot(x, y) + config.resolution).astype(np.float32)
        self._bins = self._bins_of(np.broadcast_to(x, self._ranges.shape), y).astype(np.int32)

    def _bins_of(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.int64]:
        turns = np.arctan2(y, x) / (2 * np.pi) % 1
        bins: NDArray[np.int64] = (turns * self._directions).astype(np.int64) % self._directions
        return bins

    def free(self, seen: Points, obstacles: Points) -> NDArray[np.bool_]:
        """Whether each cell about the sensor is passed by rays."""
        ends = np.zeros(self._directions, np.float32)
        np.maximum.at(ends, *self._covered(seen))
        nearest = np.full(self._directions, np.inf, np.float32)
        np.minimum.at(nearest, *self._covered(obstacles))
        passed: NDArray[np.bool_] = self._ranges < np.minimum(ends, nearest)[self._bins]
        return passed

    def _covered(self, points: Points) -> tuple[NDArray[np.int64], Floats32]:
        """The directions that points take, as wide as they are apart, and their ranges."""
        ranges = np.hypot(points[:, 0], points[:, 1])
        half = np.arctan2(self._spacing / 2, np.maximum(ranges, self._spacing))
        widths = (2 * half / (2 * np.pi) * self._directions).astype(np.int64) + 1
        first = self._bins_of(points[:, 0], points[:, 1]) - widths // 2
        rows = np.repeat(np.arange(len(points)), widths)
        steps = np.arange(len(rows)) - np.repeat(np.cumsum(widths) - widths, widths)
        return (first[rows] + steps) % self._directions, ranges[rows]


def _turn(cloud: PlacedCloud, max_range: float) -> tuple[Points, float, float]:
    """Points in axes of the map about the sensor, those in range, and the sensor's x, y."""
    pose = cloud.map_from_cloud
    points = (cloud.points @ pose[:3, :3].T.astype(np.float32)).astype(np.float32)
    near = np.hypot(points[:, 0], points[:, 1]) <= max_range
    return points[near], float(pose[0, 3]), float(pose[1, 3])


def _known(seen: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns about what was seen; one cell if nothing was."""
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if not len(rows):
        return slice(0, 1), slice(0, 1)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
