# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How alike are places of the made worlds, and how large are these? Two Markdown tables.

    python -m benchmarks.accuracy.indoor [--write]

All of it at the defaults. Times are processor time.
"""

import argparse
import itertools
import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.sim.indoor import (
    INDOOR_WORLDS,
    HospitalConfig,
    WarehouseConfig,
    indoor_places,
    make_indoor,
)
from fusionslam.sim.indoor.textures import indoor_textures
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.world import World

PAGE = ROOT / "docs" / "guides" / "indoor_worlds.md"
AZIMUTHS = 180
WORLDS = ["world", "size", "visual triangles", "collision triangles", "objects", "within 5 cm"]
WORLDS += ["processor time", "textures at hand"]
Floats = NDArray[np.float32]
Place = tuple[float, float]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the tables into the docs")
    arguments = parser.parse_args()
    texts = {"alike": alike_table(), "worlds": table(WORLDS, [row(name) for name in INDOOR_WORLDS])}
    print("\n\n".join(texts.values()))
    if arguments.write:
        for name, text in texts.items():
            write_between(PAGE, name, text)


def alike_table() -> str:
    """Shares of rays that tell places of the hospital and of the warehouse apart."""
    hospital, warehouse = HospitalConfig(), WarehouseConfig()
    among, apart = wards_unlike(make_indoor(hospital), hospital)
    south, yard = aisles_unlike(make_indoor(warehouse), warehouse)
    corridors = [corridors_unlike(make_indoor(hospital), hospital)]
    pairs = {
        "two wards": among,
        "a ward and any other room": apart,
        "southern and northern corridor, one turned by half a turn": corridors,
        "southern halves of two inner aisles of the warehouse": south,
        "such an aisle, either half, and the yard": yard,
    }
    rows = [
        [pair, *(f"{100 * of(shares):.0f} %" for of in (min, np.median, max))]
        for pair, shares in pairs.items()
    ]
    return table(["pair", "least", "median", "most"], rows)


def wards_unlike(world: World, config: HospitalConfig) -> tuple[list[float], list[float]]:
    """Of all pairs of wards, those in the north turned round; of each ward and other place."""
    caster, places = RayCaster(world.collision), indoor_places(config)
    wards = [ranges(caster, places[name], yaw) for name, yaw in ward_yaws(config).items()]
    others = [
        ranges(caster, place) for name, place in places.items() if not name.startswith("ward")
    ]
    among = [unlike(a, b) for a, b in itertools.combinations(wards, 2)]
    return among, [unlike(a, b) for a in wards for b in others]


def ward_yaws(config: HospitalConfig) -> dict[str, float]:
    """Names of all wards, and where to look so that they are alike, radians."""
    names = [name for name in indoor_places(config) if name.startswith("ward")]
    return {name: np.pi if "north" in name else 0.0 for name in names}


def corridors_unlike(world: World, config: HospitalConfig) -> float:
    caster, places = RayCaster(world.collision), indoor_places(config)
    south = ranges(caster, places["corridor_south"])
    return unlike(south, ranges(caster, places["corridor_north"], np.pi))


def aisles_unlike(world: World, config: WarehouseConfig) -> tuple[list[float], list[float]]:
    """Of pairs of inner aisles, southern halves; of all inner halves and the yard."""
    caster, places = RayCaster(world.collision), indoor_places(config)
    inner = range(2, config.rows + 1)
    south = [ranges(caster, places[f"aisle_{k}_south"]) for k in inner]
    north = [ranges(caster, places[f"aisle_{k}_north"]) for k in inner]
    yard = ranges(caster, places["yard"])
    among = [unlike(a, b) for a, b in itertools.combinations(south, 2)]
    return among, [unlike(scan, yard) for scan in south + north]


def directions(yaw: float = 0.0) -> Floats:
    """Five rings all round, (5 * AZIMUTHS, 3), turned by yaw."""
    around = yaw + np.arange(AZIMUTHS) * 2 * np.pi / AZIMUTHS
    rings = np.tan(np.radians(np.linspace(-12, 12, 5)))
    rays = [(np.cos(a), np.sin(a), slope) for slope in rings for a in around]
    return np.array(rays, np.float32)


def ranges(caster: RayCaster, place: Place, yaw: float = 0.0) -> Floats:
    """Distances, metres, from 0.17 m above the floor."""
    rays = directions(yaw)
    hits = caster.cast(np.array((*place, 0.17), np.float32), rays)
    metres: Floats = hits.distance * np.linalg.norm(rays, axis=1)
    return metres


def unlike(first: Floats, second: Floats) -> float:
    """Share of rays whose ranges differ by more than 0.2 m."""
    return float(np.mean(np.abs(first - second) > 0.2))


def row(name: str) -> list[object]:
    """A world's size, how well its two scenes agree, and what it takes to make it."""
    indoor_textures.cache_clear()
    world, cold = time_world(name)
    _, warm = time_world(name)
    corners = world.visual.mesh.triangles.reshape(-1, 3)
    size = " x ".join(f"{metres:.1f}" for metres in np.ptp(corners, axis=0))
    triangles = [f"{len(scene.mesh):,}" for scene in (world.visual, world.collision)]
    close = f"{100 * collision_follows(world):.0f} %"
    times = [f"{seconds:.1f} s" for seconds in (cold, warm)]
    return [name, f"{size} m", *triangles, len(world.visual.names), close, *times]


def time_world(name: str) -> tuple[World, float]:
    """A world and the processor time it took, seconds."""
    start = time.process_time()
    world = make_indoor(INDOOR_WORLDS[name].config())
    return world, time.process_time() - start


def collision_follows(world: World) -> float:
    """Share of a LiDAR's rays, from 0.17 m at 40 places, whose two ranges differ by < 5 cm."""
    rays = fan(np.radians(np.linspace(-15, 15, 16)), 360)
    casters = [RayCaster(scene) for scene in (world.visual, world.collision)]
    differences = []
    for x, y in drivable(world, 40):
        origin = np.array((x, y, 0.17), np.float32)
        seen, simple = (caster.cast(origin, rays).distance for caster in casters)
        differences.append(np.abs(seen - simple))
    return float(np.mean(np.concatenate(differences) < 0.05))


def drivable(world: World, count: int, seed: int = 0) -> NDArray[np.float64]:
    """x, y of reachable cells a robot's radius away from everything, (count, 2)."""
    assert world.map is not None
    room = world.map.inflate(0.25)
    cells = np.argwhere(room.reachable)
    chosen = cells[np.random.default_rng(seed).integers(len(cells), size=count)]
    return np.column_stack(room.centres(chosen[:, 0], chosen[:, 1]))


def fan(rings: NDArray[np.float64], azimuths: int) -> Floats:
    """Unit vectors of a full circle at the given elevations, radians."""
    up, around = np.meshgrid(rings, np.arange(azimuths) * 2 * np.pi / azimuths, indexing="ij")
    rays = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
    return rays.reshape(-1, 3).astype(np.float32)


if __name__ == "__main__":
    main()
