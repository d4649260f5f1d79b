# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The procedural warehouse, house and hospital: bytes, names, ground, walls and shapes."""

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from benchmarks.accuracy.indoor import collision_follows, drivable, fan
from fusionslam.errors import ConfigError
from fusionslam.sim.canvas import SIDE, Canvas
from fusionslam.sim.indoor import (
    INDOOR_WORLDS,
    HospitalConfig,
    HouseConfig,
    WarehouseConfig,
    indoor_places,
    make_indoor,
)
from fusionslam.sim.indoor.textures import Look, indoor_textures
from fusionslam.sim.mesh import Paint, box
from fusionslam.sim.scene import RayCaster, Scene
from fusionslam.sim.world import World

NAMES = tuple(INDOOR_WORLDS)
GROUND = ("floor", "carpet", "marking")


@pytest.fixture(scope="module")
def worlds() -> dict[str, World]:
    return {name: make_indoor(INDOOR_WORLDS[name].config()) for name in NAMES}


@pytest.fixture(scope="module")
def casters(worlds: dict[str, World]) -> dict[str, tuple[RayCaster, RayCaster]]:
    """Visual and collision shapes of each world."""
    return {
        name: (RayCaster(world.visual), RayCaster(world.collision))
        for name, world in worlds.items()
    }


def arrays(scene: Scene) -> list[np.ndarray]:
    mesh = scene.mesh
    geometry = [mesh.triangles, mesh.uv, mesh.texture, mesh.tint, mesh.normals]
    return [*geometry, *scene.textures, scene.part, scene.ground]


def same(first: Scene, second: Scene) -> bool:
    pairs = zip(arrays(first), arrays(second), strict=True)
    return first.names == second.names and all(np.array_equal(a, b) for a, b in pairs)


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_bytes(name: str, worlds: dict[str, World]) -> None:
    indoor_textures.cache_clear()
    again = make_indoor(INDOOR_WORLDS[name].config())
    assert same(again.visual, worlds[name].visual)
    assert same(again.collision, worlds[name].collision)
    assert again.map is not None and worlds[name].map is not None
    assert np.array_equal(again.map.reachable, worlds[name].map.reachable)


@pytest.mark.parametrize("name", NAMES)
def test_another_seed_gives_another_layout(name: str, worlds: dict[str, World]) -> None:
    other = make_indoor(INDOOR_WORLDS[name].config(seed=4))
    maps = [other.map, worlds[name].map]
    assert all(room is not None for room in maps)
    first, second = (room.occupied for room in maps if room is not None)
    assert first.shape != second.shape or (first != second).sum() > 100
    pictures = (scene.textures[Look.PICTURES] for scene in (other.visual, worlds[name].visual))
    assert not np.array_equal(*pictures)


@pytest.mark.parametrize("name", NAMES)
def test_every_part_has_a_name_of_its_own_and_triangles(
    name: str, worlds: dict[str, World]
) -> None:
    for scene in (worlds[name].visual, worlds[name].collision):
        assert len(set(scene.names)) == len(scene.names) == len(scene.ground)
        assert all(part.rsplit("_", 1)[1].isdigit() for part in scene.names)
        assert len(scene.part) == len(scene.mesh)
        assert set(scene.part.tolist()) == set(range(len(scene.names)))
    collision = set(worlds[name].collision.names)
    assert collision < set(worlds[name].visual.names)


@pytest.mark.parametrize("name", NAMES)
def test_floors_carpets_and_paint_on_the_floor_are_ground_and_nothing_else_is(
    name: str, worlds: dict[str, World]
) -> None:
    for scene in (worlds[name].visual, worlds[name].collision):
        named = np.array([part.startswith(GROUND) for part in scene.names])
        assert np.array_equal(scene.ground, named)
        ground = scene.mesh.triangles[scene.ground[scene.part]]
        assert ground[..., 2].max() < 0.01
        assert (scene.mesh.normals[scene.ground[scene.part], 2] > 0.999).all()


@pytest.mark.parametrize("name", NAMES)
def test_collision_shapes_and_ceilings_stay_within_the_building(
    name: str, worlds: dict[str, World]
) -> None:
    scene = worlds[name].collision
    of_floor = np.array([part.startswith("floor") for part in scene.names])
    floor = scene.mesh.triangles[of_floor[scene.part]].reshape(-1, 3)
    corners = scene.mesh.triangles.reshape(-1, 3)
    assert (corners[:, :2] >= floor[:, :2].min(axis=0) - 1e-4).all()
    assert (corners[:, :2] <= floor[:, :2].max(axis=0) + 1e-4).all()
    assert corners[:, 2].min() >= -1e-5
    for mesh in (worlds[name].visual.mesh, scene.mesh):
        assert 2.5 <= mesh.triangles[..., 2].max() <= 4.5


@pytest.mark.parametrize("name", NAMES)
def test_the_building_is_centred_and_as_large_as_real_ones(
    name: str, worlds: dict[str, World]
) -> None:
    corners = worlds[name].visual.mesh.triangles.reshape(-1, 3)
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    assert np.abs(low + high).max() < 1.0
    wanted = {"warehouse": (20, 22), "house": (16, 11), "hospital": (35, 19)}[name]
    assert high - low == pytest.approx(wanted, abs=2.5)


