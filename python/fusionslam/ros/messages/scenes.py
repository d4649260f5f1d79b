# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that show scenes in RViz."""

import colorsys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from fusionslam.ros.messages.library import make
from fusionslam.ros.messages.markers import color, marker, point
from fusionslam.ros.messages.types import MARKERS, header
from fusionslam.sensors.messages import Scan
from fusionslam.views.clusters import ClusteredScan

_GREY = (90, 90, 90)
_GOLDEN = 0.618034  # of a turn between hues: neighbours differ for any number of hues
_TRIANGLES, _DELETE_ALL = 11, 3
_SEE_THROUGH = 0.25


def clustered_cloud(scan: Scan, objects: ClusteredScan) -> Scan:
    """Colour each point of a scan by its object; points without an object are grey."""
    colors = np.full((len(objects.points), 3), _GREY, np.uint8)
    for number, members in enumerate(objects.members):
        colors[members] = np.round(255 * np.array(_hue(number)))
    return replace(scan, points=objects.points, colors=colors, fields={}, width=0)


def hull_markers(scan: Scan, objects: ClusteredScan) -> Any:
    """Return the objects' convex hulls as triangles; deletes those of the previous scan."""
    top = header(scan.stamp_ns, scan.frame_id)
    markers = [make("visualization_msgs/Marker", header=top, action=_DELETE_ALL)]
    for number, members in enumerate(objects.members):
        corners = [point(*row) for row in _triangles(objects.points[members])]
        if corners:
            look = color(_hue(number), _SEE_THROUGH)
            markers.append(marker(top, "hulls", number, _TRIANGLES, [1.0] * 3, look))
            markers[-1].points = corners
    return make(MARKERS, markers=markers)


def _hue(number: int) -> tuple[float, float, float]:
    return colorsys.hsv_to_rgb(number * _GOLDEN % 1, 0.75, 1.0)


def _triangles(points: NDArray[np.float32]) -> Iterator[list[float]]:
    """Yield the corners of the hull's triangles, three at a time; none for a flat object."""
    try:
        hull = ConvexHull(points.astype(np.float64))
    except QhullError:
        return
    for triangle in hull.simplices:
        yield from hull.points[triangle].tolist()
