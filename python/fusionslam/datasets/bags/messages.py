# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Converts ROS messages of bags or live nodes to ``fusionslam.sensors.messages`` and back.

Only attributes of messages are read, so those of rosbags, rospy and rclpy all work; messages are
built by a function that the caller passes.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.datasets.bags.image_messages import (
    check_compressed_image,
    check_image,
    compressed_image_of,
    compressed_parts,
    image_of,
    image_parts,
)
from fusionslam.datasets.bags.pointcloud import check_scan, cloud_parts, scan_from
from fusionslam.errors import DataError, naming
from fusionslam.sensors.messages import (
    NANOSECONDS,
    CameraInfo,
    Fix,
    FrameTransform,
    FrameTransforms,
    Imu,
    Message,
    Odometry,
    Picture,
    Scan,
)

Make = Callable[..., Any]
"""Builds a ROS message: ``make("std_msgs/msg/Header", stamp=..., frame_id=...)``."""


def plain_type(name: str) -> str:
    """Name of a message type without ROS 2's middle part: "nav_msgs/Odometry"."""
    return name.replace("/msg/", "/")


def is_static(topic: str) -> bool:
    """Whether the transforms of a topic are static; only its name tells."""
    return topic.rstrip("/").endswith("tf_static")


def is_known(type_name: str) -> bool:
    """Whether messages of a type can be converted."""
    return plain_type(type_name) in (*_VALUES, *_TRANSFORMS)


def value_of(message: Any, type_name: str, topic: str) -> Message:
    """Convert a ROS message to a value.

    Args:
        type_name: in ROS 1 ("nav_msgs/Odometry") or ROS 2 form ("nav_msgs/msg/Odometry").

    Raises:
        DataError: the message is inconsistent or cannot be used; names topic, stamp and field.
    """
    with naming(topic + _when(message)):
        if plain_type(type_name) in _TRANSFORMS:
            return _transforms(message, is_static(topic))
        return _VALUES[plain_type(type_name)](message)


def check_data(message: Any, type_name: str, topic: str) -> None:
    """Raise DataError if a scan or image cannot be converted since its data do not fit its size.

    Unlike ``value_of`` it converts nothing, so it is quick enough for every message of a bag.
    """
    if check := _CHECKS.get(plain_type(type_name)):
        with naming(topic + _when(message)):
            check(message)


def _when(message: Any) -> str:
    if not hasattr(message, "header"):
        return ""
    seconds, nanoseconds = divmod(stamp_of(message.header.stamp), NANOSECONDS)
    return f" at {seconds}.{nanoseconds:09d} s"


def stamp_of(time: Any) -> int:
    """Nanoseconds of a ROS time with fields sec, nanosec or, in rospy, secs, nsecs."""
    if hasattr(time, "nanosec"):
        return int(time.sec) * NANOSECONDS + int(time.nanosec)
    return int(time.secs) * NANOSECONDS + int(time.nsecs)


def _scan(message: Any) -> Scan:
    return scan_from(message, stamp_of(message.header.stamp), message.header.frame_id)


def _picture(message: Any, image: NDArray[np.uint8]) -> Picture:
    header = message.header
    return Picture(stamp_ns=stamp_of(header.stamp), frame_id=header.frame_id, image=image)


def _camera_info(message: Any) -> CameraInfo:
    # ROS 1 writes D, K, R, P; ROS 2 d, k, r, p.
    upper = hasattr(message, "K")
    d, k, r, p = (getattr(message, name if upper else name.lower()) for name in "DKRP")
    header = message.header
    return CameraInfo(
        stamp_ns=stamp_of(header.stamp),
        frame_id=header.frame_id,
        size=(int(message.width), int(message.height)),
        camera_matrix=_matrix("K", k, (3, 3)),
        distortion=_matrix("D", d, (len(d),)),
        distortion_model=message.distortion_model,
        rectification=_matrix("R", r, (3, 3)),
        projection=_matrix("P", p, (3, 4)),
    )


def _odometry(message: Any) -> Odometry:
    header, pose, twist = message.header, message.pose.pose, message.twist.twist
    return Odometry(
        stamp_ns=stamp_of(header.stamp),
        frame_id=header.frame_id,
        child_frame_id=message.child_frame_id,
        pose=_transform("pose", pose.position, pose.orientation),
        linear=_vector("twist.linear", twist.linear),
        angular=_vector("twist.angular", twist.angular),
    )


def _imu(message: Any) -> Imu:
    if len(message.angular_velocity_covariance) and message.angular_velocity_covariance[0] == -1:
        raise DataError("angular_velocity_covariance[0] is -1: the IMU tells no turn rates")
    return Imu(
        stamp_ns=stamp_of(message.header.stamp),
        frame_id=message.header.frame_id.lstrip("/"),
        angular=_vector("angular_velocity", message.angular_velocity),
        linear=_vector("linear_acceleration", message.linear_acceleration),
    )


