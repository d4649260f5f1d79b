# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The procedural warehouse, house and hospital: shapes, walls and ground, and what repeats."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("embreex", reason="the simulator is an extra")

from benchmarks.accuracy.indoor import (
    aisles_unlike,
    collision_follows,
    directions,
    drivable,
    fan,
    ward_yaws,
    wards_unlike,
)
from error_codes import has_code
from fusionslam.errors import ConfigError
from fusionslam.sim.canvas import SIDE, Canvas
from fusionslam.sim.indoor import (
    INDOOR_WORLDS,
    HospitalConfig,
    HouseConfig,
    WarehouseConfig,
    furniture,
    indoor_places,
    make_indoor,
)
from fusionslam.sim.indoor.furniture import WOODS, Style, make_piece
from fusionslam.sim.indoor.layout import Layout
from fusionslam.sim.indoor.objects import Site, thing
from fusionslam.sim.indoor.rooms import Opening, Room
from fusionslam.sim.indoor.textures import WHITE, Look, cut, indoor_textures
from fusionslam.sim.mesh import Paint, box, paint
from fusionslam.sim.scene import RayCaster, Scene
from fusionslam.sim.world import World
from rows import rows

NAMES = tuple(INDOOR_WORLDS)
GROUND = ("floor", "carpet", "marking")
OTHER_SEED = 0
STYLE = Style(WOODS[0], WHITE, WHITE)
Config = HouseConfig | HospitalConfig | WarehouseConfig
Worlds = dict[str, World]


@pytest.fixture(scope="module")
def worlds() -> Worlds:
    return {name: make_indoor(INDOOR_WORLDS[name].config()) for name in NAMES}


@pytest.fixture(scope="module")
def others() -> Worlds:
    return {name: make_indoor(INDOOR_WORLDS[name].config(seed=OTHER_SEED)) for name in NAMES}


def same(first: Scene, second: Scene) -> bool:
    def arrays(scene: Scene) -> list[np.ndarray]:
        mesh = scene.mesh
        geometry = [mesh.triangles, mesh.uv, mesh.texture, mesh.tint, mesh.normals]
        return [*geometry, *scene.textures, scene.part, scene.ground]

    pairs = zip(arrays(first), arrays(second), strict=True)
    return first.names == second.names and all(np.array_equal(a, b) for a, b in pairs)


def extent(world: World) -> np.ndarray:
    """Least and largest x and y of all corners, (2, 2)."""
    corners = world.visual.mesh.triangles.reshape(-1, 3)[:, :2]
    return np.array([corners.min(axis=0), corners.max(axis=0)])


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(worlds: Worlds) -> None:
    indoor_textures.cache_clear()
    configs = (HospitalConfig(wards=4, clutter=0.5), WarehouseConfig(rows=2, bays=3, clutter=0.5))
    pairs = [[make_indoor(config) for _ in range(2)] for config in configs]
    for first, again in (*pairs, (worlds["house"], make_indoor(HouseConfig()))):
        assert same(again.visual, first.visual) and same(again.collision, first.collision)
        assert np.array_equal(again.map.reachable, first.map.reachable)


@rows("name", NAMES)
def test_another_seed_gives_another_layout(name: str, worlds: Worlds, others: Worlds) -> None:
    pair = worlds[name], others[name]
    first, second = (world.map.occupied for world in pair if world.map is not None)
    assert first.shape != second.shape or (first != second).sum() > 100
    assert not np.array_equal(*(world.visual.textures[Look.PICTURES] for world in pair))


def check_reachable(world: World, config: Config) -> None:
    """A robot gets to each room and aisle."""
    free = world.map.inflate(0.25)
    assert [k for k, place in indoor_places(config).items() if not free.is_free(*place)] == []


def check_usable(name: str, world: World, config: Config) -> None:
    check_reachable(world, config)
    # Nothing reaches through the outer walls or floors, and ceilings are as high as real ones.
    for scene in (world.visual, world.collision):
        floor = np.array([part.startswith("floor") for part in scene.names])[scene.part]
        edges = scene.mesh.triangles[floor].reshape(-1, 3)
        corners = scene.mesh.triangles.reshape(-1, 3)
        assert (corners[:, :2] >= edges[:, :2].min(axis=0) - 1e-4).all()
        assert (corners[:, :2] <= edges[:, :2].max(axis=0) + 1e-4).all()
        assert corners[:, 2].min() >= -1e-5 and 2.5 <= corners[:, 2].max() <= 4.5

    if name != "house":
        return

    def count(kind: str) -> int:
        return sum(part.startswith(kind) for part in world.visual.names)

    # Each room has what makes it one.
    assert count("bed_") == count("floor_bedroom") + count("floor_playroom") > 0
    assert count("kitchen_counter") >= count("floor_kitchen") > 0
    assert count("bathtub") == count("toilet") == count("floor_bathroom") > 0
    assert count("sofa") == count("television") == count("floor_living") > 0
    assert count("workplace") == count("floor_study") > 0


