# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Does our LiDAR measure what another simulator recorded in the same worlds? A Markdown table.

    python -m benchmarks.accuracy.recordings [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names.
"""

import argparse
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.data import ROOT, WORLDS, data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sim.lidar import LidarMount, lidar_rays, scan
from fusionslam.sim.robot import base_from, robot_named
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.worlds import load_world

PAGE = ROOT / "docs" / "guides" / "simulation.md"
HEADER = ["world", "shapes", "ranges", "within 24 mm", "within 40 mm", "deviation", "mean"]
ROBOT = robot_named("turtlebot3_waffle_pi")
SHAPES: tuple[Literal["collision", "visual"], ...] = ("collision", "visual")
NEAR_M = 0.04  # five deviations of their noise: beyond, a ray met something else
Floats = NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    text = recordings_table(data_folder())
    print(text)
    if arguments.write:
        write_between(PAGE, "recordings", text)


def recordings_table(data: Path) -> str:
    rows = [
        [name, shapes, *spread(range_errors(data, name, shapes))]
        for name in WORLDS
        for shapes in SHAPES
    ]
    apart = max(rays_apart(data, name) for name in WORLDS)
    return f"{table(HEADER, rows)}\n\nUnit vectors of their rays and ours are {apart:.0e} apart."


def spread(errors: Floats) -> list[str]:
    """Cells of the table; deviation and mean are of the errors below NEAR_M."""
    near = 1e3 * errors[np.abs(errors) < NEAR_M]
    shares = [f"{np.mean(np.abs(errors) < limit):.2%}" for limit in (0.024, NEAR_M)]
    return [f"{len(errors):,}", *shares, f"{near.std():.2f} mm", f"{near.mean():.3f} mm"]


def lidar() -> LidarMount:
    """The sector of the robot that recorded, without noise."""
    return ROBOT.lidars["velodyne"].model_copy(update={"noise_m": 0.0})


def lowest_first(values: NDArray[Any]) -> NDArray[Any]:
    """Values of our rays, (2160, ...), in their order: we begin with the highest ring."""
    rings: NDArray[Any] = values.reshape(18, 120, *values.shape[1:])[::-1]
    return rings.reshape(values.shape)


def rays_apart(data: Path, name: str) -> float:
    """Largest difference of a coordinate between their unit vectors and ours."""
    with np.load(data / "recordings" / f"{name}.npz") as recorded:
        theirs = recorded["rays"]
    return float(np.abs(lowest_first(lidar_rays(lidar())) - theirs).max())


def range_errors(
    data: Path, name: str, shapes: Literal["collision", "visual"], every: int = 1
) -> Floats:
    """By how much our ranges are longer than theirs, which have noise of 8 mm, metres, (M,).

    Only what their camera saw is recorded. ``every``: of how many scans one is compared.
    """
    world = load_world(data / "worlds" / f"{name}.glb")
    caster = RayCaster(world.collision if shapes == "collision" else world.visual)
    with np.load(data / "recordings" / f"{name}.npz") as recorded:
        poses, offsets = recorded["poses"], recorded[f"{shapes}_offsets"]
        rays, ranges = recorded[f"{shapes}_ray"], recorded[f"{shapes}_range_mm"] / 1000
    places = ground_poses(*poses.T) @ base_from(ROBOT, lidar().frame_id)
    parts = [(place, slice(*offsets[k : k + 2])) for k, place in enumerate(places)][::every]
    return np.concatenate([ours(caster, place)[rays[part]] - ranges[part] for place, part in parts])


def ours(caster: RayCaster, place: Floats) -> Floats:
    """Our range along each of their rays, metres, (2160,); infinite where nothing is met."""
    sweep = scan(caster, lidar(), place, np.random.default_rng(0))
    found = np.full(18 * 120, np.inf)
    found[sweep.ray] = np.linalg.norm(sweep.points, axis=1)
    return lowest_first(found)


if __name__ == "__main__":
    main()
