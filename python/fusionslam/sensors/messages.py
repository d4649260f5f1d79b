# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of single sensors as values independent of any middleware.

Bags, the simulator and robots deliver these; a ``Synchronizer`` groups them into frames. Every
value has the stamp of its header (integer nanoseconds) and the name of its frame.
"""

import operator
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Mask, Matrix, Points
from fusionslam.errors import ClockError, ConfigError, DataError, ShapeError
from fusionslam.sensors.point_times import PointTimes, Span, read_point_times, span_of

NANOSECONDS = 1_000_000_000
"""Per second."""


def as_stamp(stamp_ns: Any) -> int:
    """A stamp as Python's int, which never overflows. Raises DataError beyond 64 bits."""
    with suppress(TypeError):
        stamp = operator.index(stamp_ns)
        if -(2**63) <= stamp < 2**63:
            return stamp
    raise DataError(
        f"a stamp is {stamp_ns!r}, expected integer nanoseconds of 64 bits",
        code="stamp",
        fields=(str(stamp_ns),),
    )


def as_nanoseconds(name: str, seconds: float) -> int:
    """Nanoseconds of a duration. Raises ConfigError if it is negative or beyond 64 bits."""
    with suppress(TypeError, ValueError, OverflowError):
        if 0 <= float(seconds) < 2**63 / NANOSECONDS:
            return round(float(seconds) * NANOSECONDS)
    raise ConfigError(
        f"{name} is {seconds}, expected a number of seconds from 0 to 9e9",
        code="out-of-range",
        fields=(name,),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan:
    """One cloud of a LiDAR or any other source of points.

    Attributes:
        stamp_ns: time of the header.
        frame_id: the frame of the points.
        points: float32 (N, 3), metres; NaN marks a ray without return.
        fields: other values of each point by name, (N,) each: "intensity", "ring", "time" in
            seconds after the stamp, "object" as the simulator numbers them, ...
        colors: uint8 (N, 3) RGB if the points are already coloured.
        width: points per row of an organised cloud; 0 for an unorganised cloud (one row).
    """

    stamp_ns: int
    frame_id: str
    points: Points
    fields: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    colors: NDArray[np.uint8] | None = None
    width: int = 0

    @property
    def intensities(self) -> NDArray[np.float32] | None:
        """float32 (N,), of the field "intensity"; None without one."""
        values = self.fields.get("intensity")
        return None if values is None else np.asarray(values, np.float32)

    @cached_property
    def point_times(self) -> PointTimes:
        """When each point was measured, as ``read_point_times``."""
        return read_point_times(self.fields, self.stamp_ns, self.returned)

    @cached_property
    def returned(self) -> Mask:
        """bool (N,), the rays with a return."""
        return np.asarray(np.isfinite(self.points).all(axis=1))

    @cached_property
    def returns(self) -> "Scan":
        """The scan without the rays that did not return, one row of points."""
        kept = self.returned
        if kept.all():
            return self
        return replace(
            self,
            points=self.points[kept],
            fields={
                name: np.asarray(values)[kept] if len(values) == len(kept) else values
                for name, values in self.fields.items()
            },
            colors=None if self.colors is None else self.colors[kept],
            width=0,
        )

    @property
    def point_seconds(self) -> Floats | None:
        """float64 (N,): seconds from the stamp to when each point was measured; None if unknown."""
        return self.point_times.seconds

    @cached_property
    def span(self) -> Span | None:
        """When the first and the last point were measured; None if that is not known."""
        seconds = self.point_seconds
        return None if seconds is None else span_of(seconds[self.returned])


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture:
    """One image of a camera: uint8 (H, W, 3) RGB or (H, W) grey, as taken."""

    stamp_ns: int
    frame_id: str
    image: NDArray[np.uint8]


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraInfo:
    """Calibration of a camera (sensor_msgs/CameraInfo): x right, y down, z forward.

    Attributes:
        stamp_ns: time of the header.
        frame_id: the camera's optical frame.
        size: (width, height) in pixels.
        camera_matrix: float64 (3, 3), K of the image as taken.
        distortion: float64 (k), coefficients of the model; empty or zeros for none.
        distortion_model: "plumb_bob", "rational_polynomial" or "equidistant"; "" for none.
        rectification: float64 (3, 3), R, rectified_from_camera.
        projection: float64 (3, 4), P of the rectified image.
    """

    stamp_ns: int
    frame_id: str
    size: tuple[int, int]
    camera_matrix: Matrix
    distortion: Matrix = field(default_factory=lambda: np.zeros(0))
    distortion_model: str = "plumb_bob"
    rectification: Matrix = field(default_factory=lambda: np.eye(3))
    projection: Matrix


@dataclass(frozen=True, eq=False, kw_only=True)
class Odometry:
    """Pose and velocity of the robot by odometry.

    Attributes:
        stamp_ns: time of the header.
        frame_id: the odometry frame.
        child_frame_id: the robot's frame.
        pose: float64 (4, 4), frame_from_child.
        linear: float64 (3), m/s in the child's frame.
        angular: float64 (3), rad/s in the child's frame.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    pose: Matrix
    linear: Matrix = field(default_factory=lambda: np.zeros(3))
    angular: Matrix = field(default_factory=lambda: np.zeros(3))

    @property
    def transform(self) -> "FrameTransform":
        """The pose as a moving transform."""
        return FrameTransform(
            stamp_ns=self.stamp_ns,
            parent=self.frame_id,
            child=self.child_frame_id,
            parent_from_child=self.pose,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Imu:
    """Turn rate and acceleration by an inertial measurement unit.

    Attributes:
        stamp_ns: time of the header.
        frame_id: the frame of the IMU's axes.
        angular: float64 (3), rad/s.
        linear: float64 (3), m/s^2, gravity included: at rest it points up.
    """

    stamp_ns: int
    frame_id: str
    angular: Matrix
    linear: Matrix


@dataclass(frozen=True, eq=False, kw_only=True)
class Fix:
    """Where a satellite receiver takes its antenna to be.

    Attributes:
        stamp_ns: time of the header.
        frame_id: the frame of the antenna.
        position: float64 (3), latitude and longitude in degrees and metres above the ellipsoid of
            WGS 84; None while the receiver knows no position.
        covariance: float64 (3, 3), m^2, east, north, up; None if the receiver states none.
    """

    stamp_ns: int
    frame_id: str
    position: Matrix | None
    covariance: Matrix | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameTransform:
    """Pose of one frame in another, at one time or, if static, always.

    Attributes:
        stamp_ns: time of the header; meaningless if static.
        parent: name of the frame that the pose is given in (header.frame_id).
        child: name of the frame whose pose it is (child_frame_id).
        parent_from_child: float64 (4, 4).
        static: whether it holds for all times.
    """

    stamp_ns: int
    parent: str
    child: str
    parent_from_child: Matrix
    static: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameTransforms:
    """Transforms that were published together (tf2_msgs/TFMessage)."""

    transforms: tuple[FrameTransform, ...]


Message = Scan | Picture | CameraInfo | Odometry | Imu | Fix | FrameTransforms


@dataclass(frozen=True, eq=False)
class Event:
    """A message with its topic and time of arrival.

    Attributes:
        topic: the topic it was published on.
        time_ns: time of arrival; its stamp is the time of measurement.
        message: the value.
    """

    topic: str
    time_ns: int
    message: Message


def next_stamp(stamp_ns: int, last_ns: int | None) -> int:
    """Return a stamp as an int after checking that it is not earlier than the last one.

    Raises:
        ClockError: it is earlier than the last one.
        ShapeError: it is not an integer that fits int64.
    """
    stamp = np.asarray(stamp_ns)
    if stamp.shape or stamp.dtype.kind not in "iu" or stamp > np.iinfo(np.int64).max:
        raise ShapeError(f"stamp_ns is {stamp_ns!r}, expected whole nanoseconds in int64")
    found = int(stamp)
    if last_ns is not None and found < last_ns:
        back = (last_ns - found) / NANOSECONDS
        raise ClockError(f"stamp {found} ns lies {back:g} s before the last one")
    return found
