# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Read worlds from files: binary glTF and Gazebo's SDF."""

import os
from pathlib import Path

from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import read_trajectory
from fusionslam.sim.motion.map_files import read_map
from fusionslam.sim.world import World
from fusionslam.sim.worlds.gltf import read_glb
from fusionslam.sim.worlds.resource_paths import Unresolved
from fusionslam.sim.worlds.sdf import read_sdf

__all__ = ["load_world", "world_file"]


def load_world(path: str | os.PathLike[str], *, lenient: bool = False) -> World:
    """Read NAME.glb, NAME.world, NAME.sdf, or a folder with worlds/NAME.world and models/.

    NAME.collision.glb beside NAME.glb holds its collision shapes. NAME.map.yaml and
    NAME.trajectory.csv beside the world's file are its map and a drive through it.

    Args:
        path: file or folder.
        lenient: skip meshes, textures and materials that cannot be found or read, and list them
            in ``World.unresolved``, instead of raising.

    Raises:
        DataError: no such world, or the world, its map or its trajectory cannot be read; or,
            unless lenient, resources that it refers to are missing: the message lists them all.
    """
    file = world_file(path)
    if not file.is_file():
        raise DataError(
            f"{file}: no such world, expected .glb, .world, .sdf or a folder", code="no-world"
        )
    missing = Unresolved()
    if file.suffix == ".glb":
        beside = file.with_suffix(".collision.glb")
        visual = read_glb(file, missing)
        collision = read_glb(beside, missing) if beside.is_file() else visual
    elif file.suffix in (".world", ".sdf"):
        visual, collision = read_sdf(file, missing)
    else:
        raise DataError(
            f"{file}: expected a world as .glb, .world, .sdf or a folder", code="not-a-world"
        )
    grid, drive = file.with_suffix(".map.yaml"), file.with_suffix(".trajectory.csv")
    return World(
        name=file.stem,
        visual=visual,
        collision=collision,
        map=read_map(grid) if grid.is_file() else None,
        trajectory=read_trajectory(drive) if drive.is_file() else None,
        unresolved=missing.settle(file, lenient),
    )


def world_file(path: str | os.PathLike[str]) -> Path:
    """The file of a world, given that file or its folder. Raises DataError if there is none."""
    folder = Path(path)
    if not folder.is_dir():
        return folder
    found = sorted(p for s in ("world", "sdf") for p in (folder / "worlds").glob(f"*.{s}"))
    if len(found) == 1:
        return found[0]
    names = ", ".join(p.name for p in found) or "none"
    raise DataError(
        f"{folder / 'worlds'}: expected one .world or .sdf file, found {names}",
        code="not-one-world",
        fields=tuple(p.name for p in found),
    )