def _fix(message: Any) -> Fix:
    frame_id = message.header.frame_id.lstrip("/")
    stamp_ns = stamp_of(message.header.stamp)
    if message.status.status < 0:
        return Fix(stamp_ns=stamp_ns, frame_id=frame_id, position=None)
    values = [message.latitude, message.longitude, message.altitude]
    position = _matrix("latitude, longitude, altitude", values, (3,))
    for name, value, most in zip(("latitude", "longitude"), values, (90, 180), strict=False):
        if abs(value) > most:
            raise DataError(
                f"{name} is {value:g}, expected degrees of WGS 84 from {-most} to {most}",
                code="no-wgs84",
                fields=(name,),
            )
    covariance = None
    if message.position_covariance_type:
        covariance = _matrix("position_covariance", message.position_covariance, (3, 3))
        if np.linalg.eigvalsh(covariance)[0] <= 0:
            raise DataError(
                f"position_covariance is {covariance.tolist()}, expected a positive definite one, "
                "or position_covariance_type 0 (unknown)",
                code="not-positive-definite",
                fields=("position_covariance",),
            )
    return Fix(stamp_ns=stamp_ns, frame_id=frame_id, position=position, covariance=covariance)


def _transforms(message: Any, static: bool) -> FrameTransforms:
    return FrameTransforms(
        transforms=tuple(
            FrameTransform(
                stamp_ns=stamp_of(each.header.stamp),
                # tf (not tf2) wrote a leading slash.
                parent=each.header.frame_id.lstrip("/"),
                child=each.child_frame_id.lstrip("/"),
                parent_from_child=_transform(
                    f"transform of '{each.child_frame_id}'",
                    each.transform.translation,
                    each.transform.rotation,
                ),
                static=static,
            )
            for each in message.transforms
        )
    )


_VALUES: dict[str, Callable[[Any], Message]] = {
    "sensor_msgs/PointCloud2": _scan,
    "sensor_msgs/Image": lambda message: _picture(message, image_of(message)),
    "sensor_msgs/CompressedImage": lambda m: _picture(m, compressed_image_of(m)),
    "sensor_msgs/CameraInfo": _camera_info,
    "nav_msgs/Odometry": _odometry,
    "sensor_msgs/Imu": _imu,
    "sensor_msgs/NavSatFix": _fix,
}
_CHECKS: dict[str, Callable[[Any], None]] = {
    "sensor_msgs/PointCloud2": check_scan,
    "sensor_msgs/Image": check_image,
    "sensor_msgs/CompressedImage": check_compressed_image,
}
_TRANSFORMS = ("tf2_msgs/TFMessage", "tf/tfMessage")


def _matrix(name: str, values: Any, shape: tuple[int, ...]) -> Matrix:
    numbers = np.array(values, dtype=np.float64)
    if numbers.size != np.prod(shape):
        raise DataError(f"field '{name}' has {numbers.size} values, expected {np.prod(shape)}")
    if not np.isfinite(numbers).all():
        raise DataError(f"field '{name}' is not finite: {numbers.tolist()}")
    return numbers.reshape(shape)


def _vector(name: str, vector: Any) -> Matrix:
    return _matrix(name, [vector.x, vector.y, vector.z], (3,))


def _transform(name: str, position: Any, rotation: Any) -> Matrix:
    """float64 (4, 4) of a position and a quaternion, which need not be normalised."""
    pose = np.eye(4)
    pose[:3, 3] = _vector(f"{name}, position", position)
    numbers = [rotation.x, rotation.y, rotation.z, rotation.w]
    x, y, z, w = quaternion = _matrix(f"{name}, rotation", numbers, (4,))
    square = float(quaternion @ quaternion)
    if square < 1e-12:
        raise DataError(f"{name}: the quaternion is zero, expected a rotation")
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose[:3, :3] += 2 / square * (w * cross + cross @ cross)
    return pose


def ros_type(value: Message, stored: str) -> str:
    """ROS type that a value is written as; ``stored`` is the format of pictures."""
    if isinstance(value, Picture):
        return f"sensor_msgs/msg/{'Image' if stored == 'raw' else 'CompressedImage'}"
    return {
        Scan: "sensor_msgs/msg/PointCloud2",
        CameraInfo: "sensor_msgs/msg/CameraInfo",
        Odometry: "nav_msgs/msg/Odometry",
        Imu: "sensor_msgs/msg/Imu",
        Fix: "sensor_msgs/msg/NavSatFix",
        FrameTransforms: "tf2_msgs/msg/TFMessage",
    }[type(value)]


