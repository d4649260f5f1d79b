# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How much of the ground do the three ways to remove it find? A Markdown table.

    python -m benchmarks.accuracy.ground [--write]

Simulated scans know what each point lies on. Precision is the share of ground among the points
removed, recall the share of the ground that was removed, over all points of twenty scans a world;
processor times are medians of scans. Worlds of the test data are left out where
FUSIONSLAM_TEST_DATA does not name them.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from timeit import timeit

import numpy as np
from numpy.typing import NDArray

import fusionslam
from benchmarks.accuracy.data import ROOT, world_files
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.fusion import FusionConfig, plane_of, segments_of
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.frame import CloudFrame
from fusionslam.sim import SimConfig
from fusionslam.sim.indoor import INDOOR_WORLDS, indoor_places
from fusionslam.sim.lidar import LidarConfig, scan
from fusionslam.sim.robot import base_from, robot_named
from fusionslam.sim.scene import RayCaster, Scene
from fusionslam.sim.town.layout import make_town
from fusionslam.sim.town.route import make_drive
from fusionslam.sim.world import World
from fusionslam.sim.worlds import load_world

PAGE = ROOT / "docs" / "stages" / "fusion.md"
SCANS = 20
RUNS = 10
ROBOTS = ("turtlebot3_waffle_pi", "turtlebot3_vlp16")
Poses = NDArray[np.float64]
Removal = Callable[[NDArray[np.float32]], NDArray[np.int64]]


@dataclass(frozen=True)
class Case:
    """A LiDAR in a world.

    Attributes:
        low: what ``height`` takes for ground, metres above it.
        frame: whose values plane and segments have: the scan's are a car's.
    """

    world: str
    sensor: str
    scene: Scene
    lidar: LidarConfig
    base_from_lidar: Poses
    poses: Poses
    low: float
    frame: CloudFrame


@dataclass
class Score:
    """Counts over several scans."""

    right: int = 0
    removed: int = 0
    ground: int = 0

    def add(self, kept: NDArray[np.int64], is_ground: NDArray[np.bool_]) -> None:
        gone = np.ones(len(is_ground), bool)
        gone[kept] = False
        self.right += int((gone & is_ground).sum())
        self.removed += int(gone.sum())
        self.ground += int(is_ground.sum())

    @property
    def precision(self) -> float:
        return self.right / max(self.removed, 1)

    @property
    def recall(self) -> float:
        return self.right / max(self.ground, 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    header = ["world", "sensor", "points", "ground", *removals("robot", 0.1)]
    found = list(cases())
    text = f"{table(header, [judge_case(case) for case in found])}\n\n{with_values_of_a_car(found)}"
    print(text)
    if arguments.write:
        write_between(PAGE, "ground", text)


def removals(frame: CloudFrame, low: float) -> dict[str, Removal]:
    """The three ways; plane and segments with the values that ``fuse`` has in this frame."""
    config = FusionConfig(frame=frame)
    plane, segments = plane_of(config), segments_of(config)
    return {
        "height": lambda points: fusionslam.above_height(points, low),
        "plane": lambda points: fusionslam.remove_ground_plane(points, config=plane)[0],
        "segments": lambda points: fusionslam.remove_ground_segments(points, config=segments)[0],
    }


def judge_case(case: Case) -> list[object]:
    """A row of the table: precision, recall and time of each way."""
    scores = {name: Score() for name in removals(case.frame, case.low)}
    times: dict[str, list[float]] = {name: [] for name in scores}
    points_in_all = 0
    for points, is_ground in scans(case):
        points_in_all += len(points)
        for name, remove in removals(case.frame, case.low).items():
            scores[name].add(remove(points), is_ground)
            # Reading the clock takes longer than the quickest: several calls share it.
            spent = timeit(partial(remove, points), timer=time.process_time, number=RUNS)
            times[name].append(spent / RUNS)
    ground = scores["height"].ground / points_in_all
    cells = [
        f"{score.precision:.3f} / {score.recall:.3f}, {1e3 * np.median(times[name]):.2f} ms"
        for name, score in scores.items()
    ]
    return [case.world, case.sensor, points_in_all // SCANS, f"{ground:.0%}", *cells]


def with_values_of_a_car(cases: list[Case]) -> str:
    """What the plane finds over all scans of a small robot, with its values and with a car's."""
    frames: tuple[CloudFrame, ...] = ("robot", "scan")
    scores = {frame: Score() for frame in frames}
    for case in cases:
        for points, is_ground in scans(case) if case.sensor == "waffle_pi" else ():
            for frame, score in scores.items():
                score.add(removals(frame, case.low)["plane"](points), is_ground)
    own, car = (f"{score.precision:.2f} / {score.recall:.2f}" for score in scores.values())
    return f"`plane` over all scans of the waffle_pi: {own}; with a car's values {car}."


def scans(case: Case) -> Iterator[tuple[NDArray[np.float32], NDArray[np.bool_]]]:
    """Points in the robot's frame, and which of them lie on ground."""
    caster = RayCaster(case.scene)
    turn, shift = case.base_from_lidar[:3, :3], case.base_from_lidar[:3, 3]
    for number, pose in enumerate(case.poses):
        rng = np.random.default_rng([11, number])
        sweep = scan(caster, case.lidar, pose @ case.base_from_lidar, rng)
        points = (sweep.points @ turn.T + shift).astype(np.float32)
        yield points, case.scene.ground[case.scene.part[sweep.hits.triangle]]


def cases() -> Iterator[Case]:
    """The town with its car, then every indoor world with every robot."""
    yield town()
    for name, entry in INDOOR_WORLDS.items():
        config = entry.config()
        places = np.array(list(indoor_places(config).values()))
        yield from indoor(replace(entry.make(config), name=f"{name} (made)"), at_places(places))
    for name, path in world_files().items():
        world = load_world(path)
        yield from indoor(replace(world, name=f"{name} (data)"), along(world))


def town() -> Case:
    config = SimConfig()
    drive = make_drive(config.drive, config.town.block_m, config.seed)
    lidar = config.car.lidar
    base_from_lidar = np.eye(4)
    base_from_lidar[:3, 3] = lidar.position_m
    chosen = np.linspace(0, len(drive.poses) - 1, SCANS).astype(int)
    scene = make_town(config.town)
    poses = drive.poses[chosen]
    return Case("town", "car", scene, lidar, base_from_lidar, poses, low=0.2, frame="scan")


def indoor(world: World, poses: Poses) -> Iterator[Case]:
    for name in ROBOTS:
        robot = robot_named(name)
        (lidar,) = robot.lidars.values()
        scene = world.collision if lidar.shapes == "collision" else world.visual
        place = base_from(robot, lidar.frame_id)
        sensor = name.removeprefix("turtlebot3_")
        yield Case(world.name, sensor, scene, lidar, place, poses, low=0.1, frame="robot")


def at_places(places: NDArray[np.float64]) -> Poses:
    """Twenty of these places, each looking somewhere else."""
    rng = np.random.default_rng(7)
    chosen = places[rng.choice(len(places), SCANS, replace=len(places) < SCANS)]
    return ground_poses(chosen[:, 0], chosen[:, 1], rng.uniform(-np.pi, np.pi, SCANS))


def along(world: World) -> Poses:
    """Twenty poses along the world's own drive."""
    drive = world.trajectory
    assert drive is not None
    chosen = np.linspace(0, len(drive.x) - 1, SCANS).astype(int)
    return ground_poses(drive.x[chosen], drive.y[chosen], drive.yaw[chosen])


if __name__ == "__main__":
    main()
