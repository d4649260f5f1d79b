# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads recordings of an indoor robot stored as one ``.npz`` of ranges and colours.

A file holds ``stamps`` (n) in seconds, increasing; ``poses`` (n, 3), the robot's ground truth x, y
in metres and yaw in radians, optional; ``rays`` (r, 3), unit vectors of the scanner's rays in the
robot's frame, and ``lidar_xyz`` (3), their origin. For ``collision`` shapes, ``visual`` shapes or
both: ``<shapes>_range_mm`` (m), ``<shapes>_ray`` (m), indices into ``rays``, ``<shapes>_rgb``
(m, 3) as bytes, and ``<shapes>_offsets`` (n + 1), the start of each scan.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import array_names, load_arrays
from fusionslam.base.arrays import Floats
from fusionslam.base.texts import counted
from fusionslam.config import Section, option
from fusionslam.datasets.base import CloudDataset
from fusionslam.datasets.streams import Request, check_scans, check_self_contained
from fusionslam.errors import DataError
from fusionslam.geometry.odometry_noise import OdometryConfig, add_odometry_errors
from fusionslam.geometry.se2 import transform_points
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.synchronizer import SyncConfig

KIND = "ranges"
SHAPES = ("visual", "collision")


class RecordingConfig(Section):
    """Configuration of how scans of a recording become clouds."""

    shapes: Literal["visual", "collision"] | None = option(
        None, "what the scanner met: visual or collision; null is visual, where there is both"
    )
    frame: Literal["robot", "odometry"] = option("robot", "what frame clouds are in")
    odometry: OdometryConfig = option(
        OdometryConfig(), "frame: odometry; how far odometry is off the true poses"
    )
    ground_height: float | None = option(
        0.1, "points not above this are dropped as ground; null keeps them", unit="m"
    )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class RangeRecording(CloudDataset):
    """Scans of a recording, all in memory; ``cloud(i)`` is one of them.

    Attributes:
        shapes: shapes that the scanner saw, one of ``SHAPES``.
        seconds: float64 (n), increasing.
        places: float64 (n, 3), x, y in metres and yaw in radians; None without ground truth.
        points: float32 (m, 3), metres in the robot's frame, ground included.
        colors: uint8 (m, 3) RGB.
        offsets: int64 (n + 1), start of each scan in the points.
    """

    shapes: str
    seconds: Floats
    places: Floats | None
    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    offsets: NDArray[np.int64]

    @property
    def counts(self) -> dict[str, int]:
        """Number of scans."""
        return {"points": len(self)}

    def content(self, sensor: str) -> str:
        """Number of scans and of coloured points, and the shapes that the rays hit."""
        points = counted(len(self.points), "coloured point")
        return f"{counted(len(self), 'scan')}, {points} on {self.shapes} shapes"

    def whole_cloud(self, index: int) -> Cloud:
        """The cloud of a scan in the robot's frame, ground included."""
        return self.cloud(index, RecordingConfig(ground_height=None))

    @classmethod
    def open(cls, path: str | os.PathLike[str], shapes: str | None = None) -> "RangeRecording":
        """Read a file.

        Args:
            path: of the file.
            shapes: shapes that the scanner saw; None for visual if the file has both.

        Raises:
            DataError: the file is missing or not a recording, lacks the shapes, or has arrays
                that do not match each other; the message names the file and the array.
        """
        source = Path(path)
        with load_arrays(source, "a recording of ranges") as loaded:
            arrays = _Arrays(source, loaded)
        there = [name for name in SHAPES if f"{name}_offsets" in loaded]
        if not there:
            raise DataError(
                f"{source}: expected visual_offsets or collision_offsets, found neither"
            )
        if shapes is not None and shapes not in there:
            raise DataError(f"{source} has no {shapes} shapes; it has {', '.join(there)}")
        shapes = shapes or there[0]
        seconds, offsets = _scans(arrays, shapes)
        points, colors = _points(arrays, shapes, int(offsets[-1]))
        places = arrays.finite("poses", (len(seconds), 3)) if "poses" in loaded else None
        return cls(
            kind=KIND,
            name=source.stem,
            root=source,
            numbers=np.arange(len(seconds)),
            stamps_ns=np.round(seconds * 1e9).astype(np.int64),
            pose_frame="the robot",
            body_from_points=np.eye(4),
            poses=None if places is None else ground_poses(*places.T),
            recorded=len(seconds),
            shapes=shapes,
            seconds=seconds,
            places=places,
            points=points,
            colors=colors,
            offsets=offsets,
        )

    def _only(self, rows: NDArray[np.int64]) -> dict[str, Any]:
        sizes = np.diff(self.offsets)[rows]
        kept = np.isin(np.repeat(np.arange(len(self)), np.diff(self.offsets)), rows)
        return {
            "seconds": self.seconds[rows],
            "places": None if self.places is None else self.places[rows],
            "points": self.points[kept],
            "colors": self.colors[kept],
            "offsets": np.cumsum([0, *sizes]).astype(np.int64),
        }

    def cloud(self, index: int, config: RecordingConfig, measured: Floats | None = None) -> Cloud:
        """The cloud of a scan in the configured frame, without ground.

        Args:
            index: of the scan.
            config: ground height and frame.
            measured: float64 (n, 3) from ``odometry``, for frame "odometry".
        """
        span = slice(*self.offsets[index : index + 2].tolist())
        points, colors = self.points[span], self.colors[span]
        if config.ground_height is not None:
            # The robot stands on the ground, so heights are the same in the odometry frame.
            above = points[:, 2] > config.ground_height
            points, colors = points[above], colors[above]
        if measured is None:
            return Cloud(points, colors)
        x, y, yaw = measured[index]
        moved = transform_points(points, x, y, yaw)
        return Cloud(moved.astype(np.float32), colors)

    def odometry(self, config: RecordingConfig) -> Floats | None:
        """float64 (n, 3), poses simulated as odometry measures them; None for frame "robot".

        Raises:
            DataError: there are no ground truth poses to start from.
        """
        if config.frame == "robot":
            return None
        if self.places is None:
            message = f"{self.name} has no poses, which the frame of odometry needs"
            raise DataError(message, code="no-poses")
        return add_odometry_errors(self.places, self.seconds, config.odometry)


