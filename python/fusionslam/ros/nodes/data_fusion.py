# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scans and images in, coloured clouds out (Stastny 2022, 4.2.2)."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import ClassVar

from fusionslam.config import option
from fusionslam.errors import DataError, ShapeError
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.messages import Message, Picture, Scan
from fusionslam.online import FrameBuilder, OnlineConfig
from fusionslam.ros.config import CommonConfig
from fusionslam.ros.message_types import (
    CAMERA_INFO,
    CLOUD,
    IMAGES,
    ODOMETRY,
    TRANSFORMS,
    builder,
)
from fusionslam.ros.node import Input, Node, Outlet
from fusionslam.sensors import Frame
from fusionslam.views.recorder import ROBOT_FUSION

SCANS, COLORED, COLORING = "velodyne_points", "rgb_cloud", "rgb_image"
LEFT = ("camera/rgb/image_raw", "camera/rgb/camera_info")
RIGHT = ("camera/right/image_raw", "camera/right/camera_info")
ODOM = "odom"


class DataFusionConfig(CommonConfig):
    """Of the node data_fusion."""

    fusion: FusionConfig = option(ROBOT_FUSION, "what a cloud is made of, where it lies, ground")
    # rospy may deliver odometry later than scans: at five times a bag's pace, by half a second.
    online: OnlineConfig = option(
        OnlineConfig(wait=2.0), "which image belongs to which scan; frames"
    )


def frame_builder(config: DataFusionConfig) -> FrameBuilder:
    """What makes frames of messages, with the cameras that the source of clouds needs."""
    source = config.fusion.source
    cameras = {"lidar": ("left",), "stereo": ("left", "right"), "cloud": ()}
    return FrameBuilder(config.online, cameras=cameras[source], scans=source != "stereo")


class DataFusion(Node[DataFusionConfig]):
    """Pairs scans with images and publishes coloured clouds."""

    name = "data_fusion"
    defaults = DataFusionConfig()
    outputs: ClassVar = {COLORED: CLOUD, COLORING: IMAGES[0]}

    def __init__(self, config: DataFusionConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._source = config.fusion.source
        self._frames = frame_builder(config)

    @property
    def inputs(self) -> Sequence[Input]:
        """Scans, images with their calibration, odometry and TF."""
        found = [
            Input(ODOM, [ODOMETRY], self._take, optional=True),
            Input("/tf", [TRANSFORMS], self._take, shared=True, optional=True),
            Input("/tf_static", [TRANSFORMS], self._take, shared=True, optional=True),
        ]
        if self._source != "stereo":
            found.append(Input(SCANS, [CLOUD], self._take))
        if self._source != "cloud":
            found += self._camera("left", *LEFT)
        if self._source == "stereo":
            found += self._camera("right", *RIGHT)
        return found

    def _camera(self, camera: str, images: str, info: str) -> list[Input]:
        take = partial(self._take, camera=camera)
        return [Input(images, IMAGES, take), Input(info, [CAMERA_INFO], take)]

    def idle(self) -> None:
        """Fuse what waits: nothing that it waits for has come."""
        self._publish(self._frames.flush())

    def report(self) -> Mapping[str, int]:
        """Frames and all that was dropped, by reason."""
        frames = self._frames
        dropped = {f"{sensor}: {why}": count for (sensor, why), count in frames.dropped.items()}
        refused = {f"refused {kind}": count for kind, count in frames.refused.items()}
        more = {"frames": frames.frames, "without odometry": frames.still, "jumps": frames.jumps}
        return {**self.counts, **more, **dropped, **refused}

    def _take(self, message: Message, camera: str = "left") -> None:
        self._publish(self._frames.process(message, camera))

    def _publish(self, frames: list[Frame]) -> None:
        problem = None
        for frame in frames:
            try:
                self._fuse(frame)
            except (DataError, ShapeError) as error:
                problem = error
        if problem is not None:
            raise problem

    def _fuse(self, frame: Frame) -> None:
        cloud = fuse(frame, self.config.fusion)
        self.counts["empty clouds"] += not len(cloud)
        name = self._frames.frame_of(self.config.fusion.frame)
        scan = Scan(
            stamp_ns=frame.stamp_ns, frame_id=name, points=cloud.points, colors=cloud.colors
        )
        self.outlet.publish(COLORED, builder.build(scan))
        self._show(frame)

    def _show(self, frame: Frame) -> None:
        """Debian's RViz decodes no images; and it shows when a cloud got the wrong one."""
        if "left" in frame.images and self.outlet.is_wanted(COLORING):
            name = self._frames.frame_of("camera")
            picture = Picture(stamp_ns=frame.stamp_ns, frame_id=name, image=frame.images["left"])
            self.outlet.publish(COLORING, builder.build(picture))
