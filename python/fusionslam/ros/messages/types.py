# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Look up ROS message classes by name, and make messages from values."""

import functools
import math
from importlib import import_module
from typing import Any

import numpy as np

from fusionslam.datasets.bags.messages import MessageBuilder, plain_type
from fusionslam.errors import DataError
from fusionslam.ros.environment import PACKAGE
from fusionslam.sensors.messages import NANOSECONDS
from fusionslam.storage.arrays import Matrix

VIEW_DESCRIPTION = f"{PACKAGE}/LVDescription"
VIEW_TEMPLATE = f"{PACKAGE}/ViewTemplate"
TOPOLOGICAL_ACTION = f"{PACKAGE}/TopologicalAction"
TOPOLOGICAL_MAP = f"{PACKAGE}/TopologicalMap"
LOOP_CLOSURE = f"{PACKAGE}/LoopClosure"
LOCALIZE = f"{PACKAGE}/Localize"
VIEW_STATISTICS = f"{PACKAGE}/ViewStatistics"
CLOUD = "sensor_msgs/PointCloud2"
IMAGES = ("sensor_msgs/Image", "sensor_msgs/CompressedImage")
CAMERA_INFO = "sensor_msgs/CameraInfo"
ODOMETRY = "nav_msgs/Odometry"
TRANSFORMS = "tf2_msgs/TFMessage"
POSE = "geometry_msgs/PoseStamped"
LOCATED_POSE = "geometry_msgs/PoseWithCovarianceStamped"
PATH = "nav_msgs/Path"
GRID = "nav_msgs/OccupancyGrid"
MARKERS = "visualization_msgs/MarkerArray"
DIAGNOSTICS = "diagnostic_msgs/DiagnosticArray"

Ground = tuple[float, float, float]
"""x, y in metres and a heading in radians."""


@functools.cache
def message_class(type_name: str) -> type[Any]:
    """Return the class of a type like "nav_msgs/Odometry". Raises DataError if not installed."""
    return _class_of(plain_type(type_name), "msg")


@functools.cache
def service_class(type_name: str) -> type[Any]:
    """Return the class of a type like "std_srvs/Empty". Raises DataError if not installed."""
    return _class_of(type_name, "srv")


def _class_of(type_name: str, kind: str) -> type[Any]:
    package, _, name = type_name.partition("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError):
        raise DataError(
            f"the type {type_name} is not installed: make ros installs it",
            code="no-ros-type",
            fields=(type_name,),
        ) from None


def make(type_name: str, /, **fields: Any) -> Any:
    """Make a message from its fields, as ``MessageBuilder`` needs it."""
    if type_name.startswith("builtin_interfaces/"):
        return ros_time(int(fields["sec"]) * NANOSECONDS + int(fields["nanosec"]))
    flat = {
        # Fields that genpy packs as bytes must be bytes.
        name: value.tobytes()
        if isinstance(value, np.ndarray) and value.dtype == np.uint8
        else value
        for name, value in fields.items()
    }
    return message_class(type_name)(**flat)


builder = MessageBuilder(make, ros=1)
"""Makes messages from scans, images, calibrations, odometry and transforms."""


def deserialize(message: Any, type_name: str) -> Any:
    """Deserialise a raw message of rospy (AnyMsg) as its type. Raises DataError."""
    typed = message_class(type_name)()
    try:
        return typed.deserialize(message._buff)
    except Exception as error:  # genpy raises exceptions of many types
        raise DataError(
            f"no {type_name}, or cut short: {error}; check its publisher", code="cut-short"
        ) from error


def ros_time(stamp_ns: int) -> Any:
    """Return a ROS 1 time stamp."""
    from genpy import Time

    seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
    return Time(seconds, nanoseconds)


def ros_duration(nanoseconds: int) -> Any:
    """Return a ROS 1 duration, which may be negative."""
    from genpy import Duration

    seconds, rest = divmod(int(nanoseconds), NANOSECONDS)
    return Duration(seconds, rest)


def header(stamp_ns: int, frame_id: str) -> Any:
    """Return a std_msgs/Header."""
    return make("std_msgs/Header", stamp=ros_time(stamp_ns), frame_id=frame_id)


def ground_pose(place: Ground) -> Any:
    """Return a geometry_msgs/Pose from x, y in metres and a heading in radians."""
    x, y, heading = (float(value) for value in place)
    position = make("geometry_msgs/Point", x=x, y=y, z=0.0)
    return make("geometry_msgs/Pose", position=position, orientation=_quaternion_of(heading))


def pose_of(pose: Matrix) -> Any:
    """Return a geometry_msgs/Pose from float64 (4, 4)."""
    from scipy.spatial.transform import Rotation

    x, y, z = pose[:3, 3].tolist()
    qx, qy, qz, qw = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    return make(
        "geometry_msgs/Pose",
        position=make("geometry_msgs/Point", x=x, y=y, z=z),
        orientation=make("geometry_msgs/Quaternion", x=qx, y=qy, z=qz, w=qw),
    )


def pose_with_covariance(pose: Matrix, covariance: Matrix) -> Any:
    """Return a geometry_msgs/PoseWithCovariance.

    Args:
        pose: float64 (4, 4), a_from_b.
        covariance: float64 (6, 6), of the error as a small motion in b: x, y, z in metres and
            rotations in radians. The message's is of positions in a and rotations about its axes.
    """
    turn = np.kron(np.eye(2), pose[:3, :3])
    return make(
        "geometry_msgs/PoseWithCovariance",
        pose=pose_of(pose),
        covariance=(turn @ covariance @ turn.T).ravel().tolist(),
    )


def ground_transform(place: Ground) -> Any:
    """Return a geometry_msgs/Transform from x, y in metres and a heading in radians."""
    x, y, heading = (float(value) for value in place)
    translation = make("geometry_msgs/Vector3", x=x, y=y, z=0.0)
    return make(
        "geometry_msgs/Transform", translation=translation, rotation=_quaternion_of(heading)
    )


def _quaternion_of(heading: float) -> Any:
    z, w = math.sin(heading / 2), math.cos(heading / 2)
    return make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=z, w=w)
