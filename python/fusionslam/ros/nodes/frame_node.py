# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Base class of the nodes that make frames of what a robot's sensors publish."""

import logging
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Literal, TypeVar

from pydantic import field_validator

from fusionslam.config import option
from fusionslam.errors import ConfigError, DataError, FusionSlamError, ShapeError, cause_of
from fusionslam.fusion import SENSORS_OF, Source
from fusionslam.odometry import LidarOdometryConfig, LiveOdometry
from fusionslam.odometry.tracking import scan_odometry
from fusionslam.ros.messages.library import build
from fusionslam.ros.messages.types import CAMERA_INFO, CLOUD, IMAGES, IMU, ODOMETRY, TRANSFORMS
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.frame_builder import FrameBuilder, OnlineConfig
from fusionslam.sensors.messages import FrameTransforms, Imu, Message, Odometry, Scan
from fusionslam.sensors.synchronizer import BUFFER_FULL, DUPLICATE, LATE, NO_IMAGE, REASONS

logger = logging.getLogger(__name__)

SCANS = "velodyne_points"
LEFT = ("camera/rgb/image_raw", "camera/rgb/camera_info")
RIGHT = ("camera/right/image_raw", "camera/right/camera_info")
ODOM, IMU_TOPIC, TF = "odom", "imu", "/tf"
# Names that would give another camera's topics.
RESERVED = ("left", "right", "rgb", "points")
_LEADER = SCANS.removesuffix("_points")
_WENT_BACK = (
    "the clock went back, so waiting messages are dropped: this is normal for a bag that is played "
    "again; else check the sensors' clocks"
)
_ADVICE = {
    DUPLICATE: "is its driver running twice?",
    LATE: "~online/sync/lateness waits for messages that are out of order",
    NO_IMAGE: "is the camera published, and do both sensors have the same clock? The limit is "
    "~online/sync/max_difference",
    BUFFER_FULL: "are all sensors published, by one clock? ~online/sync/buffer holds more",
}


