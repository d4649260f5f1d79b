# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate the messages that a robot publishes while it drives through a world."""

import heapq
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.base.parallel import ordered_results
from fusionslam.config import Section, merged, option
from fusionslam.geometry.globe import MapOrigin
from fusionslam.geometry.odometry_noise import OdometryConfig, OdometryTrack, simulate_odometry
from fusionslam.geometry.se3 import inverse, log
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sensors.messages import (
    NANOSECONDS,
    Event,
    Fix,
    FrameTransform,
    FrameTransforms,
    Imu,
    Message,
    Odometry,
    Picture,
    Scan,
)
from fusionslam.sim.camera import CameraMount, camera_info, gains, photograph
from fusionslam.sim.gnss import GnssTrack, simulate_gnss
from fusionslam.sim.imu import STEP_S, ImuTrack, simulate_imu
from fusionslam.sim.lidar import LidarMount, column_seconds, point_fields, scan
from fusionslam.sim.motion.clearance import check_trajectory
from fusionslam.sim.motion.occupancy import OccupancyMap, occupancy_of
from fusionslam.sim.motion.riding import Hills, HillsConfig, Sway
from fusionslam.sim.movers import Body, Crowd
from fusionslam.sim.obstacles import ObstacleConfig, plan_obstacles
from fusionslam.sim.robot import (
    TF_STATIC_TOPIC,
    TF_TOPIC,
    TRUTH_TOPIC,
    WORLD,
    GnssMount,
    RobotConfig,
    base_from,
    base_from_camera,
    static_transforms,
)
from fusionslam.sim.scene import RayCaster, Scene
from fusionslam.sim.traffic import MoversConfig, plan_movers
from fusionslam.sim.world import World

# Most events in flight per thread: events rendered ahead stay in memory.
_AHEAD = 8


class SimulationConfig(Section):
    """Settings of a simulated recording; the same configuration gives the same values."""

    seed: int = option(0, "decides noise, drop-outs, odometry and what moves", ge=0)
    start_s: int = option(1000, "time of the first message", unit="s", ge=0, lt=2**32 - 2**20)
    seconds: float | None = option(None, "duration; none: the whole drive", unit="s", gt=0)
    obstacles: ObstacleConfig = option(ObstacleConfig(), "moving boxes")
    movers: MoversConfig = option(MoversConfig(), "people who walk and cars that drive")
    origin: MapOrigin = option(
        MapOrigin(latitude=49.0, longitude=8.4), "where on the globe the world is, for GNSS"
    )
    hills: HillsConfig = option(HillsConfig(), "hills on which the world stands")


Select = Callable[[Iterable["Task"]], Iterable["Task"]]


@dataclass(frozen=True)
class Task:
    """A message that has yet to be rendered.

    Attributes:
        stamp_ns: its time stamp.
        rank: order among messages with the same time stamp.
        topic: topic it is published on.
        make: renders the message.
    """

    stamp_ns: int
    rank: int
    topic: str
    make: Callable[[], Message]

    def event(self) -> Event:
        """Render the message."""
        return Event(self.topic, self.stamp_ns, self.make())


def simulate(
    world: World,
    robot: RobotConfig,
    trajectory: Trajectory,
    config: SimulationConfig | None = None,
    *,
    jobs: int = 1,
    select: Select = iter,
) -> Iterator[Event]:
    """Drive a robot through a world and yield the messages it publishes, in time order.

    Topics are those of the robot's description, plus ``/tf_static`` (first, once), ``/tf`` and
    ``/ground_truth``: the true poses of the base frame in the frame "world", in which odometry
    also starts. Arrival times equal the time stamps; a scan is stamped with its first shot.

    Args:
        world: shapes that cameras see and rays hit.
        robot: frames, sensors, odometry.
        trajectory: of the robot's base; its first time becomes ``config.start_s``.
        config: seed, length, what moves.
        jobs: threads that render ahead. The values do not depend on it.
        select: given all messages in order, returns those to render.

    Raises:
        DataError: the trajectory meets an obstacle, or there is no room for what moves.
    """
    chosen = config or SimulationConfig()
    grid = map_of(world, robot)
    check_trajectory(trajectory, grid, robot.radius_m)
    simulation = _Simulation(world, robot, trajectory, chosen, grid)
    return _render_events(select(simulation.tasks()), jobs)


