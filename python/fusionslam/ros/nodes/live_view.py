# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that shows what the other nodes publish in Foxglove, without RViz."""

import logging
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np

from fusionslam._core import ActionKind
from fusionslam.config import option
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.report.live import HOST, PORT
from fusionslam.ros.messages.types import (
    CLOUD,
    IMAGES,
    LOCATED_POSE,
    LOOP_CLOSURE,
    PATH,
    POSE,
    TOPOLOGICAL_ACTION,
    TOPOLOGICAL_MAP,
    TRANSFORMS,
    VIEW_DESCRIPTION,
    VIEW_STATISTICS,
    VIEW_TEMPLATE,
)
from fusionslam.ros.nodes.data_fusion import COLORED, COLORING
from fusionslam.ros.nodes.loop_closure import LOOPS
from fusionslam.ros.nodes.lv_analyzer import SHARES, STATISTICS
from fusionslam.ros.nodes.lv_builder import CLUSTERS, DESCRIPTIONS
from fusionslam.ros.nodes.lv_matching import TEMPLATES
from fusionslam.ros.nodes.ratslam import ACTIONS, MAP, MAP_PATH, PLACE
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import FrameTransform, FrameTransforms, Picture, Scan

logger = logging.getLogger(__name__)

_MAPPER_CLOUD, _MAPPER_PATH, _MAPPER_POSE = "mapper/cloud", "mapper/path", "mapper/pose"
_TF, _TF_STATIC = "/tf", "/tf_static"
_CLOUDS, _PATHS = (COLORED, CLUSTERS, _MAPPER_CLOUD), (MAP_PATH, _MAPPER_PATH)
_SIZE, _LOG = "ExperienceMap/size", "log"
_NUMBERS = {
    DESCRIPTIONS: ("objects",),
    TEMPLATES: ("current_id", "is_new", "relative_rad"),
    LOOPS: ("query", "match", "distance", "probability", "overlap", "rejected"),
    STATISTICS: ("views", "places", "false_positives", "false_negatives", *SHARES),
}
"""Fields of messages that are plotted."""
_SCHEMAS: dict[str, str | tuple[str, ...]] = {
    **dict.fromkeys(_CLOUDS, "PointCloud"),
    COLORING: "CompressedImage",
    MAP: "SceneUpdate",
    **dict.fromkeys(_PATHS, "PosesInFrame"),
    **dict.fromkeys((PLACE, _MAPPER_POSE), "PoseInFrame"),
    **dict.fromkeys((_TF, _TF_STATIC), "FrameTransforms"),
    **_NUMBERS,
    _SIZE: ("nodes", "edges", "loops"),
    _LOG: "Log",
}


class LiveViewConfig(CommonConfig):
    """Configuration of the node live_view."""

    host: str = option(
        HOST,
        "what the server listens on; by others than this machine's own address anyone who reaches "
        "it can read everything",
    )
    port: int = option(PORT, "port of the server; 0: any that is free", ge=0, le=65535)


