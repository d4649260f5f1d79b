# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drives through made worlds, and recorded ones, as frames with known poses."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.accuracy.data import data_folder
from fusionslam.base.arrays import Floats
from fusionslam.config import merged
from fusionslam.datasets.range_recording import RangeRecording
from fusionslam.fusion import ROBOT_FUSION, fuse
from fusionslam.geometry.odometry_noise import (
    OdometryConfig,
    add_odometry_errors,
    simulate_odometry,
)
from fusionslam.geometry.trajectory import Trajectory, ground_poses
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Scan
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.robot import RobotConfig, base_from, robot_named
from fusionslam.sim.simulator import SimulationConfig, simulate
from fusionslam.sim.world import World

CIRCLE_ROBOT = "turtlebot3_vlp16"
LENGTH_M = {"house": None, "warehouse": None, "hospital": 350.0, "town": None}
"""Of the ways; None is what the whole tour takes."""


@dataclass(frozen=True)
class RoomDrive:
    """A drive through a made world, scanned at a rate by a LiDAR that stands still meanwhile.

    Attributes:
        world: name.
        seed: of the world, its furniture, the way, and the noise.
        robot_name: as ``robot_named`` takes it.
        rate_hz: of the scans.
        noise: seed of the noise of scans and odometry; None for ``seed``.
        back: the same way in the opposite direction.
    """

    world: str
    seed: int
    robot_name: str = CIRCLE_ROBOT
    rate_hz: float = 1.0
    noise: int | None = None
    back: bool = False

    @cached_property
    def _robot(self) -> RobotConfig:
        still = {"rate_hz": self.rate_hz, "scan_motion": False}
        return merged(robot_named(self.robot_name), {"lidars": {"velodyne": still}})

    @cached_property
    def _driven(self) -> tuple[World, Trajectory]:
        made = MADE[self.world]
        world = made.make(merged(made.settings, {"seed": self.seed}))
        plan = PlanConfig(
            seed=self.seed, spacing_m=8.0, again=0.2, back=0.2, length_m=LENGTH_M[self.world]
        )
        world, way = drive_through(world, self._robot, plan)
        return world, turn_back(way) if self.back else way

    @property
    def _noise(self) -> int:
        return self.seed if self.noise is None else self.noise

    @cached_property
    def true(self) -> Floats:
        """float64 (n, 4, 4), world_from_robot of the frames."""
        return simulate_odometry(self._driven[1], OdometryConfig(), self.rate_hz).poses

    def odometry(self, errors: OdometryConfig) -> Floats:
        """float64 (n, 4, 4), odom_from_robot of the frames."""
        errors = merged(errors, {"seed": self._noise})
        return simulate_odometry(self._driven[1], errors, self.rate_hz).poses

    @property
    def metres(self) -> float:
        """Length of the way."""
        return self._driven[1].length_m

    def frames(self) -> Iterator[Frame]:
        """Simulate the scans."""
        world, way = self._driven
        lidar = self._robot.lidars["velodyne"]
        mounted = base_from(self._robot, lidar.frame_id)
        events = simulate(
            world,
            self._robot,
            way,
            SimulationConfig(seed=self._noise),
            select=lambda tasks: (task for task in tasks if task.topic == lidar.topic),
        )
        for number, event in enumerate(events):
            assert isinstance(event.message, Scan)
            points = np.ascontiguousarray(event.message.points, np.float32)
            stamp = event.message.stamp_ns
            yield Frame(number=number, stamp_ns=stamp, points=points, robot_from_points=mounted)


def turn_back(way: Trajectory) -> Trajectory:
    """The same way in the opposite direction, at the same speeds, looking ahead."""
    seconds = way.seconds[0] + way.seconds[-1] - way.seconds[::-1]
    return Trajectory(seconds, way.x[::-1].copy(), way.y[::-1].copy(), way.yaw[::-1] + np.pi)


@dataclass(frozen=True)
class RecordedDrive:
    """A recording of the test data: coloured clouds of a sector, in the robot's frame."""

    name: str

    @cached_property
    def recording(self) -> RangeRecording:
        return RangeRecording.open(data_folder() / "recordings" / f"{self.name}.npz")

    @property
    def true(self) -> Floats:
        """float64 (n, 4, 4), world_from_robot of the frames."""
        assert self.recording.poses is not None
        return self.recording.poses

    def odometry(self, errors: OdometryConfig) -> Floats:
        """float64 (n, 4, 4), odom_from_robot of the frames."""
        assert self.recording.places is not None
        places = add_odometry_errors(self.recording.places, self.recording.seconds, errors)
        return ground_poses(*places.T)

    @property
    def metres(self) -> float:
        """Length of the way."""
        steps = np.diff(self.true[:, :3, 3], axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())

    def frames(self) -> Iterator[Frame]:
        """Read the scans; those without a point above the floor are left out."""
        fusion = merged(ROBOT_FUSION, {"source": "cloud"})
        yield from (frame for frame in self.recording if len(fuse(frame, fusion)))
