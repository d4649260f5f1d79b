# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How many pictures and scans a second the simulator makes on one core.

python -m benchmarks.speed.simulation warehouse house path/to/world.glb
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from fusionslam.sim.camera import photograph
from fusionslam.sim.catalogue import MADE, drive_through, read_world
from fusionslam.sim.lidar import scan
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.movers import Crowd
from fusionslam.sim.robot import base_from, base_from_camera, robot_named
from fusionslam.sim.scene import RayCaster

_PLACES = 12
_TARGETS = (4, 100)


def rates(name: str) -> tuple[float, float]:
    """Pictures of 640x480 and scans of 18x120 a second of processor time along a drive."""
    entry = MADE.get(name)
    world = entry.make(entry.settings) if entry else read_world(name)
    robot = robot_named("turtlebot3_waffle_pi")
    world, drive = drive_through(world, robot, PlanConfig())
    times = np.linspace(drive.seconds[0], drive.seconds[-1], _PLACES)
    camera, lidar = robot.cameras["camera"], robot.lidars["velodyne"]
    seen = Crowd(RayCaster(world.visual), world.visual)
    hit = Crowd(RayCaster(world.collision), world.collision)
    eyes = drive.at(times) @ base_from_camera(robot, camera)
    spots = drive.at(times) @ base_from(robot, lidar.frame_id)
    rng = np.random.default_rng(0)
    pictures = _rate(lambda k: photograph(seen, camera, eyes[k], (1.0, 1.0, 1.0), rng), 1)
    return pictures, _rate(lambda k: scan(hit, lidar, spots[k], rng), 20)


def _rate(make: Callable[[int], object], rounds: int) -> float:
    make(0)
    start = time.process_time()
    for number in range(_PLACES * rounds):
        make(number % _PLACES)
    return _PLACES * rounds / (time.process_time() - start)


def main() -> None:
    """Print the rates of worlds by name or file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("worlds", nargs="*", default=["warehouse", "house", "hospital"])
    names = parser.parse_args().worlds
    print(f"{'world':24} pictures/s  scans/s   (asked for: {_TARGETS[0]} and {_TARGETS[1]})")
    for name in names:
        pictures, scans = rates(name)
        print(f"{name.split('/')[-1]:24} {pictures:10.1f} {scans:8.0f}")


if __name__ == "__main__":
    main()
