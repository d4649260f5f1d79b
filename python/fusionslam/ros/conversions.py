# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses on the ground as ROS messages."""

import math
from typing import Any

from fusionslam.ros.message_types import make

Ground = tuple[float, float, float]


def ground_pose(place: Ground) -> Any:
    """A geometry_msgs/Pose of x, y in metres and a heading in radians."""
    x, y, heading = (float(value) for value in place)
    position = make("geometry_msgs/Point", x=x, y=y, z=0.0)
    return make("geometry_msgs/Pose", position=position, orientation=_turned(heading))


def ground_transform(place: Ground) -> Any:
    """A geometry_msgs/Transform of the same."""
    x, y, heading = (float(value) for value in place)
    translation = make("geometry_msgs/Vector3", x=x, y=y, z=0.0)
    return make("geometry_msgs/Transform", translation=translation, rotation=_turned(heading))


def _turned(heading: float) -> Any:
    z, w = math.sin(heading / 2), math.cos(heading / 2)
    return make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=z, w=w)