def map_of(world: World, robot: RobotConfig) -> OccupancyMap:
    """The world's own map, or one of all collision and visual shapes up to the robot's height.

    Raises:
        DataError: the world has no triangles.
    """
    return world.map or occupancy_of(world.collision, world.visual, high_m=robot.height_m)


def event_count(robot: RobotConfig, trajectory: Trajectory, config: SimulationConfig) -> int:
    """Number of events that ``simulate`` yields."""
    seconds = recorded_seconds(trajectory, config)
    rates = [lidar.rate_hz for lidar in robot.lidars.values()]
    rates += [camera.rate_hz for camera in robot.cameras.values()] * 2
    rates += [robot.odometry.rate_hz] * 3
    rates += [imu.rate_hz for imu in robot.imus.values()]
    rates += [receiver.rate_hz for receiver in robot.gnss.values()]
    return 1 + sum(_ticks(rate, seconds) for rate in rates)


def scan_count(lidar: LidarMount, trajectory: Trajectory, config: SimulationConfig) -> int:
    """Number of scans of a LiDAR that ``simulate`` yields."""
    return _ticks(lidar.rate_hz, recorded_seconds(trajectory, config))


def recorded_seconds(trajectory: Trajectory, config: SimulationConfig) -> float:
    """Seconds of a drive that are recorded."""
    whole = trajectory.duration_s
    return whole if config.seconds is None else min(config.seconds, whole)


def _ticks(rate_hz: float, seconds: float) -> int:
    """Number of ticks k / rate_hz before the end."""
    return math.ceil(round(rate_hz * seconds, 6))


