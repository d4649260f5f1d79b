# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories of a robot on the ground."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from fusionslam.base.arrays import Floats
from fusionslam.base.files import PathLike, reading, write_file
from fusionslam.errors import DataError, ShapeError

_COLUMNS = ("t", "x", "y", "yaw")
_EXPECTED = "a trajectory: a line 't,x,y,yaw', then seconds, metres, metres, radians"
# In seconds: times beyond the ends by no more than this are taken for rounding errors.
_ROUNDING_S = 1e-6


@dataclass(frozen=True, eq=False)
class Trajectory:
    """N >= 2 poses of a robot's base on the ground, connected by straight lines.

    Attributes:
        seconds: float64 (N), increasing.
        x, y: float64 (N), metres in the world frame.
        yaw: float64 (N), radians, continuous (not wrapped), from x towards y.

    Raises:
        ShapeError: the arrays differ in length, or hold fewer than two poses.
        DataError: a value is not finite, or a time is not later than the one before.
    """

    seconds: Floats
    x: Floats
    y: Floats
    yaw: Floats

    def __post_init__(self) -> None:
        arrays = [self.seconds, self.x, self.y, self.yaw]
        shapes = [np.shape(array) for array in arrays]
        if len(set(shapes)) > 1 or len(shapes[0]) != 1 or shapes[0][0] < 2:
            raise ShapeError(f"seconds, x, y, yaw have shapes {shapes}, expected (N,), N >= 2")
        if (bad := np.flatnonzero(~np.isfinite(arrays).all(axis=0))).size:
            raise DataError(
                f"place {bad[0]} of the trajectory is not finite",
                code="not-finite",
                fields=(str(bad[0]),),
            )
        if (back := np.flatnonzero(np.diff(self.seconds) <= 0)).size:
            time = self.seconds[back[0] + 1]
            raise DataError(
                f"place {back[0] + 1} of the trajectory, at {time} s, is not later",
                code="not-later",
                fields=(str(back[0] + 1), str(time)),
            )

    def __len__(self) -> int:
        return len(self.seconds)

    @property
    def duration_s(self) -> float:
        """Seconds from the first pose to the last."""
        return float(self.seconds[-1] - self.seconds[0])

    @property
    def length_m(self) -> float:
        """Metres driven."""
        return float(np.hypot(np.diff(self.x), np.diff(self.y)).sum())

    def places(self, seconds: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Interpolate x, y and yaw at times, (M,) each.

        Raises:
            DataError: a time is before the first pose or after the last.
        """
        times = np.asarray(seconds, np.float64)
        first, last = self.seconds[0], self.seconds[-1]
        outside = ~((times >= first - _ROUNDING_S) & (times <= last + _ROUNDING_S))
        if outside.any():
            raise DataError(
                f"the trajectory has no place at {times[outside][0]} s: it lasts from {first} "
                f"to {last} s",
                code="no-pose",
                fields=(str(times[outside][0]),),
            )
        x, y, yaw = (np.interp(times, self.seconds, v) for v in (self.x, self.y, self.yaw))
        return x, y, yaw

    def at(self, seconds: ArrayLike) -> Floats:
        """float64 (M, 4, 4), world_from_base at times (M,).

        Raises:
            DataError: a time is before the first pose or after the last.
        """
        return ground_poses(*self.places(np.atleast_1d(seconds)))

    def speeds(self) -> tuple[Floats, Floats]:
        """Forward speed in m/s and turn rate in rad/s at each pose, (N,) each."""
        dx, dy, turn = (np.gradient(v, self.seconds) for v in (self.x, self.y, self.yaw))
        return dx * np.cos(self.yaw) + dy * np.sin(self.yaw), turn


def ground_poses(x: Floats, y: Floats, yaw: Floats) -> Floats:
    """float64 (N, 4, 4) of poses on the ground, (N,) each: z points up and is 0."""
    poses = np.tile(np.eye(4), (len(x), 1, 1))
    c, s = np.cos(yaw), np.sin(yaw)
    poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = c, -s, s, c
    poses[:, 0, 3], poses[:, 1, 3] = x, y
    return poses


def read_trajectory(path: PathLike) -> Trajectory:
    """Read a trajectory from a CSV file: the line ``t,x,y,yaw``, then one pose per line.

    Raises:
        DataError: the file is missing, has other columns or fewer than two poses; a value is not
            a finite number; or a time is not later than the one before; the message names the line.
    """
    path = Path(path)
    with reading(path, _EXPECTED):
        reader = csv.reader(path.read_text(encoding="utf-8-sig").splitlines())
        lines = [(reader.line_num, cells) for cells in reader if any(map(str.strip, cells))]
    if not lines or tuple(name.strip() for name in lines[0][1]) != _COLUMNS:
        found = repr(",".join(lines[0][1])) if lines else "nothing"
        raise DataError(
            f"{path} starts with {found}: expected {_EXPECTED}",
            code="bad-header",
            fields=(str(path), found),
        )
    if len(lines) < 3:
        places = "no place" if len(lines) == 1 else "one place"
        raise DataError(
            f"{path} has {places}, expected at least two",
            code="too-short",
            fields=(str(path), str(len(lines) - 1)),
        )
    rows = np.array([_row(path, number, cells) for number, cells in lines[1:]])
    if (back := np.flatnonzero(np.diff(rows[:, 0]) <= 0)).size:
        number = lines[back[0] + 2][0]
        raise DataError(
            f"{path}, line {number}: not later than the line before",
            code="not-later",
            fields=(str(path), str(number)),
        )
    t, x, y, yaw = np.ascontiguousarray(rows.T)
    return Trajectory(t, x, y, np.unwrap(yaw))


def write_trajectory(path: PathLike, trajectory: Trajectory) -> None:
    """Write a trajectory as CSV with all digits, so that it is read back exactly.

    Raises:
        DataError: the file cannot be written.
    """
    columns = (trajectory.seconds, trajectory.x, trajectory.y, trajectory.yaw)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    lines = [",".join(_COLUMNS), *(",".join(map(repr, row)) for row in rows)]
    write_file(path, "\n".join(lines) + "\n")


def _row(path: Path, number: int, cells: list[str]) -> list[float]:
    if len(cells) != len(_COLUMNS):
        raise DataError(
            f"{path}, line {number}: {len(cells)} values, expected {_EXPECTED}",
            code="wrong-columns",
            fields=(str(path), str(number), str(len(cells))),
        )
    try:
        values = [float(cell) for cell in cells]
    except ValueError as error:
        raise DataError(
            f"{path}, line {number}: {error}, expected numbers",
            code="not-a-number",
            fields=(str(path), str(number)),
        ) from error
    if not np.isfinite(values).all():
        raise DataError(
            f"{path}, line {number}: NaN or infinity, expected numbers",
            code="not-finite",
            fields=(str(path), str(number)),
        )
    return values
