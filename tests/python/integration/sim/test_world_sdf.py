# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds in SDF: where things stand, how they look, what is ground."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("collada", reason="the simulator is an extra")

from fusionslam.sim.rendered_images import rendered_images
from fusionslam.sim.scene import Scene
from fusionslam.sim.world import World, hash_world
from fusionslam.sim.worlds import load_world
from rows import rows
from worlds import ROOM, copy_room

BOX = "<geometry><box><size>2 4 6</size></box></geometry>"


@pytest.fixture
def room(tmp_path: Path) -> Path:
    return copy_room(tmp_path)


@pytest.fixture(scope="module")
def world() -> World:
    """The room as it is."""
    return load_world(ROOM)


def corners(scene: Scene, name: str) -> np.ndarray:
    """Corners (T, 3, 3) of one object."""
    return scene.mesh.triangles[scene.part == list(scene.names).index(name)]


def bounds(scene: Scene, name: str) -> np.ndarray:
    points = corners(scene, name).reshape(-1, 3)
    return np.array([points.min(axis=0), points.max(axis=0)])


def tints(scene: Scene, name: str) -> np.ndarray:
    return np.unique(scene.mesh.tint[scene.part == list(scene.names).index(name)], axis=0)


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def single(tmp_path: Path, inside: str) -> Path:
    """A world of one model "thing" of one visual "v" with the given content."""
    file = tmp_path / "single.world"
    file.write_text(
        '<sdf version="1.6"><world name="w"><model name="thing"><link name="l"><visual name="v">'
        f"{inside}</visual></link></model></world></sdf>"
    )
    return file


def test_a_room_has_its_models_as_objects_in_the_order_of_the_file(world: World) -> None:
    assert world.name == "room" and world.unresolved == ()
    expected = ["ground_plane", "hall", "hall ground", "crate", "table_1", "shelf", "lamp"]
    assert list(world.visual.names) == expected
    assert list(world.collision.names) == ["ground_plane", "hall", "crate", "table_1"]
    np.testing.assert_allclose(
        bounds(world.collision, "table_1"), [[1.5, -0.5, 0], [2.5, 0.5, 1]], atol=1e-3
    )
    np.testing.assert_allclose(bounds(world.visual, "table_1"), [[2, 0, 1], [3, 1, 1]], atol=1e-6)


def test_a_saved_state_moves_a_model_from_where_its_own_pose_says(world: World, room: Path) -> None:
    expected = [[-1.5, -4, 0], [-0.5, -2, 1]]  # 2 x 1 x 1 m turned by 90 degrees about (-1, -3)
    np.testing.assert_allclose(bounds(world.visual, "crate"), expected, atol=1e-6)
    file = room / "worlds" / "room.world"
    file.write_text(re.sub("<state.*</state>", "", file.read_text(), flags=re.DOTALL))
    scene = load_world(room).visual
    np.testing.assert_allclose(bounds(scene, "crate"), [[8, 8.5, 9], [10, 9.5, 10]], atol=1e-6)


def test_poses_of_nested_models_and_links_are_chained(world: World) -> None:
    found = corners(world.visual, "shelf")
    ball, brick = found[:1280].reshape(-1, 3), found[1280:].reshape(-1, 3)
    # shelf turns x into y about (0, -2); stack lifts by 1; the ball is at (1, 0, 0.25) in it.
    np.testing.assert_allclose(np.linalg.norm(ball - [0, -1, 1.25], axis=1), 0.25, atol=1e-5)
    # upper turns once more: (1, 0, 0) -> (0, 1, 2) -> (0, 1, 3) -> (-1, -2, 3).
    np.testing.assert_allclose(brick.min(axis=0), [-1.1, -2.1, 2.9], atol=1e-6)
    np.testing.assert_allclose(brick.max(axis=0), [-0.9, -1.9, 3.1], atol=1e-6)


def test_an_included_model_keeps_its_own_pose_unless_the_include_has_one(room: Path) -> None:
    uri = "<uri>model://stack</uri>"
    edit(room / "worlds/room.world", uri, f"{uri}<pose>0 0 5 0 0 0</pose>")
    assert bounds(load_world(room).visual, "shelf")[1, 2] == pytest.approx(3.1 + 4)


