# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``FoxgloveView``: a growing map in Foxglove.

with FoxgloveView() as view:
    run_ratslam(drive, watch=view.step)
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from fusionslam._core import ActionKind
from fusionslam.fusion import fuse
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.ratslam.slam import RatSlam, Step
from fusionslam.ratslam.view_sources import MatcherSource
from fusionslam.report.live import HOST, PORT
from fusionslam.report.live.foxglove_messages import (
    cloud_message,
    image_message,
    map_message,
    path_message,
    text_message,
    transforms_message,
)
from fusionslam.report.live.foxglove_server import FoxgloveServer, Schema
from fusionslam.report.live.run_view import COLOURS, RunView, image_of
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.sensors.messages import FrameTransform, FrameTransforms, Picture, Scan

if TYPE_CHECKING:
    from fusionslam.geometry.trajectory import Trajectory

_MAP, _ROBOT = "map", "robot"
_FRAMES = {"live": _ROBOT, "dead_reckoning": "dead_reckoning", "truth": "truth"}
_TOPICS: dict[str, Schema] = {
    "cloud": "PointCloud",
    "image": "CompressedImage",
    "map": "SceneUpdate",
    **{f"way/{which}": "PosesInFrame" for which in COLOURS},
    "tf": "FrameTransforms",
    "views": ("id", "node"),
    "size": ("nodes", "links", "loops", "refused"),
    "log": "Log",
}


class FoxgloveView(RunView):
    """Shows map, paths, loops, clouds, images and numbers while RatSLAM runs.

    Topics: ``map`` (nodes, links and loops), ``way/...`` and frames as ``RerunView`` has robots,
    ``cloud`` (in the robot's frame) and ``image`` of what was looked at, if a viewer shows them,
    the numbers ``views`` and ``size``, and ``log``.

    Args:
        host, port: as of ``FoxgloveServer``.
        name: name of the run, for display.
        truth: true trajectory of the robot; None if unknown.

    Attributes:
        url: for the viewer.

    Raises:
        ConfigError: as ``FoxgloveServer``.
    """

    def __init__(
        self,
        host: str = HOST,
        port: int = PORT,
        name: str = "RatSLAM",
        truth: "Trajectory | None" = None,
    ) -> None:
        super().__init__(truth)
        self._server = FoxgloveServer(_TOPICS, host, port, name)
        self.url = self._server.url
        self._stamp_ns = 0
        self._robots_now: dict[str, FrameTransform] = {}
        self._loops: list[tuple[int, int]] = []
        self._refused = 0

    def step(self, step: Step, slam: RatSlam, event: Any = None) -> None:
        """As ``RunView``."""
        if step.action.kind == ActionKind.CREATE_EDGE:
            self._loops.append((step.action.source, step.action.target))
        self._refused += step.refused is not None
        super().step(step, slam, event)

    def _end(self) -> None:
        self._server.close()

    def _set_time(self, stamp_ns: int) -> None:
        self._stamp_ns = stamp_ns

    def _show_robot(self, which: str, place: list[float], heading: float) -> None:
        x, y, _ = np.array([[*place[:2], heading]]).T
        self._robots_now[which] = FrameTransform(
            stamp_ns=self._stamp_ns,
            parent=_MAP,
            child=_FRAMES[which],
            parent_from_child=ground_poses(x, y, np.array([heading]))[0],
        )
        found = FrameTransforms(transforms=tuple(self._robots_now.values()))
        self._show("tf", transforms_message(found))

    def _show_view(self, step: Step, slam: RatSlam) -> None:
        numbers = {"id": step.view_id, "node": step.node}
        self._show("views", {name: value for name, value in numbers.items() if value is not None})

    def _show_item(self, item: Any, slam: RatSlam) -> bool:
        image = image_of(item, slam) if self._server.is_wanted("image") else None
        if image is not None:
            picture = Picture(stamp_ns=self._stamp_ns, frame_id="camera", image=image)
            self._show("image", image_message(picture))
        cloud = _cloud_of(item, slam) if self._server.is_wanted("cloud") else None
        if cloud is not None:
            scan = Scan(
                stamp_ns=self._stamp_ns, frame_id=_ROBOT, points=cloud.points, colors=cloud.colors
            )
            self._show("cloud", cloud_message(scan))
        return image is not None or cloud is not None

    def _show_text(self, text: str, *, is_refusal: bool) -> None:
        self._show("log", text_message(self._stamp_ns, text, is_warning=is_refusal))

    def _show_map(self, slam: RatSlam) -> None:
        for which, way in self._ways.items():
            if way:
                poses = np.pad(np.array(way), ((0, 0), (0, 4)))
                poses[:, 6] = 1.0
                self._show(f"way/{which}", path_message(self._stamp_ns, _MAP, poses))
        nodes, links = slam.map.nodes, slam.map.links
        ends = np.stack([links["source"], links["target"]], axis=1)
        loops = np.array(self._loops, np.int64).reshape(-1, 2)
        self._show("map", map_message(self._stamp_ns, _MAP, nodes, ends, loops))
        size = {"nodes": len(nodes), "links": len(links)}
        self._show("size", size | {"loops": len(loops), "refused": self._refused})

    def _show(self, topic: str, message: Any) -> None:
        self._server.show(topic, self._stamp_ns, message)


def _cloud_of(item: Any, slam: RatSlam) -> Cloud | None:
    """The cloud that was looked at, fused as views are; None for images."""
    if isinstance(item, Frame) and isinstance(slam.views, MatcherSource):
        return fuse(item, slam.views.matcher.fusion_config)
    return item if isinstance(item, Cloud) else None
