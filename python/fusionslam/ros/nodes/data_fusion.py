# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that turns scans and images into coloured clouds (Stastny 2022, 4.2.2)."""

import logging
from collections.abc import Mapping, Sequence
from functools import partial
from typing import ClassVar

from fusionslam.config import option
from fusionslam.errors import DataError, ShapeError, cause_of
from fusionslam.fusion import ROBOT_FUSION, SENSORS_OF, FusionConfig, fuse
from fusionslam.ros.messages.types import CAMERA_INFO, CLOUD, IMAGES, ODOMETRY, TRANSFORMS, builder
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.frame_builder import FrameBuilder, OnlineConfig
from fusionslam.sensors.messages import Message, Picture, Scan
from fusionslam.sensors.synchronizer import BUFFER_FULL, DUPLICATE, LATE, NO_IMAGE, REASONS

logger = logging.getLogger(__name__)

SCANS, COLORED, COLORING = "velodyne_points", "rgb_cloud", "rgb_image"
LEFT = ("camera/rgb/image_raw", "camera/rgb/camera_info")
RIGHT = ("camera/right/image_raw", "camera/right/camera_info")
ODOM = "odom"
_NO_POINTS = "a scan has no points, or only NaN: check the scanner"
_NOTHING_SEEN = (
    "no point of a scan is left: do camera and scanner look the same way (TF), and what does "
    "~fusion remove?"
)
_WENT_BACK = (
    "the clock went back, so waiting messages are dropped: this is normal for a bag that is played "
    "again; else check the sensors' clocks"
)
_ROBOT = "the robot's frame is ~online/robot_frame, or that of odometry: is it in TF?"
_ADVICE = {
    DUPLICATE: "is its driver running twice?",
    LATE: "~online/sync/lateness waits for messages that are out of order",
    NO_IMAGE: "is the camera published, and do both sensors have the same clock? The limit is "
    "~online/sync/max_difference",
    BUFFER_FULL: "are all sensors published, by one clock? ~online/sync/buffer holds more",
}


class DataFusionConfig(CommonConfig):
    """Configuration of the node data_fusion."""

    fusion: FusionConfig = option(ROBOT_FUSION, "source, frame and ground of the clouds")
    # rospy has one thread per topic: when a bag is played five times as fast, odometry arrives up
    # to half a second of stamps after its scan, on a busy machine even later.
    online: OnlineConfig = option(
        OnlineConfig(wait=5.0),
        "pairing of images with scans; names of frames",
    )


def frame_builder(config: DataFusionConfig) -> FrameBuilder:
    """Return a builder of frames from messages, with the cameras that the source needs."""
    sensors = SENSORS_OF[config.fusion.source]
    cameras = tuple(sensor for sensor in sensors if sensor != "points")
    return FrameBuilder(config.online, cameras=cameras, scans="points" in sensors)


class DataFusion(Node[DataFusionConfig]):
    """Pairs scans with images and publishes coloured clouds."""

    name = "data_fusion"
    defaults = DataFusionConfig()
    outputs: ClassVar = {COLORED: CLOUD, COLORING: IMAGES[0]}

    def __init__(self, config: DataFusionConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._sensors = SENSORS_OF[config.fusion.source]
        self._lead = SCANS if "points" in self._sensors else LEFT[0]
        self._logged: set[tuple[str, str]] = set()
        self._frames = frame_builder(config)

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: scans, images with their calibration, odometry and TF."""
        found = [
            Input(ODOM, [ODOMETRY], self._take, small=True, optional=True),
            Input("/tf", [TRANSFORMS], self._take, shared=True, optional=True),
            Input("/tf_static", [TRANSFORMS], self._take, shared=True, optional=True),
        ]
        if "points" in self._sensors:
            found.append(Input(SCANS, [CLOUD], self._take))
        for camera, topics in (("left", LEFT), ("right", RIGHT)):
            if camera in self._sensors:
                found += self._camera(camera, *topics)
        return found

    def _camera(self, camera: str, images: str, info: str) -> list[Input]:
        take = partial(self._take, camera=camera)
        return [Input(images, IMAGES, take), Input(info, [CAMERA_INFO], take)]

    def idle(self) -> None:
        """Fuse the waiting frames: the messages that they wait for have not come."""
        self._publish(self._frames.flush())

    def report(self) -> Mapping[str, int]:
        """Count frames, and dropped messages by reason."""
        frames = self._frames
        dropped = {f"{sensor}: {why}": count for (sensor, why), count in frames.dropped.items()}
        refused = {f"refused {kind}": count for kind, count in frames.refused.items()}
        more = {"frames": frames.frames, "without odometry": frames.still, "jumps": frames.jumps}
        return {**self.counts, **more, **dropped, **refused}

    def _take(self, message: Message, camera: str = "left") -> None:
        jumps = self._frames.jumps
        self._publish(self._frames.process(message, camera))
        if self._frames.jumps > jumps:
            self.problems.add(self._lead, _WENT_BACK, "clock")

    def _publish(self, frames: list[Frame]) -> None:
        for frame in frames:
            try:
                self._fuse(frame)
            except (DataError, ShapeError) as error:
                problem = f"cannot be fused: {error}; {_ROBOT}"
                self.problems.add(self._lead, problem, *cause_of(error))
        self._log_dropped()

    def _log_dropped(self) -> None:
        for (sensor, reason), count in self._frames.dropped.items():
            if reason in _ADVICE and (sensor, reason) not in self._logged:
                self._logged.add((sensor, reason))
                why = f"{REASONS[reason]}: {_ADVICE[reason]}"
                words, cause = "%s: %d dropped, %s; %s", (reason, sensor)
                logger.warning(words, sensor, count, reason, why, extra={"cause": cause})

    def _fuse(self, frame: Frame) -> None:
        cloud = fuse(frame, self.config.fusion)
        if not len(cloud):
            self.counts["empty clouds"] += 1
            self._report_empty(frame)
        name = self._frames.frame_of(self.config.fusion.frame)
        scan = Scan(
            stamp_ns=frame.stamp_ns, frame_id=name, points=cloud.points, colors=cloud.colors
        )
        self.outlet.publish(COLORED, builder.build(scan))
        self._show(frame)

    def _report_empty(self, frame: Frame) -> None:
        if frame.points is not None and not len(frame.points):
            self.problems.add(self._lead, _NO_POINTS, "empty-scan")
        else:
            self.problems.add(self._lead, _NOTHING_SEEN, "nothing-seen")

    def _show(self, frame: Frame) -> None:
        """Publish the decoded image: Debian's RViz decodes none, and it reveals wrong pairs."""
        if "left" in frame.images and self.outlet.is_wanted(COLORING):
            name = self._frames.frame_of("camera")
            picture = Picture(stamp_ns=frame.stamp_ns, frame_id=name, image=frame.images["left"])
            self.outlet.publish(COLORING, builder.build(picture))
