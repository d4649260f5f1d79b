# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Names of message types, and headers, poses and markers as messages."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from fusionslam.base.arrays import Matrix
from fusionslam.ros.messages.library import OWN, make, ros_time

VIEW_DESCRIPTION = f"{OWN}/LVDescription"
VIEW_TEMPLATE = f"{OWN}/ViewTemplate"
TOPOLOGICAL_ACTION = f"{OWN}/TopologicalAction"
TOPOLOGICAL_MAP = f"{OWN}/TopologicalMap"
LOOP_CLOSURE = f"{OWN}/LoopClosure"
LOCALIZE = f"{OWN}/Localize"
VIEW_STATISTICS = f"{OWN}/ViewStatistics"
CLOUD = "sensor_msgs/PointCloud2"
IMAGES = ("sensor_msgs/Image", "sensor_msgs/CompressedImage")
CAMERA_INFO = "sensor_msgs/CameraInfo"
ODOMETRY = "nav_msgs/Odometry"
IMU = "sensor_msgs/Imu"
FIX = "sensor_msgs/NavSatFix"
TRANSFORMS = "tf2_msgs/TFMessage"
POSE = "geometry_msgs/PoseStamped"
LOCATED_POSE = "geometry_msgs/PoseWithCovarianceStamped"
PATH = "nav_msgs/Path"
GRID = "nav_msgs/OccupancyGrid"
MARKERS = "visualization_msgs/MarkerArray"
DIAGNOSTICS = "diagnostic_msgs/DiagnosticArray"

Ground = tuple[float, float, float]
"""x, y in metres and a heading in radians."""


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


def marker(
    top: Any, namespace: str, number: int, kind: int, scale: Sequence[float], look: Any
) -> Any:
    """Return a visualization_msgs/Marker without points, at the origin of its frame.

    Args:
        top: its header.
        namespace, number: together identify the marker; a later one with both replaces it.
        kind: one of the type constants of Marker.
        scale: metres along x, y, z; the meaning depends on the kind.
        look: its colour.
    """
    x, y, z = scale
    return make(
        "visualization_msgs/Marker",
        header=top,
        ns=namespace,
        id=number,
        type=kind,
        action=0,
        pose=ground_pose((0.0, 0.0, 0.0)),
        scale=make("geometry_msgs/Vector3", x=x, y=y, z=z),
        color=look,
    )


def point(x: float, y: float, z: float = 0.0) -> Any:
    """Return a geometry_msgs/Point."""
    return make("geometry_msgs/Point", x=x, y=y, z=z)


def color(rgb: tuple[float, float, float], alpha: float = 1.0) -> Any:
    """Return a std_msgs/ColorRGBA of components in [0, 1]."""
    r, g, b = rgb
    return make("std_msgs/ColorRGBA", r=r, g=g, b=b, a=alpha)