class FramesConfig(CommonConfig):
    """Configuration of the nodes that make frames."""

    # rospy has one thread per topic: when a bag is played five times as fast, odometry arrives up
    # to half a second of stamps after its scan, on a busy machine even later.
    online: OnlineConfig = option(
        OnlineConfig(wait=5.0),
        "pairing of images with scans; names of frames",
    )
    cameras: tuple[str, ...] = option(
        (),
        "names of further cameras that colour scans (source lidar); the images of each are on "
        "camera/NAME/image_raw, its calibration is on camera/NAME/camera_info",
    )
    scanners: tuple[str, ...] = option(
        (),
        "names of further scanners whose scans are merged into those of velodyne_points; those of "
        "each are on NAME_points",
    )
    odometry: Literal["topic", "lidar", "inertial"] = option(
        "topic",
        "what tells the robot's motion: the topic odom, or TF; the scans; or scans and the IMU. Of "
        "the last two the node publishes the motion on odom and /tf",
    )
    lidar_odometry: LidarOdometryConfig = option(
        LidarOdometryConfig(), "of odometry lidar and inertial: scans to a path"
    )

    @field_validator("cameras")
    @classmethod
    def _cameras_are_further_ones(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name in RESERVED or not name.isidentifier() or names.count(name) > 1:
                raise ValueError(
                    f"{name!r} is no name of a further camera: expected letters, digits and _, "
                    f"none twice, and none of {', '.join(RESERVED)}"
                )
        return names

    @field_validator("scanners")
    @classmethod
    def _scanners_are_further_ones(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name == _LEADER or not name.isidentifier() or names.count(name) > 1:
                raise ValueError(
                    f"{name!r} is no name of a further scanner: expected letters, digits and _, "
                    f"none twice, and not {_LEADER}"
                )
        return names


def topics_of(camera: str) -> tuple[str, str]:
    """Topics of a camera's images and of its CameraInfo."""
    known = {"left": LEFT, "right": RIGHT}
    return known.get(camera) or (f"camera/{camera}/image_raw", f"camera/{camera}/camera_info")


def frame_builder(
    online: OnlineConfig,
    source: Source,
    *,
    surround: tuple[str, ...] = (),
    scanners: tuple[str, ...] = (),
    moving: bool = False,
) -> FrameBuilder:
    """Return a builder of frames from messages, with the cameras that a source of clouds needs."""
    sensors = SENSORS_OF[source]
    cameras = tuple(sensor for sensor in sensors if sensor != "points")
    return FrameBuilder(
        online,
        cameras=cameras,
        surround=surround if source == "lidar" else (),
        scanners=tuple(f"{name}_points" for name in scanners),
        scans="points" in sensors,
        moving=moving,
    )


C = TypeVar("C", bound=FramesConfig)


class FrameNode(Node[C]):
    """Pairs scans with images, and takes the robot's motion with them.

    Args:
        config: of its own type.
        outlet: receives the messages that it publishes.
        source: of its clouds, which says which sensors it needs.
        moving: as of ``FrameBuilder``.

    Attributes:
        frames: makes the frames.
        lead: topic of the sensor that each frame is of.
    """

    def __init__(self, config: C, outlet: Outlet, source: Source, *, moving: bool = False) -> None:
        super().__init__(config, outlet)
        self._sensors = SENSORS_OF[source]
        self.lead = SCANS if "points" in self._sensors else LEFT[0]
        self._logged: set[tuple[str, str]] = set()
        is_own = config.odometry != "topic"
        self.frames = frame_builder(
            config.online,
            source,
            surround=config.cameras,
            scanners=config.scanners,
            moving=moving or is_own,
        )
        self._motion: LiveOdometry | None = None
        if is_own and "points" not in self._sensors:
            raise ConfigError(
                f"~odometry is {config.odometry}, which needs scans, but clouds are made of "
                f"{' and '.join(self._sensors)} images: expected topic",
                code="no-scans",
                fields=("~odometry",),
            )
        if is_own:
            self._motion = LiveOdometry(
                scan_odometry(config.odometry, config.lidar_odometry),
                self.frames.robot,
                self._refuse,
                wait_s=config.online.wait,
                jump_s=config.online.sync.jump,
                most=config.online.sync.buffer,
            )

    @classmethod
    def outputs_of(cls, config: CommonConfig) -> Mapping[str, str]:
        """With odometry of its own, that, too."""
        assert isinstance(config, FramesConfig)
        own = {} if config.odometry == "topic" else {ODOM: ODOMETRY, TF: TRANSFORMS}
        return {**cls.outputs, **own}

    @abstractmethod
    def take_frame(self, frame: Frame) -> None:
        """Process a frame. Raises DataError or ShapeError for one that cannot be used."""

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: scans, images with their calibration, odometry, IMU and TF."""
        # What only one kind of odometry needs is named while it is silent.
        is_inertial = self.config.odometry == "inertial"
        found = [
            Input(IMU_TOPIC, [IMU], self._take, small=True, optional=not is_inertial),
            Input(TF, [TRANSFORMS], self._take, shared=True, optional=True),
            Input("/tf_static", [TRANSFORMS], self._take, shared=True, optional=True),
        ]
        if self._motion is None:
            found.append(Input(ODOM, [ODOMETRY], self._take, small=True, optional=True))
        if "points" in self._sensors:
            found.append(Input(SCANS, [CLOUD], self._take))
        cameras = [sensor for sensor in self._sensors if sensor != "points"]
        for camera in cameras:
            found += self._camera(camera)
        for camera in self.frames.surround.names:
            found += self._camera(camera, optional=True)
        for scanner in self.frames.scanners.names:
            take = partial(self._take, sensor=scanner)
            found.append(Input(scanner, [CLOUD], take, optional=True))
        return found

    def _camera(self, camera: str, *, optional: bool = False) -> list[Input]:
        take, (images, info) = partial(self._take, sensor=camera), topics_of(camera)
        return [
            Input(images, IMAGES, take, optional=optional),
            Input(info, [CAMERA_INFO], take, optional=optional),
        ]

    def idle(self) -> None:
        """Process the waiting frames: the messages that they wait for have not come."""
        if self._motion is not None:
            self._move(self._motion.settle)
        self._process(self.frames.settle())

    def report(self) -> Mapping[str, int | str]:
        """Count frames, and dropped messages by reason."""
        frames = self.frames
        dropped = {f"{sensor}: {why}": count for (sensor, why), count in frames.dropped.items()}
        refused = {f"refused {kind}": count for kind, count in frames.refused.items()}
        missing = {**frames.surround.missing, **frames.scanners.missing}
        lacking = {f"without {name}": count for name, count in missing.items()}
        more = {"frames": frames.frames, "without odometry": frames.still, "jumps": frames.jumps}
        more["motion stays"] = frames.skewed
        motion = self._motion
        if motion is not None:
            more |= {f"odometry {what}": count for what, count in motion.counts.items()}
        said = {} if motion is None else {"odometry": motion.state}
        return {**said, **self.counts, **more, **lacking, **dropped, **refused}

    def went_back(self) -> None:
        """Called after the clock of the sensors went back, or odometry of scans was lost."""

    def _take(self, message: Message, sensor: str = "left") -> None:
        jumps, motion = self.frames.jumps, self._motion
        is_further = sensor in self.frames.scanners.names
        if motion is not None and isinstance(message, Scan) and not is_further:
            # First, as older frames wait for the motion that it tells.
            self._move(partial(motion.process, message))
        frames = self.frames.process(message, sensor)
        if self.frames.jumps > jumps:
            self.problems.add(self.lead, _WENT_BACK, "clock")
            self.went_back()
        self._process(frames)
        if motion is not None and isinstance(message, Imu | FrameTransforms):
            self._move(partial(motion.process, message))

    def _move(self, advance: Callable[[], list[Odometry]]) -> None:
        """Publish the robot's motion by scans, and make the frames that waited for it."""
        assert self._motion is not None
        restarts = self._motion.restarts
        for moved in advance():
            self.outlet.publish(ODOM, build(moved))
            self.outlet.publish(TF, build(FrameTransforms(transforms=(moved.transform,))))
            self._process(self.frames.process(moved))
        if self._motion.restarts > restarts:
            self.went_back()

    def _refuse(self, error: FusionSlamError) -> None:
        self.problems.add(ODOM, str(error), str(error.code))

    def _process(self, frames: list[Frame]) -> None:
        for frame in frames:
            try:
                self.take_frame(frame)
            except (DataError, ShapeError) as error:
                self.problems.add(self.lead, self.explain(error), *cause_of(error))
        for (sensor, reason), count in self.frames.dropped.items():
            if reason in _ADVICE and (sensor, reason) not in self._logged:
                self._logged.add((sensor, reason))
                why = f"{REASONS[reason]}: {_ADVICE[reason]}"
                words, cause = "%s: %d dropped, %s; %s", (reason, sensor)
                logger.warning(words, sensor, count, reason, why, extra={"cause": cause})

    def explain(self, error: DataError | ShapeError) -> str:
        """Say why a frame cannot be used, and what to do."""
        return str(error)