@rows("name", NAMES)
def test_each_world_can_be_used_by_a_robot(name: str, worlds: Worlds, others: Worlds) -> None:
    config = INDOOR_WORLDS[name].config
    check_usable(name, worlds[name], config())
    check_usable(name, others[name], config(seed=OTHER_SEED))


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_worlds_of_another_seed_can_be_used(name: str) -> None:
    config = INDOOR_WORLDS[name].config(seed=1)
    check_usable(name, make_indoor(config), config)


@rows("name", NAMES)
def test_parts_triangles_and_ground_belong_together(name: str, worlds: Worlds) -> None:
    for scene in (worlds[name].visual, worlds[name].collision):
        mesh = scene.mesh
        assert len(set(scene.names)) == len(scene.names) == len(scene.ground)
        assert all(part.rsplit("_", 1)[1].isdigit() for part in scene.names)
        assert len(scene.part) == len(mesh)
        assert set(scene.part.tolist()) == set(range(len(scene.names)))
        assert all(np.isfinite(array).all() for array in (mesh.triangles, mesh.uv, mesh.tint))
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-4)
        assert mesh.texture.min() >= 0 and mesh.texture.max() < len(scene.textures)
        # Floors, carpets and paint on the floor are ground, and nothing else is.
        named = np.array([part.startswith(GROUND) for part in scene.names])
        assert np.array_equal(scene.ground, named)
        assert mesh.triangles[scene.ground[scene.part]][..., 2].max() < 0.01
        assert (mesh.normals[scene.ground[scene.part], 2] > 0.999).all()
    assert set(worlds[name].collision.names) < set(worlds[name].visual.names)


@rows("name, size", [("warehouse", (20, 22)), ("house", (16, 11)), ("hospital", (35, 19))])
def test_buildings_are_of_real_size(name: str, size: tuple[float, float], worlds: Worlds) -> None:
    world = worlds[name]
    low, high = extent(world)
    assert np.abs(low + high).max() < 1.0
    assert high - low == pytest.approx(size, abs=2.5)
    assert len(world.collision.mesh) < len(world.visual.mesh) < 60_000
    assert len({int(t) for t in world.visual.mesh.texture}) > 10


@rows("name", NAMES)
def test_a_ray_in_any_direction_from_inside_hits_something(name: str, worlds: Worlds) -> None:
    rays = fan(np.radians([-60.0, -5.0, 0.0, 5.0, 60.0]), 180)
    for scene in (worlds[name].visual, worlds[name].collision):
        caster = RayCaster(scene)
        for (x, y), z in itertools.product(drivable(worlds[name], 15), (0.1, 1.0, 2.3)):
            hits = caster.cast(np.array((x, y, z), np.float32), rays)
            assert np.isfinite(hits.distance).all()


@rows("name", NAMES)
def test_simple_and_detailed_shapes_give_nearly_the_same_ranges(name: str, worlds: Worlds) -> None:
    assert collision_follows(worlds[name]) > 0.93


@rows(
    "config",
    [
        HouseConfig(rooms=2, clutter=0.0),
        HouseConfig(rooms=12, size_m=(30.0, 14.0), clutter=1.0),
        HouseConfig(rooms=12, size_m=(30.0, 11.0)),  # as long as its hall may be
        HospitalConfig(wards=4, clutter=0.0),
        WarehouseConfig(rows=1, bays=2, fill=0.0, clutter=0.0, bay_types=1),
        WarehouseConfig(rows=2, bays=3, aisle_m=1.2, clutter=1.0),
    ],
)
@pytest.mark.slow
def test_small_large_bare_and_full_worlds_are_reachable(config: Config) -> None:
    check_reachable(make_indoor(config), config)


