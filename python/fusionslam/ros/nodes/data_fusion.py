# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that turns scans and images into coloured clouds (Stastny 2022, 4.2.2)."""

from typing import ClassVar

from fusionslam.config import option
from fusionslam.errors import DataError, ShapeError
from fusionslam.fusion import ROBOT_FUSION, FusionConfig, fuse
from fusionslam.ros.messages.library import build
from fusionslam.ros.messages.types import CLOUD, IMAGES
from fusionslam.ros.nodes.frame_node import FrameNode, FramesConfig
from fusionslam.ros.runtime.node import Outlet
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Picture, Scan

COLORED, COLORING = "rgb_cloud", "rgb_image"
_NO_POINTS = "a scan has no points, or only NaN: check the scanner"
_NOTHING_SEEN = (
    "no point of a scan is left: do camera and scanner look the same way (TF), and what does "
    "~fusion remove?"
)
_ROBOT = "the robot's frame is ~online/robot_frame, or that of odometry: is it in TF?"


class DataFusionConfig(FramesConfig):
    """Configuration of the node data_fusion."""

    fusion: FusionConfig = option(ROBOT_FUSION, "source, frame and ground of the clouds")


class DataFusion(FrameNode[DataFusionConfig]):
    """Pairs scans with images and publishes coloured clouds."""

    name = "data_fusion"
    defaults = DataFusionConfig()
    outputs: ClassVar = {COLORED: CLOUD, COLORING: IMAGES[0]}

    def __init__(self, config: DataFusionConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet, config.fusion.source)

    def explain(self, error: DataError | ShapeError) -> str:
        """Say why a frame cannot be fused, and what to do."""
        return f"cannot be fused: {error}; {_ROBOT}"

    def take_frame(self, frame: Frame) -> None:
        """Publish the frame's cloud."""
        cloud = fuse(frame, self.config.fusion)
        if not len(cloud):
            self.counts["empty clouds"] += 1
            is_empty = frame.points is not None and not len(frame.points)
            said = (_NO_POINTS, "empty-scan") if is_empty else (_NOTHING_SEEN, "nothing-seen")
            self.problems.add(self.lead, *said)
        name = self.frames.frame_of(self.config.fusion.frame)
        scan = Scan(
            stamp_ns=frame.stamp_ns, frame_id=name, points=cloud.points, colors=cloud.colors
        )
        self.outlet.publish(COLORED, build(scan))
        # The decoded image, as Debian's RViz decodes none, and it reveals wrong pairs.
        if "left" in frame.images and self.outlet.is_wanted(COLORING):
            name = self.frames.frame_of("camera")
            picture = Picture(stamp_ns=frame.stamp_ns, frame_id=name, image=frame.images["left"])
            self.outlet.publish(COLORING, build(picture))
