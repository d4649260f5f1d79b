# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds as glTF and as SDF have the same triangles, objects, ranges and pictures.

``test_lidar`` compares the ranges in the glTF files with those of another simulator.
"""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

pytest.importorskip("embreex", reason="the simulator is an extra")
pytest.importorskip("collada", reason="the simulator is an extra")

from benchmarks.accuracy.worlds import Eye, eyes, pictures, same_ranges
from fusionslam.sim.scene import RayCaster, Scene
from fusionslam.sim.world import World
from fusionslam.sim.worlds import load_world
from worlds import ROOM

COUNTS = {"small_house": (148_404, 6_689), "warehouse": (17_970, 938)}
KINDS = ("visual", "collision")
PLACES = 6
Pair = tuple[World, World]


def write_glb(path: Path, scene: Scene) -> None:
    """Write a scene as glTF with trimesh, one node for each texture and tint of an object."""
    file = trimesh.Scene()
    mesh = scene.mesh
    looks = np.column_stack([scene.part, mesh.texture, mesh.tint])
    for look in np.unique(looks, axis=0):
        chosen = (looks == look).all(axis=1)
        image = Image.fromarray(scene.textures[int(look[1])][..., :3])
        material = trimesh.visual.material.PBRMaterial(
            baseColorFactor=[*look[2:], 1.0], baseColorTexture=image
        )
        visual = trimesh.visual.TextureVisuals(mesh.uv[chosen].reshape(-1, 2), material)
        corners = mesh.triangles[chosen].reshape(-1, 3)
        faces = np.arange(len(corners)).reshape(-1, 3)
        node = trimesh.Trimesh(corners, faces, visual=visual, process=False)
        file.add_geometry(node, node_name=f"{scene.names[int(look[0])]} {look[1:]}")
    path.write_bytes(file.export(file_type="glb"))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    """The room of the test data from glTF, written by another program, and from SDF."""
    world = load_world(ROOM)
    path = tmp_path_factory.mktemp("room") / "room.glb"
    write_glb(path, world.visual)
    write_glb(path.with_suffix(".collision.glb"), world.collision)
    return load_world(path), world


@pytest.fixture(scope="module")
def shared(test_data: Path) -> dict[str, Pair]:
    """Both worlds of the shared data from glTF and from SDF, by name."""
    worlds, models = test_data / "worlds", test_data / "worlds_sdf"
    return {
        name: (load_world(worlds / f"{name}.glb"), load_world(models / name)) for name in COUNTS
    }


def same_objects(first: Scene, second: Scene) -> bool:
    """The scenes have the same objects, and the same of them are ground."""
    a, b = (sorted(zip(s.names, s.ground, strict=True)) for s in (first, second))
    return a == b and len(first.mesh) == len(second.mesh) and any(first.ground)


def check_ranges(pair: Pair, eyes: list[Eye]) -> None:
    for kind in KINDS:
        first, second = (getattr(world, kind) for world in pair)
        found = same_ranges(RayCaster(first), RayCaster(second), first, eyes)
        assert found.counted.mean() > 0.98
        assert found.same[found.counted].mean() >= 0.999


def check_pictures(pair: Pair, eyes: list[Eye], differ: float) -> None:
    casters = [RayCaster(world.visual) for world in pair]
    for eye in eyes:
        a, b = pictures(casters, eye)
        assert np.abs(a - b).mean() < differ
        np.testing.assert_allclose(a.mean(axis=0), b.mean(axis=0), atol=2)
        assert a.std() > 10  # there is something to be seen


def test_a_room_is_the_same_from_both_files(room: Pair) -> None:
    for kind in KINDS:
        first, second = (getattr(world, kind) for world in room)
        assert len(first.mesh) == len(second.mesh)
        # Triangles of the ground: the files divide the objects differently.
        assert first.ground[first.part].sum() == second.ground[second.part].sum() > 0
    # Towards the table and towards the crate.
    looks = ((0.5, 0.0, 0.2), (1.5, -3.0, np.pi))
    eyes: list[Eye] = [(np.array([x, y, 0.8], np.float32), yaw) for x, y, yaw in looks]
    check_ranges(room, eyes)
    check_pictures(room, eyes, differ=1.0)


@pytest.mark.nightly
def test_the_shared_worlds_are_all_there_in_both_files(shared: dict[str, Pair]) -> None:
    for name, pair in shared.items():
        for world in pair:
            assert (len(world.visual.mesh), len(world.collision.mesh)) == COUNTS[name]
            assert world.unresolved == ()
        assert all(same_objects(*(getattr(world, kind) for world in pair)) for kind in KINDS)


@pytest.mark.nightly
def test_the_shared_worlds_look_the_same_from_both_files(shared: dict[str, Pair]) -> None:
    for pair in shared.values():
        check_ranges(pair, eyes(pair[0], 0.17, PLACES))
        # The glTF files hold JPEG pictures, the models PNG.
        check_pictures(pair, eyes(pair[0], 0.103, PLACES), differ=3.0)
