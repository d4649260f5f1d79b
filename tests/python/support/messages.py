# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a robot that drives a curve past one point, as they arrive."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import fusionslam
from fusionslam.sensors.frame_builder import FrameBuilder
from fusionslam.sensors.messages import (
    CameraInfo,
    FrameTransform,
    FrameTransforms,
    Message,
    Odometry,
    Picture,
    Scan,
)

S = 1_000_000_000
# The point that every scan sees, standing still in odom.
POINT = np.array([6.0, 1.0, 0.5])
CAMERA_MATRIX = np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]])
OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])


def ns(seconds: float) -> int:
    return round(seconds * S)


def place(x: float, y: float = 0, z: float = 0, yaw: float = 0) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def odom_from_base(t: float) -> NDArray[np.float64]:
    return place(0.4 * t, yaw=0.3 * t)


BASE_FROM_LIDAR = place(-0.1, z=0.2)
BASE_FROM_CAMERA = place(0.1, z=0.1) @ OPTICAL


def fixed() -> FrameTransforms:
    places = {"lidar": BASE_FROM_LIDAR, "camera": BASE_FROM_CAMERA}
    return FrameTransforms(
        transforms=tuple(
            FrameTransform(stamp_ns=0, parent="base", child=n, parent_from_child=p, static=True)
            for n, p in places.items()
        )
    )


def info(**changes: Any) -> CameraInfo:
    whole = CameraInfo(
        stamp_ns=0,
        frame_id="camera",
        size=(64, 48),
        camera_matrix=CAMERA_MATRIX,
        projection=np.hstack([CAMERA_MATRIX, np.zeros((3, 1))]),
    )
    return replace(whole, **changes)


def odometry(t: float) -> Odometry:
    pose = odom_from_base(t)
    return Odometry(stamp_ns=ns(t), frame_id="odom", child_frame_id="base", pose=pose)


def scan(t: float) -> Scan:
    seen = np.linalg.inv(odom_from_base(t) @ BASE_FROM_LIDAR) @ [*POINT, 1]
    points = np.array([seen[:3], [np.nan] * 3], np.float32)
    return Scan(stamp_ns=ns(t), frame_id="lidar", points=points)


def picture(t: float, size: tuple[int, int] = (64, 48)) -> Picture:
    return Picture(
        stamp_ns=ns(t), frame_id="camera", image=np.zeros((size[1], size[0], 3), np.uint8)
    )


def drive(until: float = 2.0, image_delay: float = 0.03) -> list[Message]:
    """Scans at 2 Hz, images at 10 Hz taken a little later, odometry at 20 Hz; in order."""
    timed: list[tuple[float, Message]] = [(t, odometry(t)) for t in np.arange(0, until, 0.05)]
    timed += [(t, scan(t)) for t in np.arange(0.2, until - 0.2, 0.5)]
    times = np.arange(image_delay, until, 0.1)
    timed += [(t, picture(t)) for t in times]
    return [fixed(), info(), *(message for _, message in sorted(timed, key=lambda each: each[0]))]


def run(builder: FrameBuilder, messages: Iterable[Message]) -> list[fusionslam.Frame]:
    frames = [frame for message in messages for frame in builder.process(message)]
    check(builder, frames)
    frames += builder.flush()
    check(builder, frames)
    return frames


def check(builder: FrameBuilder, frames: list[fusionslam.Frame]) -> None:
    lost = sum(n for (sensor, _), n in builder.dropped.items() if sensor == "points")
    assert builder.frames == len(frames) == len({frame.stamp_ns for frame in frames})
    assert builder.sync.added["points"] == len(frames) + lost + builder.waiting["points"]


def pixel(frame: fusionslam.Frame) -> NDArray[np.float64]:
    assert frame.points is not None and len(frame.points) == 1
    seen = frame.cameras["left"].projection_from_points @ [*frame.points[0], 1]
    return np.asarray(seen[:2] / seen[2])


def true_pixel(t: float) -> NDArray[np.float64]:
    seen = np.linalg.inv(odom_from_base(t) @ BASE_FROM_CAMERA) @ [*POINT, 1]
    return np.asarray((CAMERA_MATRIX @ seen[:3] / seen[2])[:2])
