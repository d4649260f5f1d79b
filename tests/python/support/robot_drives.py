# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot's sensors deliver, topic by topic as the node data_fusion names them."""

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any

from bag_maker import SECOND, drive
from fusionslam.sensors.messages import FrameTransforms

TOPICS = {
    "/tf_static": "/tf_static",
    "/odom": "odom",
    "/points": "velodyne_points",
    "/camera/image": "camera/rgb/image_raw",
    "/camera/camera_info": "camera/rgb/camera_info",
}
SCANS, IMAGES, INFOS = TOPICS["/points"], TOPICS["/camera/image"], TOPICS["/camera/camera_info"]
Sent = list[tuple[str, Any]]
"""Topics and values of ``fusionslam.sensors.messages``, or ROS messages, in order."""


def sent(seconds: float = 4.0, later: float = 0.0) -> Sent:
    """A drive, ``later`` seconds after the usual one: a scan each half second."""
    return [(TOPICS[e.topic], moved(e.message, round(later * SECOND))) for e in drive(seconds)]


def moved(value: Any, by_ns: int) -> Any:
    """A value, that much later."""
    if isinstance(value, FrameTransforms):
        return value
    return dataclasses.replace(value, stamp_ns=value.stamp_ns + by_ns)


def spoiled(messages: Sent, topic: str, how: Callable[[Any], Any]) -> Sent:
    """All messages of a topic changed."""
    return [(name, how(value) if name == topic else value) for name, value in messages]


def replaced(messages: Sent, topic: str, **changes: Any) -> Sent:
    """All messages of a topic with other values."""
    return spoiled(messages, topic, lambda value: dataclasses.replace(value, **changes))


def without(messages: Sent, *topics: str) -> Sent:
    """As if nobody published them."""
    return [(name, value) for name, value in messages if name not in topics]


def only(messages: Iterable[tuple[str, Any]], topic: str) -> list[Any]:
    """The values of one topic."""
    return [value for name, value in messages if name == topic]