def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_that_order(tmp_path: Path) -> None:
    file = single(tmp_path, f"<pose>1 2 3 0.3 -0.4 0.5</pose>{BOX}")
    cx, sx, cy, sy, cz, sz = (f(a) for a in (0.3, -0.4, 0.5) for f in (np.cos, np.sin))
    turn = (
        np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    )
    local = (corners(load_world(file).visual, "thing") - [1, 2, 3]) @ turn
    np.testing.assert_allclose(np.abs(local).reshape(-1, 3), np.tile([1, 2, 3], (36, 1)), atol=1e-5)


def test_poses_may_be_in_degrees_or_quaternions(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    found = [
        bounds(load_world(single(tmp_path, f"<pose{pose}</pose>{BOX}")).visual, "thing")
        for pose in (
            ">0 0 0 0 0 1.5707963267948966",
            ' degrees="true">0 0 0 0 0 90',
            f' rotation_format="quat_xyzw">0 0 0 0 0 {half} {half}',
        )
    ]
    np.testing.assert_allclose(found[0], [[-2, -1, -3], [2, 1, 3]], atol=1e-6)
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-6)


def test_collada_units_count_and_textures_lie_the_right_way_round(world: World) -> None:
    table = corners(world.visual, "table_1")
    np.testing.assert_allclose(np.unique(table[..., 2]), [1.0])  # 100 cm along z as stored
    scene = world.visual
    chosen = scene.part == list(scene.names).index("table_1")
    texture = scene.textures[scene.mesh.texture[chosen][0]]
    np.testing.assert_array_equal(texture[0, 0], [255, 0, 0, 255])
    at = scene.mesh.triangles[chosen][..., :2] - [2, 0]
    np.testing.assert_allclose(scene.mesh.uv[chosen], at, atol=1e-6)  # u along x, v along y


@rows(
    "place",
    [
        "models/table/meshes/top.png",
        "models/table/materials/textures/top.png",
        "photos/top.png",
    ],
)
def test_a_texture_is_looked_up_in_three_ways(tmp_path: Path, place: str) -> None:
    room = copy_room(tmp_path)
    stored = room / "models/table/materials/textures/top.png"
    target = room / place
    target.parent.mkdir(exist_ok=True)
    stored.rename(target)
    assert (2, 2, 4) in [texture.shape for texture in load_world(room).visual.textures]


def test_materials_come_from_visuals_scripts_and_meshes(world: World, room: Path) -> None:
    scene = world.visual
    np.testing.assert_allclose(tints(scene, "crate"), [[1, 0.5, 0.25]])
    np.testing.assert_allclose(tints(scene, "ground_plane"), [[0.7, 0.7, 0.7]])
    np.testing.assert_allclose(bounds(scene, "lamp"), [[-2, 2, 2], [0, 4, 2]])
    np.testing.assert_allclose(tints(scene, "lamp"), [[0.2, 0.4, 0.6], [1, 1, 1]], atol=1e-6)
    assert any((texture[0, 0, :3] == [200, 100, 50]).all() for texture in scene.textures)
    chosen = scene.part == list(scene.names).index("lamp")
    # Faced down at -1 and mirrored: the outside stays outside.
    np.testing.assert_allclose(scene.mesh.normals[chosen], [[0, 0, 1]] * 2)
    red = "<material><script><name>Gazebo/Red</name></script></material></visual>"
    edit(room / "models/lamp/model.sdf", "</visual>", red)
    np.testing.assert_allclose(tints(load_world(room).visual, "lamp"), [[1, 0, 0]])


def test_the_third_texture_coordinate_of_an_obj_is_not_used(world: World, room: Path) -> None:
    obj = room / "models/lamp/meshes/lamp.obj"
    obj.write_text(re.sub("^(vt .*)$", r"\1 0.5", obj.read_text(), flags=re.MULTILINE))
    np.testing.assert_array_equal(load_world(room).visual.mesh.uv, world.visual.mesh.uv)


