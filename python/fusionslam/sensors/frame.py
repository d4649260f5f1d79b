# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras, frames of sensor data, and the coloured clouds made from them.

Arrays have the same form everywhere: points float32 (N, 3) in metres, colours uint8 (N, 3) RGB,
images uint8 (H, W, 3) RGB or (H, W), poses float64 (4, 4) where ``a_from_b`` maps points in b to
points in a, stamps integer nanoseconds.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Floats32, Points, read_numbers
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.rigid import check_mounting, is_rigid
from fusionslam.sensors.messages import as_stamp
from fusionslam.sensors.point_times import Span, span_of
from fusionslam.sensors.undone_motion import Deskew

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Camera:
    """A rectified pinhole camera and its pose relative to the frame's points.

    Attributes:
        projection: float64 (3, 4), maps homogeneous points of the rectified camera frame to
            pixels (KITTI's P0 .. P3).
        rectified_from_points: float64 (4, 4), maps points of the scan to the rectified camera
            frame (KITTI odometry: Tr; raw and object: R0_rect * Tr_velo_to_cam).
        size: (width, height) in pixels that the calibration is for; None if unknown.

    Raises:
        ShapeError: a matrix has the wrong shape.
        DataError: a matrix has NaN or infinity, the projection is singular, or
            ``rectified_from_points`` is no rotation and translation of at most 100 m.
    """

    projection: NDArray[np.float64]
    rectified_from_points: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        for name, shape in (("projection", (3, 4)), ("rectified_from_points", (4, 4))):
            matrix = _matrix(f"camera {name}", getattr(self, name), shape)
            object.__setattr__(self, name, matrix)
        square = self.projection[:, :3]
        if np.linalg.matrix_rank(square) < 3:
            raise DataError(f"camera projection is singular: {square.tolist()}")
        check_mounting("rectified_from_points", self.rectified_from_points)

    @property
    def projection_from_points(self) -> NDArray[np.float64]:
        """float64 (3, 4): maps homogeneous points of the scan to pixels."""
        return self.projection @ self.rectified_from_points

    @property
    def points_from_rectified(self) -> NDArray[np.float64]:
        """float64 (4, 4): maps points of the rectified camera frame to the scan's."""
        return np.linalg.inv(self.rectified_from_points).astype(np.float64)