class LiveView(Node[LiveViewConfig]):
    """Serves viewers of Foxglove, which connect to ws://127.0.0.1:8765, under the topics' names."""

    name = "live_view"
    defaults = LiveViewConfig()
    outputs: ClassVar = {}

    def __init__(self, config: LiveViewConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        from fusionslam.report.live import foxglove_messages
        from fusionslam.report.live.foxglove_server import FoxgloveServer

        self._make = foxglove_messages
        self._server = FoxgloveServer(_SCHEMAS, config.host, config.port, self.name)
        self.url = self._server.url
        logger.info("open %s in Foxglove", self.url)
        self._static: dict[str, FrameTransform] = {}
        self._loops: list[tuple[int, int]] = []

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: what the other nodes publish, as far as they run."""
        taken: list[tuple[str, Sequence[str], Callable[[Any], None]]] = [
            *((each, [CLOUD], partial(self._take_cloud, each)) for each in _CLOUDS),
            (COLORING, IMAGES, self._take_image),
            (MAP, [TOPOLOGICAL_MAP], self._take_map),
            (ACTIONS, [TOPOLOGICAL_ACTION], self._take_action),
            *((each, [PATH], partial(self._take_path, each)) for each in _PATHS),
            (PLACE, [POSE], partial(self._take_pose, PLACE)),
            (_MAPPER_POSE, [LOCATED_POSE], partial(self._take_pose, _MAPPER_POSE)),
            *((each, [TRANSFORMS], self._take_transforms) for each in (_TF, _TF_STATIC)),
            (DESCRIPTIONS, [VIEW_DESCRIPTION], partial(self._take_numbers, DESCRIPTIONS)),
            (TEMPLATES, [VIEW_TEMPLATE], self._take_template),
            (LOOPS, [LOOP_CLOSURE], self._take_loop),
            (STATISTICS, [VIEW_STATISTICS], partial(self._take_numbers, STATISTICS)),
        ]
        return [
            Input(
                topic,
                types,
                take,
                shared=topic in (_TF, _TF_STATIC),
                small=topic in (ACTIONS, PLACE),
                optional=True,
            )
            for topic, types, take in taken
        ]

    def close(self) -> None:
        """Disconnect the viewers."""
        self._server.close()
        super().close()

    def _take_cloud(self, topic: str, scan: Scan) -> None:
        # The map's cloud comes once, and later viewers want it, too.
        if topic == _MAPPER_CLOUD or self._server.is_wanted(topic):
            self._show(topic, scan.stamp_ns, self._make.cloud_message(scan))

    def _take_image(self, picture: Picture) -> None:
        if self._server.is_wanted(COLORING):
            self._show(COLORING, picture.stamp_ns, self._make.image_message(picture))

    def _take_action(self, message: Any) -> None:
        if message.action == int(ActionKind.CREATE_EDGE):
            self._loops.append((message.src_id, message.dest_id))

    def _take_map(self, message: Any) -> None:
        stamp_ns, frame = _header_of(message)
        places = [_numbers_of(each.pose)[:2] for each in message.node]
        nodes = np.array(places, np.float64).reshape(-1, 2)
        edges = [(each.source_id, each.destination_id) for each in message.edge]
        # A map that began anew does not have the loops of the old one.
        self._loops = [loop for loop in self._loops if max(loop) < len(nodes)]
        links, loops = (np.array(each, np.int64).reshape(-1, 2) for each in (edges, self._loops))
        self._show(MAP, stamp_ns, self._make.map_message(stamp_ns, frame, nodes, links, loops))
        size = {"nodes": len(nodes), "edges": len(edges), "loops": len(loops)}
        self._show(_SIZE, stamp_ns, size)

    def _take_path(self, topic: str, message: Any) -> None:
        stamp_ns, frame = _header_of(message)
        poses = np.array([_numbers_of(each.pose) for each in message.poses]).reshape(-1, 7)
        self._show(topic, stamp_ns, self._make.path_message(stamp_ns, frame, poses))

    def _take_pose(self, topic: str, message: Any) -> None:
        stamp_ns, frame = _header_of(message)
        pose = message.pose.pose if topic == _MAPPER_POSE else message.pose
        self._show(topic, stamp_ns, self._make.pose_message(stamp_ns, frame, _numbers_of(pose)))

    def _take_transforms(self, found: FrameTransforms) -> None:
        """Show transforms; all static ones together, so that later viewers get all."""
        static = {each.child: each for each in found.transforms if each.static}
        moving = tuple(each for each in found.transforms if not each.static)
        if static:
            self._static |= static
            every = FrameTransforms(transforms=tuple(self._static.values()))
            self._show(_TF_STATIC, 0, self._make.transforms_message(every))
        if moving:
            message = self._make.transforms_message(FrameTransforms(transforms=moving))
            self._show(_TF, moving[-1].stamp_ns, message)

    def _take_template(self, message: Any) -> None:
        self._take_numbers(TEMPLATES, message)
        self._show_text(message, message.reason)

    def _take_loop(self, message: Any) -> None:
        self._take_numbers(LOOPS, message)
        self._show_text(message, f"cloud {message.query} is at the place of cloud {message.match}")

    def _take_numbers(self, topic: str, message: Any) -> None:
        values = {name: float(getattr(message, name)) for name in _NUMBERS[topic]}
        self._show(topic, _header_of(message)[0], values)

    def _show_text(self, message: Any, text: str) -> None:
        stamp_ns, _ = _header_of(message)
        self._show(_LOG, stamp_ns, self._make.text_message(stamp_ns, text, is_warning=False))

    def _show(self, topic: str, stamp_ns: int, message: Any) -> None:
        self._server.show(topic, stamp_ns, message)
        self.counts[topic] += 1


def _header_of(message: Any) -> tuple[int, str]:
    return stamp_of(message.header.stamp), message.header.frame_id


def _numbers_of(pose: Any) -> list[float]:
    """Return position and quaternion of a geometry_msgs/Pose."""
    place, turn = pose.position, pose.orientation
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]
