# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Is a world the same from glTF and from SDF? A Markdown table of the worlds of the test data.

    python -m benchmarks.accuracy.worlds [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.data import ROOT, WORLDS, data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.sim.scene import Hits, RayCaster, Scene
from fusionslam.sim.world import World
from fusionslam.sim.worlds import load_world

PAGE = ROOT / "docs" / "guides" / "world_files.md"
HEADER = ["world", "shapes", "triangles, glTF", "SDF", "rays", "same range", "of the rays counted"]
HEADER += ["pictures differ by"]
PLACES = 40
Eye = tuple[NDArray[np.float32], float]
Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]


class SameRanges(NamedTuple):
    """Rays whose two ranges differ by at most 1 mm, and which of them count, bool (N,)."""

    same: Bools
    counted: Bools


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    rows = [row for name in WORLDS for row in compare_world(data_folder(), name)]
    text = table(HEADER, rows)
    print(text)
    if arguments.write:
        write_between(PAGE, "files", text)


def compare_world(data: Path, name: str) -> list[list[object]]:
    """A row for the visual and one for the collision shapes of a world."""
    pair = load_world(data / "worlds" / f"{name}.glb"), load_world(data / "worlds_sdf" / name)
    rows: list[list[object]] = []
    for shapes in ("visual", "collision"):
        scenes = [getattr(world, shapes) for world in pair]
        first, second = casters = [RayCaster(scene) for scene in scenes]
        found = same_ranges(first, second, scenes[0], eyes(pair[0], 0.17, PLACES))
        row: list[object] = [name, shapes, *(f"{len(scene.mesh):,}" for scene in scenes)]
        row += [f"{len(found.same):,}", f"{found.same.mean():.2%}"]
        row += [f"{found.same[found.counted].mean():.2%}"]
        seen = shapes == "visual"
        rows.append([*row, f"{differ(casters, pair[0]):.1f} of 255" if seen else ""])
    return rows


def eyes(world: World, height: float, count: int) -> list[Eye]:
    """Spread along the trajectory: position and yaw."""
    drive = world.trajectory
    assert drive is not None
    chosen = np.linspace(0, len(drive) - 1, count).astype(int)
    return [
        (np.array([drive.x[i], drive.y[i], height], np.float32), float(drive.yaw[i]))
        for i in chosen
    ]


def same_ranges(first: RayCaster, second: RayCaster, scene: Scene, eyes: list[Eye]) -> SameRanges:
    """Of 16 full rings from each place; ``scene`` is the first one's, whose ground is cut."""
    rays, parts = rings(), []
    for origin, _ in eyes:
        a, b = first.cast(origin, rays), second.cast(origin, rays)
        met = np.isfinite(a.distance) & np.isfinite(b.distance)
        gap = np.abs(np.where(met, a.distance, 0) - np.where(met, b.distance, 0))
        equal = np.isfinite(a.distance) == np.isfinite(b.distance)
        parts.append((equal & (gap <= 1e-3), ~beyond_the_cut(origin, rays, b, scene)))
    return SameRanges(*np.concatenate(parts, axis=1))


def beyond_the_cut(origin: Floats, rays: Floats, hits: Hits, scene: Scene) -> Bools:
    """Rays that hit the ground outside of all that the scene holds.

    SDF's ground plane of the warehouse is 100 m wide; the glTF files cut it a metre around
    everything else.
    """
    held = scene.mesh.triangles[..., :2].reshape(-1, 2)
    low, high = held.min(axis=0), held.max(axis=0)
    met = np.isfinite(hits.distance)
    at = origin[:2] + rays[:, :2] * np.where(met, hits.distance, 0)[:, None]
    return np.asarray(met & ((at < low) | (at > high)).any(axis=1))


def differ(casters: list[RayCaster], world: World) -> float:
    """Mean difference of the pictures of two casters, of 255."""
    shots = [pictures(casters, eye) for eye in eyes(world, 0.103, PLACES)]
    return float(np.mean([np.abs(a - b).mean() for a, b in shots]))


def pictures(casters: list[RayCaster], eye: Eye) -> list[Floats]:
    """What each caster sees from a place, RGB of 255, (19200, 3)."""
    origin, yaw = eye
    rays = pixels(yaw)
    return [caster.colors(caster.cast(origin, rays), rays, 0.007) * 255 for caster in casters]


def rings() -> Floats:
    """16 rings of 900 rays."""
    elevation, azimuth = np.meshgrid(
        np.deg2rad(np.linspace(-15, 15, 16)), np.arange(900) * 2 * np.pi / 900, indexing="ij"
    )
    level = np.cos(elevation)
    rays = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
    return np.stack(rays, axis=-1).reshape(-1, 3).astype(np.float32)


def pixels(yaw: float) -> Floats:
    """Rays of a picture of 160 x 120 pixels, field of view 1 rad."""
    focal = 80 / np.tan(0.5)
    x, y = np.meshgrid((np.arange(160) - 79.5) / focal, (np.arange(120) - 59.5) / focal)
    forward, left = (
        np.array([np.cos(yaw), np.sin(yaw), 0]),
        np.array([-np.sin(yaw), np.cos(yaw), 0]),
    )
    rays = forward - x[..., None] * left - y[..., None] * np.array([0, 0, 1])
    return np.asarray(rays.reshape(-1, 3), np.float32)


if __name__ == "__main__":
    main()