@dataclass(frozen=True)
class Cloud:
    """Points and what is known of each.

    Attributes:
        points: float32 (N, 3), metres.
        colors: uint8 (N, 3) RGB, or None.
        intensities: float32 (N,), of the returns, in the scanner's own unit; or None.
        seconds: float64 (N,), when each point was measured, after the frame's stamp; None if that
            is not known, or the motion meanwhile was undone.
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8] | None = None
    intensities: NDArray[np.float32] | None = None
    seconds: Floats | None = None

    def __len__(self) -> int:
        return len(self.points)


def require_cloud(value: object) -> None:
    """Raise ShapeError (code "no-cloud") unless a value is a ``Cloud``."""
    if not isinstance(value, Cloud):
        is_frame = isinstance(value, Frame)
        cure = "fuse it first (fusionslam.fuse)" if is_frame else "Cloud(points, colors) makes one"
        raise ShapeError(
            f"expected a Cloud, got {type(value).__name__}: {cure}",
            code="no-cloud",
            fields=(type(value).__name__,),
        )


@checked
class Frame:
    """Sensor data of one instant. Points and images are loaded on first access.

    Args:
        index: the frame's place in its dataset, from 0.
        number: the frame's number in the names of its files; None takes the index.
        stamp_ns: time in nanoseconds.
        points: float32 (N, 3), metres, in the scan's frame; or a function that loads them.
        colors: uint8 (N, 3) RGB, for data whose points are already coloured; or a loader.
        intensities: float32 (N,), of the returns, in the scanner's own unit; or a loader.
        point_seconds: float64 (N,), when each point was measured, after the stamp; None if that is
            not known, or the motion meanwhile was undone; or a loader.
        deskew: how the motion within the scan was undone, so that the points are as of the stamp;
            None if it was not; or a loader.
        images: by camera name: uint8 (H, W, 3) RGB or (H, W); or loaders. "left" is the main
            camera, "right" its partner in a stereo pair; others have any name.
        cameras: calibration by camera name.
        pose: float64 (4, 4), world_from_body; the dataset says which body (``pose_frame``).
        odometry: float64 (4, 4), measured odom_from_robot at the scan's stamp.
        robot_from_points: float64 (4, 4), maps points of the scan to the robot's frame.

    Raises:
        DataError: the stamp is no integer of 64 bits, or a matrix is no rotation and translation.
            A pose or odometry with NaN is unknown.
        ShapeError: a matrix has another shape.
    """

    def __init__(
        self,
        *,
        index: int = 0,
        number: int | None = None,
        stamp_ns: int = 0,
        points: Points | Callable[[], Points] | None = None,
        colors: Bytes | Callable[[], Bytes | None] | None = None,
        intensities: Floats32 | Callable[[], Floats32 | None] | None = None,
        point_seconds: Floats | Callable[[], Floats | None] | None = None,
        deskew: Deskew | Callable[[], Deskew | None] | None = None,
        images: Mapping[str, Bytes | Callable[[], Bytes]] | None = None,
        cameras: Mapping[str, Camera] | None = None,
        pose: NDArray[np.float64] | None = None,
        odometry: NDArray[np.float64] | None = None,
        robot_from_points: NDArray[np.float64] | None = None,
    ) -> None:
        self.index = index
        self.number = index if number is None else number
        self.stamp_ns = as_stamp(stamp_ns)
        self.cameras: Mapping[str, Camera] = cameras or {}
        self.pose = read_pose("pose", pose)
        self.odometry = read_pose("odometry", odometry)
        if robot_from_points is not None:
            robot_from_points = _matrix("robot_from_points", robot_from_points, (4, 4))
            check_mounting("robot_from_points", robot_from_points)
        self.robot_from_points = robot_from_points
        self.images: Mapping[str, Bytes] = _LazyMapping({} if images is None else images)
        scan = {
            "points": points,
            "colors": colors,
            "intensities": intensities,
            "point_seconds": point_seconds,
            "deskew": deskew,
        }
        self._scan = _LazyMapping(scan)

    def __getstate__(self) -> dict[str, object]:
        # Another process may not be able to read the recording: it gets the data themselves.
        return {**vars(self), "_scan": dict(self._scan), "images": dict(self.images)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        lazy = {name: _LazyMapping(state[name]) for name in ("_scan", "images")}
        vars(self).update(state, **lazy)

    def __repr__(self) -> str:
        """One line; loads nothing."""
        seconds, nanoseconds = divmod(self.stamp_ns, 1_000_000_000)
        content = []
        if self.has_points:
            points = self._scan.stored("points")
            content.append("points" if callable(points) else f"{len(points)} points")
        content += [f"{name} image" for name in self.images]
        about = ", ".join(content) or "empty"
        return f"<Frame {self.index} at {seconds}.{nanoseconds:09d} s: {about}>"

    @property
    def points(self) -> NDArray[np.float32] | None:
        """float32 (N, 3) in metres, or None if this frame has no scan."""
        points: Points | None = self._scan["points"]
        return points

    @property
    def colors(self) -> NDArray[np.uint8] | None:
        """uint8 (N, 3) RGB if the data has coloured points, else None."""
        colors: Bytes | None = self._scan["colors"]
        return colors

    @property
    def intensities(self) -> Floats32 | None:
        """float32 (N,), intensities of the returns in the scanner's own unit; None if unknown."""
        intensities: Floats32 | None = self._scan["intensities"]
        return intensities

    @property
    def point_seconds(self) -> Floats | None:
        """float64 (N,), seconds from the stamp to when each point was measured.

        None if that is unknown, and where the points are as of the stamp (``deskew``).
        """
        point_seconds: Floats | None = self._scan["point_seconds"]
        return point_seconds

    @property
    def span(self) -> Span | None:
        """When the first and the last point were measured, as ``point_seconds`` says."""
        return span_of(self.point_seconds)

    @property
    def deskew(self) -> Deskew | None:
        """How the motion within the scan was undone; None if the points are as measured."""
        deskew: Deskew | None = self._scan["deskew"]
        return deskew

    @property
    def has_points(self) -> bool:
        """Whether there is a scan; does not load it."""
        return self._scan.stored("points") is not None


class _LazyMapping(Mapping[str, Any]):
    """A mapping whose values are loaded on first access."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = dict(values)

    def __getitem__(self, key: str) -> Any:
        value = self._values[key]
        if callable(value):
            value = self._values[key] = value()
        return value

    def stored(self, key: str) -> Any:
        """The value, or its loader if it was not loaded yet."""
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)


def _shaped(name: str, value: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    matrix = read_numbers(name, value, str(shape))
    if matrix.shape != shape:
        raise ShapeError(f"{name} has shape {matrix.shape}, expected {shape}", fields=(name,))
    return matrix


def _matrix(name: str, value: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    matrix = _shaped(name, value, shape)
    if not np.isfinite(matrix).all():
        raise DataError(f"{name} is not finite: {matrix.tolist()}")
    return matrix


def read_pose(name: str, value: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    """Check a pose of a frame; one that is not finite is unknown."""
    if value is None:
        return None
    matrix = _shaped(name, value, (4, 4))
    if np.isfinite(matrix).all() and not is_rigid(matrix):
        raise DataError(
            f"{name} is no rotation and translation: {matrix.tolist()}",
            code="not-a-rotation",
            fields=(name,),
        )
    return matrix


CloudFrame = Literal["scan", "camera", "robot", "odometry"]