@rows(
    "fields, values",
    [
        ((), {"rooms": 12}),
        ((), {"size_m": (-16.0, 11.0)}),
        ((), {"size_m": (float("nan"), 11.0)}),
        ((), {"size_m": (16.0, float("inf"))}),
        (("hall",), {"rooms": 12, "size_m": (30.5, 11.0)}),
    ],
)
def test_rooms_without_sense_are_refused(
    fields: tuple[str, ...], values: dict[str, object]
) -> None:
    with pytest.raises(ConfigError, check=has_code("room-size", *fields)):
        make_indoor(HouseConfig(**values))


def test_an_unknown_key_is_an_error_that_names_it() -> None:
    with pytest.raises(ConfigError, match="wardz"):
        HospitalConfig(wardz=3)


def test_wards_on_both_sides_of_the_corridors_look_alike_to_a_lidar(worlds: Worlds) -> None:
    config = HospitalConfig()
    assert len(ward_yaws(config)) == 2 * config.wards
    among, apart = wards_unlike(worlds["hospital"], config)
    assert np.median(among) < 0.1 and max(among) < 0.25
    assert min(apart) > 2 * max(among)


def test_no_two_wards_are_the_same_to_lidar_and_camera_together(worlds: Worlds) -> None:
    caster = RayCaster(worlds["hospital"].visual)
    places, seen = indoor_places(HospitalConfig()), []
    for name, yaw in ward_yaws(HospitalConfig()).items():
        hits = caster.cast(np.array((*places[name], 0.3), np.float32), directions(yaw))
        # Without light: wards on the two sides are lit from other directions.
        seen.append(caster.brightness(hits))
    for first, second in itertools.combinations(seen, 2):
        assert np.mean(np.abs(first - second) > 0.05) > 0.02


def test_aisles_and_bays_of_the_warehouse_repeat(worlds: Worlds) -> None:
    config, scene = WarehouseConfig(), worlds["warehouse"].visual
    south, yard = aisles_unlike(worlds["warehouse"], config)
    assert min(south) < 0.35
    assert np.median(south) < 0.75 * np.median(yard)
    racks = [k for k, name in enumerate(scene.names) if name.startswith("shelf")]
    assert len(racks) == config.rows * config.bays
    shapes = set()
    for rack in racks:
        # Where a rack stands changes its corners only.
        of_rack = scene.part == rack
        shapes.add(scene.mesh.uv[of_rack].tobytes() + scene.mesh.tint[of_rack].tobytes())
    assert 2 <= len(shapes) <= config.bay_types


def test_rooms_of_a_house_repeat_furniture_in_other_colours(worlds: Worlds) -> None:
    scene = worlds["house"].visual
    beds = [k for k, name in enumerate(scene.names) if name.startswith("bed_")]
    assert len(beds) >= 2
    first, second, *_ = (
        {tuple(row) for row in np.round(scene.mesh.tint[scene.part == k], 2).tolist()} for k in beds
    )
    assert first != second


def test_a_house_has_many_colours(worlds: Worlds) -> None:
    caster, rays, hues = RayCaster(worlds["house"].visual), directions(), []
    for place in indoor_places(HouseConfig()).values():
        hits = caster.cast(np.array((*place, 0.5), np.float32), rays)
        rgb = caster.colors(hits, rays, 0.002)
        colourful = np.ptp(rgb, axis=1) > 0.15
        hues.append(np.argsort(rgb[colourful], axis=1)[:, ::-1])
    orders, counts = np.unique(np.concatenate(hues), axis=0, return_counts=True)
    assert len(orders) == 6  # every order of red, green and blue
    assert (counts > 5).all()


def cell_with_door(seed: int) -> tuple[Site, Room, Layout]:
    room = Room("cell", (0, 0), (4, 4), paint(Look.PLAIN), paint(Look.PLAIN), paint(Look.PLAIN))
    site = Site()
    door = Opening(1.0, 0.0, 0.95, "")
    return site, room, Layout(site, room, [door], np.random.default_rng(seed))


def test_nothing_is_put_between_a_door_and_the_middle_of_a_room() -> None:
    for seed in range(5):
        site, room, layout = cell_with_door(seed)
        while layout.along_wall(make_piece("table.small", STYLE)):
            pass
        while layout.anywhere(make_piece("chair", STYLE)):
            pass
        world = site.world("cell", 0, room.centre)
        # Without walls the whole map's margin is free: look along the lane itself.
        steps = np.linspace(0.3, 2.0, 30)
        free = world.map.inflate(0.22)
        assert free.is_free(np.ones(30), steps).all()
        assert free.is_free(np.linspace(1.0, 2.0, 30), np.full(30, 2.0)).all()


