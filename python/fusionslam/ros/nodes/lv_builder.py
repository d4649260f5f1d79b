# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that turns coloured clouds into views for place recognition (Stastny 2022, 4.2.3)."""

from collections.abc import Sequence
from typing import ClassVar

from fusionslam.errors import ConfigError
from fusionslam.ros.messages.library import build, make
from fusionslam.ros.messages.scenes import clustered_cloud, hull_markers
from fusionslam.ros.messages.types import CLOUD, MARKERS, VIEW_DESCRIPTION, header
from fusionslam.ros.nodes.data_fusion import COLORED
from fusionslam.ros.nodes.view_config import EMPTY, ViewsConfig, cloud_of, matcher_of, source_of
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Scan
from fusionslam.views.clusters import cluster_scan
from fusionslam.views.recognisers import scene_config
from fusionslam.views.serialization import view_to_bytes

DESCRIPTIONS = "current_scene_description"
CLUSTERS, HULLS = "clustered_viz", "convex_hull_viz"


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
        self._show(scan, cloud)

    def _show(self, scan: Scan, cloud: Cloud) -> None:
        wanted = {name for name in (CLUSTERS, HULLS) if self.outlet.is_wanted(name)}
        if not wanted:
            return
        objects = cluster_scan(0, cloud, self._scenes)
        if CLUSTERS in wanted:
            self.outlet.publish(CLUSTERS, build(clustered_cloud(scan, objects)))
        if HULLS in wanted:
            self.outlet.publish(HULLS, hull_markers(scan, objects))
