# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Markers for RViz."""

from collections.abc import Sequence
from typing import Any

from fusionslam.ros.messages.library import make
from fusionslam.ros.messages.types import ground_pose


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