@rows(
    "shape, volume",
    [
        ("<box><size>1 2 3</size></box>", 6.0),
        ("<cylinder><radius>0.5</radius><length>2</length></cylinder>", np.pi / 2),
        ("<sphere><radius>0.5</radius></sphere>", np.pi / 6),
    ],
)
def test_simple_shapes_have_their_volume(tmp_path: Path, shape: str, volume: float) -> None:
    world = load_world(single(tmp_path, f"<geometry>{shape}</geometry>"))
    assert world.collision is world.visual
    a, b, c = corners(world.visual, "thing").astype(float).transpose(1, 0, 2)
    inside = (np.cross(a, b) * c).sum() / 6  # positive: all triangles face outwards
    assert inside == pytest.approx(volume, rel=0.01)


def test_a_plane_has_its_size_and_faces_its_normal(tmp_path: Path) -> None:
    file = single(
        tmp_path, "<geometry><plane><normal>0 3 4</normal><size>2 5</size></plane></geometry>"
    )
    mesh = load_world(file).visual.mesh
    np.testing.assert_allclose(mesh.normals, [[0, 0.6, 0.8]] * 2, atol=1e-6)
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(10)


def test_floors_are_ground_by_name_or_by_lying_level_on_it(world: World) -> None:
    scene = world.visual
    ground = {name for name, is_ground in zip(scene.names, scene.ground, strict=True) if is_ground}
    assert ground == {"ground_plane", "hall ground"}
    np.testing.assert_allclose(bounds(scene, "hall ground"), [[-4, -4, 0], [4, 4, 0]], atol=1e-6)


def test_what_is_thin_on_a_floor_belongs_to_it_but_for_its_bottom(room: Path) -> None:
    for thick, triangles in ((0.01, 2 + 10), (0.06, 2)):
        mat = f'<visual name="mat"><pose>0 0 {thick / 2} 0 0 0</pose>'
        mat += f"<geometry><box><size>0.8 0.8 {thick}</size></box></geometry></visual>"
        slab = '<visual name="slab">'
        edit(room / "worlds/room.world", slab, mat + slab)
        assert len(corners(load_world(room).visual, "hall ground")) == triangles
        edit(room / "worlds/room.world", mat, "")


def test_a_ground_plane_sinks_below_a_floor_that_is_laid_on_it(world: World, room: Path) -> None:
    assert np.unique(corners(world.visual, "ground_plane")[..., 2]) == pytest.approx([-0.01])
    assert np.unique(corners(world.collision, "ground_plane")[..., 2]) == pytest.approx([0])
    edit(room / "worlds/room.world", "<pose>0 0 -0.05 0 0 0</pose>", "<pose>0 0 3 0 0 0</pose>")
    alone = load_world(room).visual
    assert np.unique(corners(alone, "ground_plane")[..., 2]) == pytest.approx([0])


def test_a_model_file_alone_is_a_world() -> None:
    world = load_world(ROOM / "models" / "stack" / "model.sdf")
    assert list(world.visual.names) == ["stack"] and len(world.visual.mesh) == 1280 + 12


def test_models_are_found_where_gazebo_looks(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = (room / "models").rename(room.parent / "elsewhere")
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(elsewhere))
    assert load_world(room).unresolved == ()


@rows(
    "file, old, new",
    [
        ("worlds/room.world", "<size>2 1 1<", "<size>2 1 2<"),
        ("models/lamp/meshes/lamp.obj", "v 1 0 -1", "v 1 0 -2"),
        ("models/table/meshes/table.dae", "0 0 100 ", "0 0 101 "),
    ],
)
def test_another_mesh_in_any_file_gives_another_hash(
    tmp_path: Path, world: World, file: str, old: str, new: str
) -> None:
    room = copy_room(tmp_path)
    assert hash_world(load_world(room)) == hash_world(world)
    edit(room / file, old, new)
    assert hash_world(load_world(room)) != hash_world(world)


def test_another_texture_gives_another_hash(world: World, room: Path) -> None:
    Image.new("RGB", (2, 2), "red").save(room / "models/table/materials/textures/top.png")
    assert hash_world(load_world(room)) != hash_world(world)


def test_images_rendered_among_other_meshes_are_cached_under_another_key(room: Path) -> None:
    world, seconds, poses = room / "worlds/room.world", np.arange(2.0), np.zeros((2, 3))
    before = rendered_images(world, seconds, poses).key
    assert rendered_images(world, seconds, poses).key == before
    edit(room / "models/lamp/meshes/lamp.obj", "v 1 0 -1", "v 1 0 -2")
    assert rendered_images(world, seconds, poses).key != before
