# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Robot descriptions: frames, drive limits, sensors and published topics.

A description is a YAML file with the keys of ``RobotConfig``; some come with the package.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import model_validator

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats
from fusionslam.config import Section, option, suggest, with_file
from fusionslam.errors import ConfigError
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.geometry.rigid import rotation
from fusionslam.sensors.messages import FrameTransform
from fusionslam.sim.camera import CameraMount, parent_from_camera
from fusionslam.sim.lidar import LidarMount, Vector
from fusionslam.sim.motion.path_following import DriveLimits
from fusionslam.sim.motion.riding import SwayConfig

_ROBOTS = Path(__file__).with_name("robots")


class FrameConfig(Section):
    """A frame fixed to the robot."""

    parent: str = option("base_footprint", "parent frame", min_length=1)
    position_m: Vector = option((0.0, 0.0, 0.0), "position in the parent frame", unit="m")
    tilt_deg: Vector = option((0.0, 0.0, 0.0), "roll, pitch, yaw in the parent frame", unit="deg")


class OdometryMount(Section):
    """The odometry that the robot publishes."""

    topic: str = option("/odom", "topic of the odometry", min_length=1)
    frame_id: str = option("odom", "frame of the odometry; equal to the world's at the start")
    rate_hz: float = option(30.0, "poses per second, as odometry and as TF", unit="Hz", gt=0)
    errors: OdometryConfig = option(OdometryConfig(), "errors of the odometry")


class ImuMount(Section):
    """An inertial measurement unit mounted on the robot, and its errors.

    Noise is white, given as a density; biases begin at random and walk.
    """

    topic: str = option("/imu", "topic of the messages", min_length=1)
    frame_id: str = option("imu", "frame of its axes", min_length=1)
    parent: str = option("base_footprint", "parent frame", min_length=1)
    position_m: Vector = option((0.0, 0.0, 0.0), "position in the parent frame", unit="m")
    tilt_deg: Vector = option((0.0, 0.0, 0.0), "roll, pitch, yaw in the parent frame", unit="deg")
    rate_hz: float = option(200.0, "messages per second", unit="Hz", gt=0, le=2000)
    gyro_noise: float = option(1e-4, "of the turn rate", unit="rad/s/sqrt(Hz)", ge=0)
    gyro_bias: float = option(2e-3, "standard deviation at the start", unit="rad/s", ge=0)
    gyro_walk: float = option(1e-5, "of the turn rate's bias", unit="rad/s^2/sqrt(Hz)", ge=0)
    accel_noise: float = option(1e-3, "of the acceleration", unit="m/s^2/sqrt(Hz)", ge=0)
    accel_bias: float = option(0.02, "standard deviation at the start", unit="m/s^2", ge=0)
    accel_walk: float = option(1e-4, "of the acceleration's bias", unit="m/s^3/sqrt(Hz)", ge=0)


class GnssMount(Section):
    """A satellite receiver whose antenna is mounted on the robot, and its errors.

    Deviations are those of east and north each; heights err twice as much.
    """

    topic: str = option("/gps/fix", "topic of the messages", min_length=1)
    frame_id: str = option("gps", "frame of the antenna", min_length=1)
    parent: str = option("base_footprint", "parent frame", min_length=1)
    position_m: Vector = option((0.0, 0.0, 0.0), "position in the parent frame", unit="m")
    tilt_deg: Vector = option((0.0, 0.0, 0.0), "roll, pitch, yaw in the parent frame", unit="deg")
    rate_hz: float = option(5.0, "messages per second", unit="Hz", gt=0, le=100)
    noise_m: float = option(0.5, "white noise of each fix", unit="m", ge=0)
    multipath_m: float = option(1.0, "bias by reflected signals, which changes", unit="m", ge=0)
    multipath_s: float = option(30.0, "time in which that bias changes", unit="s", gt=0)
    outliers: float = option(0.0, "part of the fixes that are far off", ge=0, le=1)
    outlier_m: float = option(50.0, "how far off these are", unit="m", ge=0)
    gap_every_s: float | None = option(
        None, "mean time from a gap to the next; none: no gaps", unit="s", gt=0
    )
    gap_s: float = option(60.0, "length of gaps, in which there is no fix", unit="s", gt=0)


