# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fused scans of another simulator's recording beside the depth that our renderer sees there.

python -m benchmarks.accuracy.bag_depth      # needs the folder named by FUSIONSLAM_TEST_DATA
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import fusionslam
from benchmarks.accuracy.data import data_folder
from fusionslam.datasets import open_dataset
from fusionslam.sensors.frame import Frame
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.worlds import load_world

FULL_CIRCLE, SECTOR = "/velodyne_points_360", "/velodyne_points"
NEAR_M = 0.03


class Agreement(NamedTuple):
    """Frames, points that fall into an image, and the share of these at the rendered depth."""

    frames: int
    points: int
    share: float


def depth_agreement(data: Path, topic: str) -> Agreement:
    """The scans of a topic, placed by the bag's own transforms in the house that was recorded."""
    caster = RayCaster(load_world(data / "worlds" / "small_house.glb").visual)
    dataset = open_dataset(data / "bags" / "small_house_20s.bag", topics={"points": topic})
    misses = np.concatenate([depth_misses(frame, caster) for frame in dataset])
    return Agreement(len(dataset), len(misses), float(np.mean(misses < NEAR_M)))


def depth_misses(frame: Frame, caster: RayCaster) -> NDArray[np.float32]:
    """By how much each fused point misses the surface that the camera sees there, metres, (M,).

    The odometry of this recording is the true place in the world.
    """
    camera = frame.cameras["left"]
    assert frame.odometry is not None and frame.points is not None
    assert frame.robot_from_points is not None
    points, _, _ = fusionslam.colorize(
        frame.points, frame.images["left"], camera.projection_from_points
    )
    place = camera.rectified_from_points
    seen = points @ place[:3, :3].T + place[:3, 3]
    world = frame.odometry @ frame.robot_from_points @ np.linalg.inv(place)
    rays = (seen / seen[:, 2:]) @ world[:3, :3].T
    hits = caster.cast(world[:3, 3].astype(np.float32), rays.astype(np.float32))
    # A ray whose z is 1 in the camera's frame is as long as its hit is deep.
    return np.abs(hits.distance - seen[:, 2].astype(np.float32))


def main() -> None:
    """Print the share for both scanners of the bag."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for topic in (FULL_CIRCLE, SECTOR):
        frames, points, share = depth_agreement(data_folder(), topic)
        print(f"{topic}: {points:,} points of {frames} scans, {share:.1%} within {NEAR_M} m")


if __name__ == "__main__":
    main()
