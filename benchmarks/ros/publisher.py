# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes large clouds and images in ROS 2; of plain rclpy, without fusionslam: run by ``load``.

    python publisher.py POINTS RATE SECONDS

It begins once each topic has two subscribers, a node and a listener, says how many of each were
sent, and ends once all are received.
"""

import array
import sys
import time

import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header

SCANS, IMAGES, INFO = "/velodyne_points", "/camera/rgb/image_raw", "/camera/rgb/camera_info"
WIDTH, HEIGHT, FOCAL = 640, 480, 400.0
POINT_BYTES = 16
SUBSCRIBERS = 2


def cloud(points: int) -> PointCloud2:
    """Points all around a scanner whose axes are the camera's: z ahead, y down."""
    rng = np.random.default_rng(0)
    turn, far = rng.uniform(-np.pi, np.pi, points), rng.uniform(2, 40, points)
    rows = np.zeros((points, 4), np.float32)
    heights = rng.uniform(-3, 1, points)
    rows[:, :3] = np.column_stack([far * np.sin(turn), heights, far * np.cos(turn)])
    fields = [
        PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
        for k, name in enumerate(("x", "y", "z", "intensity"))
    ]
    return PointCloud2(
        height=1,
        width=points,
        fields=fields,
        point_step=POINT_BYTES,
        row_step=POINT_BYTES * points,
        is_dense=True,
        data=array.array("B", rows.tobytes()),
    )


def image() -> Image:
    """Noise."""
    noise = np.random.default_rng(1).integers(0, 256, WIDTH * HEIGHT * 3, np.uint8)
    return Image(
        height=HEIGHT,
        width=WIDTH,
        encoding="rgb8",
        step=3 * WIDTH,
        data=array.array("B", noise.tobytes()),
    )


def calibration() -> CameraInfo:
    """Of a camera without distortion."""
    matrix = [FOCAL, 0.0, WIDTH / 2, 0.0, FOCAL, HEIGHT / 2, 0.0, 0.0, 1.0]
    projection = [FOCAL, 0.0, WIDTH / 2, 0.0, 0.0, FOCAL, HEIGHT / 2, 0.0, 0.0, 0.0, 1.0, 0.0]
    return CameraInfo(
        height=HEIGHT,
        width=WIDTH,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=matrix,
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=projection,
    )


def main() -> None:
    """Publish at a rate."""
    points, rate, seconds = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
    rclpy.init()
    node = rclpy.create_node("publisher")
    messages = {SCANS: cloud(points), IMAGES: image(), INFO: calibration()}
    publishers = {
        topic: node.create_publisher(type(message), topic, QoSProfile(depth=50))
        for topic, message in messages.items()
    }
    while any(each.get_subscription_count() < SUBSCRIBERS for each in publishers.values()):
        time.sleep(0.1)
    time.sleep(1)
    began, count = time.monotonic(), round(rate * seconds)
    for number in range(count):
        time.sleep(max(0.0, began + number / rate - time.monotonic()))
        stamp = node.get_clock().now().to_msg()
        for topic, message in messages.items():
            message.header = Header(stamp=stamp, frame_id="camera")
            publishers[topic].publish(message)
    print(count, flush=True)
    for each in publishers.values():
        each.wait_for_all_acked(Duration(seconds=10))
    rclpy.shutdown()


if __name__ == "__main__":
    main()
