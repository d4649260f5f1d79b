# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that turns coloured clouds into views for place recognition (Stastny 2022, 4.2.3)."""

import colorsys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from fusionslam.errors import ConfigError
from fusionslam.ros.messages.library import build, make
from fusionslam.ros.messages.types import (
    CLOUD,
    MARKERS,
    VIEW_DESCRIPTION,
    color,
    header,
    marker,
    point,
)
from fusionslam.ros.nodes.data_fusion import COLORED
from fusionslam.ros.nodes.view_config import EMPTY, ViewsConfig, cloud_of, matcher_of, source_of
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import Scan
from fusionslam.views.clusters import ClusteredScan, cluster_scan
from fusionslam.views.recognisers import scene_config
from fusionslam.views.serialization import view_to_bytes

DESCRIPTIONS = "current_scene_description"
CLUSTERS, HULLS = "clustered_viz", "convex_hull_viz"
_GREY = (90, 90, 90)
_GOLDEN = 0.618034  # of a turn between hues: neighbours differ for any number of hues
_TRIANGLES, _DELETE_ALL = 11, 3
_SEE_THROUGH = 0.25


class ViewBuilder(Node[ViewsConfig]):
    """Makes views from clouds, and shows their objects in RViz."""

    name = "lv_builder"
    defaults = ViewsConfig()
    outputs: ClassVar = {DESCRIPTIONS: VIEW_DESCRIPTION, CLUSTERS: CLOUD, HULLS: MARKERS}

    def __init__(self, config: ViewsConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        matcher = matcher_of(source_of(config))
        if matcher is None:
            raise ConfigError(
                f"~source is {config.source!r}, which compares images: lv_builder needs clouds"
            )
        self._comparison = matcher.comparison
        self._scenes = scene_config(matcher.config)

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: coloured clouds."""
        return [Input(COLORED, [CLOUD], self._take)]

    def _take(self, scan: Scan) -> None:
        cloud = cloud_of(scan)
        view = self._comparison.view(cloud)
        if not len(cloud):
            self.problems.add(COLORED, EMPTY, "empty-cloud")
        self.counts["views"] += 1
        self.counts["views with nothing to recognise"] += not view.objects
        message = make(
            VIEW_DESCRIPTION,
            header=header(scan.stamp_ns, scan.frame_id),
            kind=self._comparison.kind,
            objects=view.objects,
            data=view_to_bytes(self._comparison, view),
        )
        self.outlet.publish(DESCRIPTIONS, message)
        wanted = {name for name in (CLUSTERS, HULLS) if self.outlet.is_wanted(name)}
        if not wanted:
            return
        objects = cluster_scan(0, cloud, self._scenes)
        if CLUSTERS in wanted:
            self.outlet.publish(CLUSTERS, build(_clustered_cloud(scan, objects)))
        if HULLS in wanted:
            self.outlet.publish(HULLS, _hull_markers(scan, objects))


def _clustered_cloud(scan: Scan, objects: ClusteredScan) -> Scan:
    """Colour each point of a scan by its object; points without an object are grey."""
    colors = np.full((len(objects.points), 3), _GREY, np.uint8)
    for number, members in enumerate(objects.members):
        colors[members] = np.round(255 * np.array(_hue(number)))
    return replace(scan, points=objects.points, colors=colors, fields={}, width=0)


def _hull_markers(scan: Scan, objects: ClusteredScan) -> Any:
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