def is_recording(path: str | os.PathLike[str]) -> bool:
    """Whether a path is an ``.npz`` with this layout."""
    return {"rays", "lidar_xyz", "stamps"} <= array_names(path)


def shapes_in(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Find which of ``SHAPES`` a range recording has, without reading its scans."""
    names = array_names(path)
    return tuple(shapes for shapes in SHAPES if f"{shapes}_offsets" in names)


def open_recording(root: Path, request: Request) -> RangeRecording:
    """Open a range recording, which takes no options of other kinds. Raises as its ``open``."""
    given = {
        "--sequence": request.sequence,
        "--gt": request.poses,
        "--topic": request.topics,
        "--stamps": request.stamps != "header",
        "--sync": request.sync != SyncConfig(),
        "--calib": request.calibration,
    }
    check_self_contained(root, "a range recording", given)
    check_scans(root, "a range recording", request.sensors)
    return RangeRecording.open(root, request.shapes)


class _Arrays(NamedTuple):
    """The arrays of a file, by which errors are named."""

    path: Path
    by_name: dict[str, NDArray[Any]]

    def get(self, name: str, shape: tuple[int, ...]) -> Any:
        """Get an array and check its shape, in which -1 is any length."""
        if name not in self.by_name:
            raise DataError(f"{self.path} has no array {name}")
        found = self.by_name[name].shape
        fits = len(found) == len(shape) and all(
            want in (-1, have) for want, have in zip(shape, found, strict=True)
        )
        if not fits:
            message = f"{self.path}: {name} has shape {found}, expected {shape} (-1: any length)"
            raise DataError(message)
        return self.by_name[name]

    def finite(self, name: str, shape: tuple[int, ...]) -> Floats:
        """Get an array of finite numbers as float64."""
        values = self.get(name, shape)
        if not np.issubdtype(values.dtype, np.number) or not np.isfinite(values).all():
            raise DataError(f"{self.path}: {name} must be finite numbers")
        return np.asarray(values, np.float64)


def _scans(arrays: _Arrays, shapes: str) -> tuple[Floats, NDArray[np.int64]]:
    seconds = arrays.finite("stamps", (-1,))
    if not len(seconds) or (np.diff(seconds) <= 0).any():
        raise DataError(f"{arrays.path}: stamps must increase, and there must be one")
    name = f"{shapes}_offsets"
    offsets = arrays.get(name, (len(seconds) + 1,)).astype(np.int64)
    if offsets[0] != 0 or (np.diff(offsets) < 0).any():
        raise DataError(f"{arrays.path}: {name} must begin with 0 and never decrease")
    return seconds, offsets


def _points(
    arrays: _Arrays, shapes: str, count: int
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    rays, origin = arrays.finite("rays", (-1, 3)), arrays.finite("lidar_xyz", (3,))
    ray = arrays.get(f"{shapes}_ray", (count,)).astype(np.int64)
    if count and (ray.min() < 0 or ray.max() >= len(rays)):
        message = f"{arrays.path}: {shapes}_ray must be below {len(rays)}, the number of rays"
        raise DataError(message)
    metres = arrays.get(f"{shapes}_range_mm", (count,)) / 1000.0
    colors = arrays.get(f"{shapes}_rgb", (count, 3))
    if colors.dtype != np.uint8:
        raise DataError(f"{arrays.path}: {shapes}_rgb is {colors.dtype}, expected uint8")
    return (rays[ray] * metres[:, None] + origin).astype(np.float32), colors