class RobotConfig(Section):
    """A wheeled robot with LiDARs and cameras."""

    base_frame: str = option(
        "base_footprint", "frame on the ground that follows the drive", min_length=1
    )
    radius_m: float = option(0.22, "radius of the footprint", unit="m", gt=0, le=10)
    height_m: float = option(0.4, "height; higher surfaces are no obstacles", unit="m", gt=0, le=10)
    drive: DriveLimits = option(DriveLimits(), "limits of its speed and turn rate")
    frames: dict[str, FrameConfig] = option({}, "frames fixed to the robot, by name")
    lidars: dict[str, LidarMount] = option({}, "LiDARs, by name")
    cameras: dict[str, CameraMount] = option({}, "cameras, by name")
    imus: dict[str, ImuMount] = option({}, "inertial measurement units, by name")
    gnss: dict[str, GnssMount] = option({}, "satellite receivers, by name")
    odometry: OdometryMount = option(OdometryMount(), "the odometry that it publishes")
    sway: SwayConfig = option(SwayConfig(), "how its body moves beside the planned way")

    @model_validator(mode="after")
    def _sensors_fit_together(self) -> "RobotConfig":
        # A right camera uses its left one's frame, as its P does (REP 104).
        left = {c.frame_id: c for c in self.cameras.values() if c.side == "left"}
        for name, camera in self.cameras.items():
            other = left.get(camera.frame_id)
            if camera.side == "right" and (other is None or _place(other) != _place(camera)):
                raise ValueError(
                    f"cameras.{name} is the right one of a pair: expected frame_id, parent, "
                    f"position_m and tilt_deg of the left one, found frame_id {camera.frame_id!r}"
                )
        fixed = [transform.child for transform in static_transforms(self)]
        _check_unique("frame", [self.base_frame, self.odometry.frame_id, WORLD, *fixed])
        topics = [lidar.topic for lidar in self.lidars.values()]
        topics += [imu.topic for imu in self.imus.values()]
        topics += [receiver.topic for receiver in self.gnss.values()]
        topics += [camera.picture_topic() for camera in self.cameras.values()]
        topics += [camera.info_topic for camera in self.cameras.values()]
        _check_unique("topic", [*OWN_TOPICS, self.odometry.topic, *topics])
        for child in fixed:
            base_from(self, child)
        return self


WORLD = "world"
"""The frame of the ground-truth poses."""
TRUTH_TOPIC, TF_TOPIC, TF_STATIC_TOPIC = "/ground_truth", "/tf", "/tf_static"
OWN_TOPICS = (TRUTH_TOPIC, TF_TOPIC, TF_STATIC_TOPIC)


def robot_names() -> list[str]:
    """Names of the robots that come with the package."""
    return sorted(path.stem for path in _ROBOTS.glob("*.yaml"))


@checked
def robot_named(name: str | Path) -> RobotConfig:
    """Load a robot by its name in the package or by the path of its YAML file.

    Raises:
        ConfigError: no such robot, or an invalid description: the message names file and key.
    """
    known = robot_names()
    path = _ROBOTS / f"{name}.yaml" if str(name) in known else Path(name)
    if path.suffix not in (".yaml", ".yml"):
        raise ConfigError(
            f"robot {str(name)!r}: expected {', '.join(known)} or a .yaml file"
            f"{suggest(str(name), known)}"
        )
    try:
        robot = with_file(RobotConfig(), path, new_names=True)
    except ConfigError as error:
        if error.code == "config-file":
            raise
        raise ConfigError(f"{path}: {error}", code=error.code, fields=error.fields) from error
    if not (robot.lidars or robot.cameras):
        raise ConfigError(f"{path}: the robot has no sensor: expected lidars, cameras or both")
    return robot


def static_transforms(robot: RobotConfig) -> tuple[FrameTransform, ...]:
    """TF transforms of the robot's and its sensors' frames, in the order of the description."""
    poses = [(name, frame.parent, _pose(frame)) for name, frame in robot.frames.items()]
    poses += [(mount.frame_id, mount.parent, _pose(mount)) for mount in robot.lidars.values()]
    poses += [(mount.frame_id, mount.parent, _pose(mount)) for mount in robot.imus.values()]
    poses += [(mount.frame_id, mount.parent, _pose(mount)) for mount in robot.gnss.values()]
    poses += [
        (camera.frame_id, camera.parent, parent_from_camera(camera))
        for camera in robot.cameras.values()
        if camera.side == "left"
    ]
    return tuple(
        FrameTransform(stamp_ns=0, parent=parent, child=child, parent_from_child=pose, static=True)
        for child, parent, pose in poses
    )


def base_from(robot: RobotConfig, frame: str) -> Floats:
    """Pose of one of the robot's frames in the base frame, float64 (4, 4).

    Raises:
        ConfigError: the chain of parents does not end at the base frame.
    """
    links: Mapping[str, FrameTransform] = {link.child: link for link in static_transforms(robot)}
    pose, at, passed = np.eye(4), frame, [frame]
    while at != robot.base_frame:
        if at not in links or links[at].parent in passed:
            chain = " -> ".join(passed)
            why = "goes round" if at in links else f"does not reach {robot.base_frame}"
            raise ConfigError(f"the chain of frames {chain} {why}")
        pose, at = links[at].parent_from_child @ pose, links[at].parent
        passed.append(at)
    return pose


def base_from_camera(robot: RobotConfig, camera: CameraMount) -> Floats:
    """Pose of a camera, left or right, in the base frame, float64 (4, 4)."""
    pose = base_from(robot, camera.frame_id)
    if camera.side == "right":
        pose[:3, 3] += pose[:3, 0] * camera.baseline_m
    return pose


def _pose(mount: FrameConfig | LidarMount | ImuMount | GnssMount) -> Floats:
    pose = np.eye(4)
    pose[:3, :3] = rotation(np.deg2rad(mount.tilt_deg).tolist())
    pose[:3, 3] = mount.position_m
    return pose


def _place(camera: CameraMount) -> tuple[str, Vector, Vector]:
    return camera.parent, camera.position_m, camera.tilt_deg


def _check_unique(what: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{what} {name!r} is used twice")
