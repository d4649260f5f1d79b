# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tiny networks, shapes and places for tests of the learned second stage."""

from pathlib import Path
from typing import Any

import numpy as np

from artefacts import artefact
from fusionslam.base.arrays import Floats
from fusionslam.learning.places import Places, Sights
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import CloudArray
from fusionslam.views.second_stage.architecture import ComparisonConfig, PointNetConfig

TINY = PointNetConfig(
    transform_points=(8, 16), transform_head=(8,), points=(8, 16, 32), embedding=None
)
TINY_COLORED = TINY.model_copy(
    update={"embedding": 12, "colors": True, "normalisation": "robot", "range_m": 4.0}
)
TINY_COMPARISON = ComparisonConfig(features=32, hidden=8)


def cloud(size: int, seed: int, at: tuple[float, float] = (2.0, 0.0)) -> Cloud:
    """A coloured lump of points before the robot."""
    rng = np.random.default_rng(seed)
    points = rng.normal((*at, 0.6), (1.0, 1.0, 0.4), (size, 3)).astype(np.float32)
    return Cloud(points, rng.integers(0, 256, (size, 3), np.uint8))


def world(name: str, seed: int, places: int = 6, sights: int = 4, size: int = 60) -> Sights:
    """Places three metres apart, each a lump of its own seen some times with a little noise."""
    rng = np.random.default_rng(seed)
    clouds, poses = [], []
    for number in range(places):
        lump = cloud(size, 1000 * seed + number, (2 + rng.random(), rng.normal()))
        assert lump.colors is not None
        for _ in range(sights):
            noise = rng.normal(0, 0.02, lump.points.shape).astype(np.float32)
            clouds.append(Cloud(lump.points + noise, lump.colors))
            x, y, yaw = rng.uniform(-0.1, 0.1, 3)
            poses.append((3.0 * number + x, y, yaw))
    return name, clouds, np.asarray(poses)


def worlds(count: int, seed: int = 0) -> Places:
    """Several of them."""
    return Places.of([world(f"w{n}", seed + n) for n in range(count)])


def line(*poses: tuple[float, float, float]) -> tuple[list[Cloud], Floats]:
    """One-point clouds at these poses."""
    clouds = [cloud(1, n) for n in range(len(poses))]
    return clouds, np.asarray(poses, np.float64)


def simulated_places(seed: int, **values: Any) -> Sights:
    """Places of a simulated world, seen some times; simulated once on a machine."""
    from fusionslam.learning.simulated_places import SimulatedPlacesConfig, simulate_places

    def make(folder: Path) -> None:
        config = SimulatedPlacesConfig(seed=seed, worlds=1, **values)
        name, clouds, poses = next(simulate_places(config))
        stored = CloudArray.of(clouds)
        arrays: dict[str, Any] = {"name": name, "poses": poses, **vars(stored)}
        np.savez(folder / "places.npz", **arrays)

    with np.load(artefact(f"places_{seed}", make) / "places.npz") as file:
        kept = CloudArray(file["points"], file["colors"], file["offsets"])
        return str(file["name"]), [kept[i] for i in range(len(kept))], file["poses"]
