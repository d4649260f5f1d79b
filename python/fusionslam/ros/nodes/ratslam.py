# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that makes a map and localises the robot on it from odometry and view ids.

Source: Stastny 2022, 4.2.5.
"""

import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from fusionslam.config import option
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.ratslam.event_order import OrderConfig
from fusionslam.ratslam.events import Look
from fusionslam.ratslam.external_views import GivenView
from fusionslam.ratslam.map_export import export_run
from fusionslam.ratslam.online import OnlineRatSlam, OnlineRatSlamConfig
from fusionslam.ratslam.slam import RatSlamConfig, Step
from fusionslam.ros.messages.library import build, make
from fusionslam.ros.messages.maps import action_message, map_markers, map_message, path_message
from fusionslam.ros.messages.types import (
    MARKERS,
    ODOMETRY,
    PATH,
    POSE,
    TOPOLOGICAL_ACTION,
    TOPOLOGICAL_MAP,
    TRANSFORMS,
    VIEW_TEMPLATE,
    ground_pose,
    header,
)
from fusionslam.ros.nodes.lv_matching import TEMPLATES
from fusionslam.ros.runtime.checkpoints import SavingConfig, Settings
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import NANOSECONDS, FrameTransform, FrameTransforms, Odometry

ACTIONS, PLACE = "PoseCell/TopologicalAction", "ExperienceMap/RobotPose"
MAP, MAP_MARKERS, MAP_PATH = "ExperienceMap/Map", "ExperienceMap/MapMarker", "ExperienceMap/Path"
TF = "/tf"
_SHOWN = 20_000
"""Number of nodes shown on the path: the robot's last hours."""
_SHARE = 20
"""Publishing a map takes at most 1 in this many seconds: a large map takes seconds to convert."""


class MapperConfig(CommonConfig):
    """Configuration of the node ratslam."""

    ratslam: RatSlamConfig = option(RatSlamConfig(), "pose cells and map")
    order: OrderConfig = option(OnlineRatSlamConfig().order, "order of the messages")
    memory: SavingConfig = option(SavingConfig(), "file of the map")
    export: str = option(
        "", "folder for the map as JSON, g2o, GraphML and TUM when the node ends; empty: none"
    )
    map_frame: str = option("map", "the frame of the map")
    tf: bool = option(True, "whether to publish the pose of the odometry frame on the map on /tf")
    every: float = option(
        1.0, "shortest time between two published maps; longer for large maps", unit="s", ge=0
    )


class Mapper(Node[MapperConfig]):
    """Makes the map and publishes the robot's pose on it."""

    name = "ratslam"
    defaults = MapperConfig()
    outputs: ClassVar = {
        ACTIONS: TOPOLOGICAL_ACTION,
        PLACE: POSE,
        MAP: TOPOLOGICAL_MAP,
        MAP_MARKERS: MARKERS,
        MAP_PATH: PATH,
        TF: TRANSFORMS,
    }
    latched = (MAP, MAP_MARKERS, MAP_PATH)

    def __init__(self, config: MapperConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._saver = self.make_saver(config.memory, lambda path: self._online.save(path))
        self._own = OnlineRatSlamConfig(ratslam=config.ratslam, order=config.order)
        self._online = OnlineRatSlam(self._own)
        self._saver.resume(self._load, {"ratslam": config.ratslam})
        self._visits: deque[int] = deque(maxlen=_SHOWN)
        self._shown_ns: int | None = None
        self._is_shown = True
        self._drawing_s = 0.0

    def _load(self, path: Path) -> Settings:
        self._online = OnlineRatSlam.load(path, self._own)
        return {"ratslam": self._online.slam.config}

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: odometry and the ids of recognised views."""
        return [
            Input("odom", [ODOMETRY], self._take_odometry, small=True),
            Input(TEMPLATES, [VIEW_TEMPLATE], self._take_view),
        ]

    def idle(self) -> None:
        """Process waiting views; publish and save the map."""
        self._publish(self._online.settle())
        self._show()
        super().idle()

    def close(self) -> None:
        """Save and export the map."""
        self._publish(self._online.flush())
        super().close()
        if self.config.export:
            here = self._online.live_map("live map", "odom")
            export_run(Path(self.config.export).expanduser(), here)

    def report(self) -> Mapping[str, int]:
        """Count nodes, links, refused loops and messages left out."""
        graph = self._online.slam.map
        size = {"nodes": len(graph.nodes), "links": len(graph.links), "jumps": self._online.jumps}
        return {**self.counts, **size, **self._online.refused}

    def _take_odometry(self, odometry: Odometry) -> None:
        self._publish(self._online.process(odometry))
        if self.config.tf and odometry.frame_id:
            self._publish_frame(odometry)

    def _take_view(self, message: Any) -> None:
        view = GivenView(
            view_id=message.current_id,
            is_new=message.is_new,
            relative_rotation=message.relative_rad,
            relative_place=(message.relative_x, message.relative_y),
            reason=message.reason,
        )
        self._publish(self._online.process(Look(stamp_of(message.header.stamp), view)))

    def _publish(self, steps: list[Step]) -> None:
        for step in steps:
            self._publish_step(step)

    def _publish_step(self, step: Step) -> None:
        top = header(step.stamp_ns, self.config.map_frame)
        self.outlet.publish(PLACE, make(POSE, header=top, pose=ground_pose(step.pose)))
        if step.node is not None and (not self._visits or self._visits[-1] != step.node):
            self._visits.append(step.node)
        self.counts["loops refused"] += step.refused is not None
        if step.action.kind:
            self.counts["loops"] += step.action.kind == 2
            self.outlet.publish(ACTIONS, action_message(step, self.config.map_frame))
            self._is_shown = False
            self._saver.note_change()
        shown, every = self._shown_ns, max(self.config.every, _SHARE * self._drawing_s)
        is_due = shown is None or abs(step.stamp_ns - shown) >= every * NANOSECONDS
        if not self._is_shown and is_due:
            self._show()

    def _show(self) -> None:
        """Publish the current map; it is latched for later subscribers."""
        last = self._online.last
        if last is None or self._is_shown:
            return
        self._shown_ns, self._is_shown = last.stamp_ns, True
        began = time.monotonic()
        top, slam = header(last.stamp_ns, self.config.map_frame), self._online.slam
        self.outlet.publish(MAP, map_message(top, slam))
        self.outlet.publish(MAP_MARKERS, map_markers(top, slam))
        self.outlet.publish(MAP_PATH, path_message(top, slam.map.nodes, list(self._visits)))
        self._drawing_s = time.monotonic() - began

    def _publish_frame(self, odometry: Odometry) -> None:
        """Publish map <- odometry of the last step, stamped with the latest odometry.

        That step is earlier than the stamp while odometry waits for views.
        """
        place = self._online.map_from_odometry
        if place is None:
            return
        if odometry.frame_id.strip("/") == self.config.map_frame:
            self.problems.add(
                TF,
                f"odometry is in the frame '{odometry.frame_id}', which is the map's: nothing is "
                "published; give the map another ~map_frame, or set ~tf to false",
                "odometry-in-map-frame",
            )
            return
        link = FrameTransform(
            stamp_ns=odometry.stamp_ns,
            parent=self.config.map_frame,
            child=odometry.frame_id,
            parent_from_child=place,
        )
        self.outlet.publish(TF, build(FrameTransforms(transforms=(link,))))