class _Simulation:
    """State that stays fixed during a drive, and the functions that render each message."""

    def __init__(
        self,
        world: World,
        robot: RobotConfig,
        trajectory: Trajectory,
        config: SimulationConfig,
        grid: OccupancyMap,
    ) -> None:
        self.robot, self.trajectory, self.config = robot, trajectory, config
        self.start_ns = config.start_s * NANOSECONDS
        self.seconds = recorded_seconds(trajectory, config)
        self.hills = Hills(config.hills, config.seed)
        self.sway = Sway(robot.sway, config.seed)
        self.scenes = _scenes(world, robot, self.hills)
        self.casters = _casters(self.scenes)
        rate_hz = robot.odometry.rate_hz
        self.truth = self._true_track(simulate_odometry(trajectory, OdometryConfig(), rate_hz))
        self.odometry = simulate_odometry(trajectory, odometry_errors(robot, config), rate_hz)
        self.imus = [
            simulate_imu(
                partial(self._mounted, base_from(robot, imu.frame_id)),
                imu,
                # A drive that begins at speed is no jerk.
                self._drive_times(imu.rate_hz).clip(
                    *trajectory.seconds[[0, -1]] + [STEP_S, -STEP_S]
                ),
                np.random.default_rng([config.seed, 5, number]),
            )
            for number, imu in enumerate(robot.imus.values())
        ]
        self.gnss = [
            self._follow_satellites(receiver, np.random.default_rng([config.seed, 8, number]))
            for number, receiver in enumerate(robot.gnss.values())
        ]
        boxes = plan_obstacles(
            config.obstacles, grid, trajectory, robot.radius_m, config.seed, self.seconds
        )
        traffic = plan_movers(
            config.movers, world, grid, trajectory, robot.radius_m, config.seed, self.seconds, boxes
        )
        self.movers = (*boxes, *traffic)
        light = world.visual.light
        self.bodies = [Body(mover.mesh, mover.textures, light) for mover in self.movers]

    def tasks(self) -> Iterator[Task]:
        """All messages to render, in time order."""
        first = static_transforms(self.robot)
        fixed = FrameTransforms(
            transforms=tuple(replace(link, stamp_ns=self.start_ns) for link in first)
        )
        yield Task(self.start_ns, 0, TF_STATIC_TOPIC, lambda: fixed)
        streams = [self._every(*stream, rank) for rank, stream in enumerate(self._streams())]
        yield from heapq.merge(*streams, key=lambda task: (task.stamp_ns, task.rank))

    def _streams(self) -> Iterator[tuple[float, str, Callable[[int, int], Message]]]:
        """Rate, topic and render function (of number and stamp) of each published stream."""
        odometry, cameras = self.robot.odometry, list(self.robot.cameras.values())
        yield odometry.rate_hz, TF_TOPIC, self._make_transform
        told = partial(self._make_odometry, self.odometry, odometry.frame_id)
        yield odometry.rate_hz, odometry.topic, told
        yield odometry.rate_hz, TRUTH_TOPIC, partial(self._make_odometry, self.truth, WORLD)
        for camera in cameras:
            yield camera.rate_hz, camera.info_topic, partial(self._make_camera_info, camera)
        for number, camera in enumerate(cameras):
            yield (
                camera.rate_hz,
                camera.picture_topic(),
                partial(self._make_picture, camera, number),
            )
        for number, lidar in enumerate(self.robot.lidars.values()):
            yield lidar.rate_hz, lidar.topic, partial(self._make_scan, lidar, number)
        for imu, track in zip(self.robot.imus.values(), self.imus, strict=True):
            yield imu.rate_hz, imu.topic, partial(_make_imu, imu.frame_id, track)
        for receiver, found in zip(self.robot.gnss.values(), self.gnss, strict=True):
            yield receiver.rate_hz, receiver.topic, partial(_make_fix, receiver.frame_id, found)

    def _every(
        self, rate_hz: float, topic: str, make: Callable[[int, int], Message], rank: int
    ) -> Iterator[Task]:
        for number in range(_ticks(rate_hz, self.seconds)):
            stamp = self.start_ns + round(number * NANOSECONDS / rate_hz)
            yield Task(stamp, rank, topic, partial(make, number, stamp))

    def _drive_seconds(self, stamp_ns: int) -> float:
        return float(self.trajectory.seconds[0]) + (stamp_ns - self.start_ns) / NANOSECONDS

    def _drive_times(self, rate_hz: float) -> Floats:
        """Seconds of the drive at which a sensor of this rate measures."""
        ticks = np.arange(_ticks(rate_hz, self.seconds)) / rate_hz
        return np.asarray(self.trajectory.seconds[0] + ticks)

    def _follow_satellites(self, receiver: GnssMount, rng: np.random.Generator) -> GnssTrack:
        seconds = self._drive_times(receiver.rate_hz)
        antenna = self._mounted(base_from(self.robot, receiver.frame_id), seconds)[:, :3, 3]
        return simulate_gnss(antenna, receiver, seconds, self.config.origin, rng)

    def _mounted(self, mount: Floats, seconds: Floats) -> Floats:
        """world_from_sensor, (M, 4, 4), of a sensor that is fixed to the robot."""
        return self._poses(seconds) @ mount

    def _poses(self, seconds: Floats) -> Floats:
        """world_from_base, (M, 4, 4); before and after its drive the robot stands still."""
        first, last = self.trajectory.seconds[[0, -1]]
        planned = self.trajectory.at(np.clip(seconds, first, last))
        return self.hills.stand(planned) @ self.sway.at(seconds - first)

    def _true_track(self, planned: OdometryTrack) -> OdometryTrack:
        """The planned motion as it is in space."""
        if self.hills.is_flat and self.sway.is_still:
            return planned
        seconds = planned.stamps_ns / NANOSECONDS
        poses = self._poses(seconds)
        steps_s = np.diff(seconds)[:, None]
        rates = log(inverse(poses[:-1]) @ poses[1:]) / steps_s
        rates = np.concatenate([rates[:1], rates])
        return planned._replace(poses=poses, linear=rates[:, :3], angular=rates[:, 3:])

    def _rng(self, kind: int, sensor: int, number: int) -> np.random.Generator:
        return np.random.default_rng([self.config.seed, kind, sensor, number])

    def _around(self, shapes: str, seconds: Floats) -> Crowd:
        poses = [self.hills.stand(mover.poses(seconds)) for mover in self.movers]
        return Crowd(self.casters[shapes], self.scenes[shapes], self.bodies, poses)

    def _make_scan(self, lidar: LidarMount, sensor: int, number: int, stamp_ns: int) -> Scan:
        seconds = self._drive_seconds(stamp_ns)
        moving = column_seconds(lidar) if lidar.scan_motion else np.zeros(1)
        poses = self._poses(seconds + moving) @ base_from(self.robot, lidar.frame_id)
        around = self._around(lidar.shapes, seconds + moving)
        sweep = scan(
            around,
            lidar,
            poses if lidar.scan_motion else poses[0],
            self._rng(1, sensor, number),
        )
        return Scan(
            stamp_ns=stamp_ns,
            frame_id=lidar.frame_id,
            points=sweep.points,
            fields=point_fields(
                lidar, sweep, around.objects(sweep.hits), around.moving(sweep.hits), stamp_ns
            ),
        )

    def _make_picture(
        self, camera: CameraMount, sensor: int, number: int, stamp_ns: int
    ) -> Picture:
        seconds = self._drive_seconds(stamp_ns)
        now = np.array([seconds])
        pose = self._poses(now)[0] @ base_from_camera(self.robot, camera)
        # Both cameras of a pair share the exposure.
        gain = gains(camera, seconds, np.random.default_rng([self.config.seed, 3]))
        image = photograph(
            self._around("visual", now), camera, pose, gain, self._rng(2, sensor, number)
        )
        return Picture(stamp_ns=stamp_ns, frame_id=camera.frame_id, image=image)

    def _make_camera_info(self, camera: CameraMount, number: int, stamp_ns: int) -> Message:
        return camera_info(camera, stamp_ns)

    def _make_odometry(
        self, track: OdometryTrack, frame_id: str, number: int, stamp_ns: int
    ) -> Odometry:
        return Odometry(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            child_frame_id=self.robot.base_frame,
            pose=track.poses[number],
            linear=track.linear[number],
            angular=track.angular[number],
        )

    def _make_transform(self, number: int, stamp_ns: int) -> FrameTransforms:
        link = FrameTransform(
            stamp_ns=stamp_ns,
            parent=self.robot.odometry.frame_id,
            child=self.robot.base_frame,
            parent_from_child=self.odometry.poses[number],
        )
        return FrameTransforms(transforms=(link,))