@pytest.mark.parametrize("name", NAMES)
def test_a_ray_in_any_direction_from_inside_hits_something(
    name: str, worlds: dict[str, World], casters: dict[str, tuple[RayCaster, RayCaster]]
) -> None:
    rays = fan(np.radians([-60.0, -5.0, 0.0, 5.0, 60.0]), 360)
    for x, y in drivable(worlds[name], 15):
        for z in (0.1, 1.0, 2.3):
            for caster in casters[name]:
                hits = caster.cast(np.array((x, y, z), np.float32), rays)
                assert np.isfinite(hits.distance).all()


@pytest.mark.parametrize("name", NAMES)
def test_simple_and_detailed_shapes_give_nearly_the_same_ranges(
    name: str, worlds: dict[str, World]
) -> None:
    assert collision_follows(worlds[name]) > 0.93


@pytest.mark.parametrize("name", NAMES)
def test_worlds_stay_small_and_collision_shapes_are_simpler(
    name: str, worlds: dict[str, World]
) -> None:
    world = worlds[name]
    assert len(world.collision.mesh) < len(world.visual.mesh) < 60_000
    assert len({int(t) for t in world.visual.mesh.texture}) > 10


@pytest.mark.parametrize("name", NAMES)
def test_no_triangle_is_degenerate_and_all_normals_are_unit(
    name: str, worlds: dict[str, World]
) -> None:
    for scene in (worlds[name].visual, worlds[name].collision):
        mesh = scene.mesh
        assert all(np.isfinite(array).all() for array in (mesh.triangles, mesh.uv, mesh.tint))
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-4)
        assert mesh.texture.min() >= 0 and mesh.texture.max() < len(scene.textures)


@pytest.mark.parametrize(
    "config",
    [
        HouseConfig(rooms=2, clutter=0.0),
        HouseConfig(rooms=12, size_m=(30.0, 14.0), clutter=1.0),
        HospitalConfig(wards=4, clutter=0.0),
        WarehouseConfig(rows=1, bays=2, fill=0.0, clutter=0.0, bay_types=1),
        WarehouseConfig(rows=2, bays=3, aisle_m=1.2, clutter=1.0),
    ],
)
def test_small_large_bare_and_full_worlds_are_reachable(
    config: HouseConfig | HospitalConfig | WarehouseConfig,
) -> None:
    world = make_indoor(config)
    assert world.map is not None
    room = world.map.inflate(0.25)
    assert all(room.is_free(*place) for place in indoor_places(config).values())


@pytest.mark.parametrize(
    "values",
    [
        {"rooms": 12},
        {"size_m": (-16.0, 11.0)},
        {"size_m": (float("nan"), 11.0)},
        {"size_m": (16.0, float("inf"))},
    ],
)
def test_a_house_whose_rooms_have_no_sensible_size_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(ConfigError) as error:
        make_indoor(HouseConfig(**values))
    assert error.value.code == "room-size"


def test_a_hall_that_is_too_long_is_refused() -> None:
    make_indoor(HouseConfig(rooms=12, size_m=(30.0, 11.0)))
    with pytest.raises(ConfigError) as error:
        make_indoor(HouseConfig(rooms=12, size_m=(30.5, 11.0)))
    assert (error.value.code, error.value.fields) == ("room-size", ("hall",))


def test_an_unknown_key_is_an_error_that_names_it() -> None:
    with pytest.raises(ConfigError, match="wardz"):
        HospitalConfig(wardz=3)


def test_a_closed_box_has_six_faces_that_look_outwards() -> None:
    open_box, closed = (box((0, 0, 0), (1, 2, 3), Paint(0), bottom=b) for b in (False, True))
    assert (len(open_box), len(closed)) == (10, 12)
    outward = closed.triangles.mean(axis=1) - (0.5, 1.0, 1.5)
    assert (np.einsum("ij,ij->i", outward, closed.normals) > 0).all()
    assert (closed.normals[:, 2] < -0.9).sum() == 2 and (open_box.normals[:, 2] > -0.1).all()


def test_a_disc_covers_its_area_and_is_cut_at_the_edge() -> None:
    canvas = Canvas((2.0, 2.0), (0.0, 0.0, 0.0), 0.0)
    canvas.disc((1.0, 0.5), 0.25, (1.0, 0.0, 0.0), 1.0)
    texels = (SIDE / 2.0) ** 2
    assert canvas.tint.sum() / texels == pytest.approx(np.pi * 0.25**2, rel=0.01)
    assert canvas.rgb[: SIDE // 2].sum() == 0  # y runs upwards: the upper half stays black
    canvas.disc((0.0, 2.0), 0.25, (1.0, 0.0, 0.0), 0.5)
    assert (canvas.tint == 0.5).sum() / texels == pytest.approx(np.pi * 0.25**2 / 4, rel=0.02)