class MessageBuilder:
    """Builds ROS messages from values.

    Args:
        make: builds a message of a type from its fields.
        ros: 1 or 2; headers and camera calibrations differ.
    """

    def __init__(self, make: Make, ros: Literal[1, 2]) -> None:
        self._make = make
        self._ros = ros

    def build(self, value: Message, stored: str = "raw") -> Any:
        """Build the ROS message of a value; pictures are stored "raw" or as "jpeg" or "png".

        Raises:
            DataError: the value cannot be stored in such a message.
        """
        name, make = ros_type(value, stored), self._make
        if isinstance(value, FrameTransforms):
            return make(name, transforms=[self._transform(each) for each in value.transforms])
        header = self._header(value.stamp_ns, value.frame_id)
        if isinstance(value, Scan):
            return make(name, header=header, **self._cloud(value))
        if isinstance(value, Picture):
            raw = stored == "raw"
            parts = image_parts(value.image) if raw else compressed_parts(value.image, stored)
            return make(name, header=header, **parts)
        if isinstance(value, CameraInfo):
            return make(name, header=header, **self._camera_info(value))
        if isinstance(value, Imu):
            return make(name, header=header, **self._imu(value))
        if isinstance(value, Fix):
            return make(name, header=header, **self._fix(value))
        return make(name, header=header, **self._odometry(value))

    def _header(self, stamp_ns: int, frame_id: str) -> Any:
        # Seconds are unsigned 32 bit integers in ROS 1 and signed ones in ROS 2.
        if not 0 <= stamp_ns < 2 ** (33 - self._ros) * NANOSECONDS:
            raise DataError(f"stamp {stamp_ns} ns is no time of ROS {self._ros}")
        seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        sequence = {"seq": 0} if self._ros == 1 else {}
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id, **sequence)

    def _cloud(self, scan: Scan) -> dict[str, Any]:
        parts = cloud_parts(scan)
        fields = [
            self._make(
                "sensor_msgs/msg/PointField", name=name, offset=offset, datatype=code, count=1
            )
            for name, offset, code in parts["fields"]
        ]
        return parts | {"fields": fields}

    def _camera_info(self, info: CameraInfo) -> dict[str, Any]:
        matrices = {
            "D": info.distortion,
            "K": info.camera_matrix,
            "R": info.rectification,
            "P": info.projection,
        }
        everything = self._make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        flat = {name: np.ravel(matrix).astype(np.float64) for name, matrix in matrices.items()}
        return {
            "width": info.size[0],
            "height": info.size[1],
            "distortion_model": info.distortion_model,
            "binning_x": 0,
            "binning_y": 0,
            "roi": everything,
        } | (flat if self._ros == 1 else {name.lower(): values for name, values in flat.items()})

    def _odometry(self, odometry: Odometry) -> dict[str, Any]:
        make, unknown = self._make, np.zeros(36)
        position, rotation = self._pose(odometry.pose, "Point")
        pose = make("geometry_msgs/msg/Pose", position=position, orientation=rotation)
        twist = make(
            "geometry_msgs/msg/Twist",
            linear=self._vector(odometry.linear),
            angular=self._vector(odometry.angular),
        )
        return {
            "child_frame_id": odometry.child_frame_id,
            "pose": make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            "twist": make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
        }

    def _imu(self, imu: Imu) -> dict[str, Any]:
        unknown, none = np.zeros(9), np.zeros(9)
        none[0] = -1  # says that there is no orientation
        return {
            "orientation": self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            "orientation_covariance": none,
            "angular_velocity": self._vector(imu.angular),
            "angular_velocity_covariance": unknown,
            "linear_acceleration": self._vector(imu.linear),
            "linear_acceleration_covariance": unknown,
        }

    def _fix(self, fix: Fix) -> dict[str, Any]:
        position = np.full(3, np.nan) if fix.position is None else fix.position
        covariance = np.zeros((3, 3)) if fix.covariance is None else fix.covariance
        status = self._make(
            "sensor_msgs/msg/NavSatStatus", status=-1 if fix.position is None else 0, service=1
        )
        return {
            "status": status,
            **dict(zip(("latitude", "longitude", "altitude"), position.tolist(), strict=True)),
            "position_covariance": covariance.ravel(),
            "position_covariance_type": 0 if fix.covariance is None else 3,
        }

    def _transform(self, transform: FrameTransform) -> Any:
        translation, rotation = self._pose(transform.parent_from_child, "Vector3")
        return self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(transform.stamp_ns, transform.parent),
            child_frame_id=transform.child,
            transform=self._make(
                "geometry_msgs/msg/Transform", translation=translation, rotation=rotation
            ),
        )

    def _pose(self, pose: Matrix, position: str) -> tuple[Any, Any]:
        from scipy.spatial.transform import Rotation

        if not np.isfinite(pose).all():
            raise DataError(f"a pose is not finite: {pose.tolist()}")
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        rotation = self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        return self._vector(pose[:3, 3], position), rotation

    def _vector(self, values: Matrix, name: str = "Vector3") -> Any:
        x, y, z = np.asarray(values, dtype=np.float64).tolist()
        return self._make(f"geometry_msgs/msg/{name}", x=x, y=y, z=z)