def _make_imu(frame_id: str, track: ImuTrack, number: int, stamp_ns: int) -> Imu:
    return Imu(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        angular=track.angular[number],
        linear=track.linear[number],
    )


def _make_fix(frame_id: str, track: GnssTrack, number: int, stamp_ns: int) -> Fix:
    if not track.known[number]:
        return Fix(stamp_ns=stamp_ns, frame_id=frame_id, position=None)
    return Fix(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        position=track.positions[number],
        covariance=track.covariance,
    )


def odometry_errors(robot: RobotConfig, config: SimulationConfig) -> OdometryConfig:
    """The robot's odometry errors, seeded like the recording unless they set their own seed."""
    errors = robot.odometry.errors
    return errors if "seed" in errors.model_fields_set else merged(errors, {"seed": config.seed})


def _scenes(world: World, robot: RobotConfig, hills: Hills) -> dict[str, Scene]:
    """The shapes that the robot's sensors use, on the hills."""
    names = [lidar.shapes for lidar in robot.lidars.values()]
    names += ["visual"] if robot.cameras else []
    scenes = {name: world.visual if name == "visual" else world.collision for name in names}
    raised = {id(scene): hills.raise_scene(scene) for scene in scenes.values()}
    return {name: raised[id(scene)] for name, scene in scenes.items()}


def _casters(scenes: Mapping[str, Scene]) -> dict[str, RayCaster]:
    # If two are the same scene, its tree is built once.
    made = {id(scene): RayCaster(scene) for scene in scenes.values()}
    return {shapes: made[id(scene)] for shapes, scene in scenes.items()}


def _render_events(tasks: Iterable[Task], jobs: int) -> Iterator[Event]:
    """Render events in the order of their tasks; threads work ahead by a limited number."""
    if jobs <= 1:
        yield from (task.event() for task in tasks)
        return
    with ordered_results(Task.event, tasks, jobs, ahead=_AHEAD * jobs) as events:
        yield from events