def test_things_in_a_room_do_not_stand_in_each_other() -> None:
    site, room, layout = cell_with_door(1)
    while layout.along_wall(make_piece("table.small", STYLE)):
        pass
    scene = site.world("cell", 0, room.centre).collision
    boxes = []
    for part in range(len(scene.names)):
        corners = scene.mesh.triangles[scene.part == part].reshape(-1, 3)
        boxes.append((corners.min(axis=0), corners.max(axis=0)))
    assert len(boxes) >= 6
    for (low, high), (lower, higher) in itertools.combinations(boxes, 2):
        assert (low[:2] >= higher[:2] - 1e-5).any() or (lower[:2] >= high[:2] - 1e-5).any()


def test_a_thing_that_does_not_fit_is_not_placed() -> None:
    _, _, layout = cell_with_door(0)
    for size in ((2.5, 0.3, 1.0), (2.5, 2.5, 1.0)):
        wide = [box(np.negative(size), size, paint(Look.PLAIN))]
        assert not layout.along_wall(thing("table", wide, wide))
        assert not layout.anywhere(thing("table", wide, wide))


def test_each_print_of_a_sheet_is_addressed_by_its_number() -> None:
    assert cut(Look.LABELS, 0, 0.2, 0.3).offset == (0.0, 0.0)
    assert cut(Look.LABELS, 5, 0.2, 0.3).offset == (0.25, 0.25)
    assert cut(Look.LABELS, 16, 0.2, 0.3) == cut(Look.LABELS, 0, 0.2, 0.3)
    assert cut(Look.LABELS, 1, 0.2, 0.3).extent == pytest.approx((0.8, 1.2))


def test_every_piece_of_the_furniture_table_can_be_built() -> None:
    pieces = yaml.safe_load(Path(furniture.__file__).with_suffix(".yaml").read_text())
    options = {
        "mirror",
        "around",
        "sides",
        "along",
        "texture",
        "fit",
        "cell",
        "tint",
        "hit",
        "seen",
    }
    for kind, shapes in pieces.items():
        for shape in shapes:
            assert len(shape.keys() - options) == 1, (kind, shape)  # no misspelt option
        piece = make_piece(kind, STYLE)
        assert piece.kind == kind.partition(".")[0] and len(piece.visual) > 0
        low, high = (getattr(piece.visual.triangles, end)(axis=(0, 1)) for end in ("min", "max"))
        if piece.collision is None:
            assert all(not shape.get("hit", True) for shape in shapes)
            continue
        corners = piece.collision.triangles
        assert (corners >= low - 0.01).all() and (corners <= high + 0.01).all()


def test_mirrored_and_turned_shapes_stand_around_the_origin() -> None:
    trolley, stand = make_piece("trolley"), make_piece("drip_stand")
    corners = trolley.visual.triangles.reshape(-1, 3)
    assert corners[:, 0].min() == -corners[:, 0].max()
    feet = stand.visual.triangles.reshape(-1, 3)
    feet = feet[feet[:, 2] < 0.03]
    turns = np.unique(np.round(np.arctan2(feet[:, 1], feet[:, 0]) / (2 * np.pi / 5)) % 5)
    assert len(turns) == 5


def test_a_closed_box_has_six_faces_that_look_outwards() -> None:
    open_box, closed = (box((0, 0, 0), (1, 2, 3), Paint(0), bottom=b) for b in (False, True))
    assert (len(open_box), len(closed)) == (10, 12)
    outward = closed.triangles.mean(axis=1) - (0.5, 1.0, 1.5)
    assert (np.einsum("ij,ij->i", outward, closed.normals) > 0).all()
    assert (closed.normals[:, 2] < -0.9).sum() == 2 and (open_box.normals[:, 2] > -0.1).all()


def test_a_disc_covers_its_area_and_is_cut_at_the_edge() -> None:
    canvas = Canvas((2.0, 2.0), np.random.default_rng(0))
    canvas.disc((1.0, 0.5), 0.25, (1.0, 0.0, 0.0), 1.0)
    texels = (SIDE / 2.0) ** 2
    assert canvas.tint.sum() / texels == pytest.approx(np.pi * 0.25**2, rel=0.01)
    assert canvas.rgb[: SIDE // 2].sum() == 0  # y runs upwards: the upper half stays black
    canvas.disc((0.0, 2.0), 0.25, (1.0, 0.0, 0.0), 0.5)
    assert (canvas.tint == 0.5).sum() / texels == pytest.approx(np.pi * 0.25**2 / 4, rel=0.02)
