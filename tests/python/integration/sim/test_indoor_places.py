# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Indoor worlds are hard and fair: places repeat, all can be reached, some things are unique."""

import itertools
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("embreex", reason="the simulator is an extra")

from benchmarks.accuracy.indoor import aisles_unlike, directions, ward_yaws, wards_unlike
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
from fusionslam.sim.indoor.home_furniture import table
from fusionslam.sim.indoor.layout import Layout
from fusionslam.sim.indoor.objects import Site
from fusionslam.sim.indoor.rooms import Opening, Room
from fusionslam.sim.indoor.textures import WHITE, Look, cut
from fusionslam.sim.mesh import paint
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.world import World

HOSPITAL = HospitalConfig()
WAREHOUSE = WarehouseConfig()


@pytest.fixture(scope="module")
def hospital() -> World:
    return make_indoor(HOSPITAL)


@pytest.fixture(scope="module")
def warehouse() -> World:
    return make_indoor(WAREHOUSE)


@cache
def make_seeded(name: str, seed: int) -> World:
    return make_indoor(INDOOR_WORLDS[name].config(seed=seed))


@pytest.mark.parametrize("name", tuple(INDOOR_WORLDS))
@pytest.mark.parametrize("seed", [0, 1])
def test_a_robot_reaches_every_room_and_aisle(name: str, seed: int) -> None:
    room = make_seeded(name, seed).map
    assert room is not None
    free = room.inflate(0.25)
    places = indoor_places(INDOOR_WORLDS[name].config(seed=seed))
    assert [key for key, place in places.items() if not free.is_free(*place)] == []


@pytest.mark.parametrize("name", tuple(INDOOR_WORLDS))
@pytest.mark.parametrize("seed", [0, 1])
def test_nothing_reaches_through_the_outer_walls(name: str, seed: int) -> None:
    scene = make_seeded(name, seed).visual
    floor = np.array([part.startswith("floor") for part in scene.names])[scene.part]
    edges = scene.mesh.triangles[floor].reshape(-1, 3)
    corners = scene.mesh.triangles.reshape(-1, 3)
    assert (corners[:, :2] >= edges[:, :2].min(axis=0) - 1e-4).all()
    assert (corners[:, :2] <= edges[:, :2].max(axis=0) + 1e-4).all()
    assert corners[:, 2].min() >= -1e-5


def test_wards_on_both_sides_of_the_corridors_look_alike_to_a_lidar(hospital: World) -> None:
    assert len(ward_yaws(HOSPITAL)) == 2 * HOSPITAL.wards
    among, apart = wards_unlike(hospital, HOSPITAL)
    assert np.median(among) < 0.1 and max(among) < 0.25
    assert min(apart) > 2 * max(among)


def test_no_two_wards_are_the_same_to_lidar_and_camera_together(hospital: World) -> None:
    caster = RayCaster(hospital.visual)
    seen = []
    for name, yaw in ward_yaws(HOSPITAL).items():
        rays = directions(yaw)
        hits = caster.cast(np.array((*indoor_places(HOSPITAL)[name], 0.3), np.float32), rays)
        # Without light: wards on the two sides are lit from other directions.
        seen.append(caster.brightness(hits))
    for first, second in itertools.combinations(seen, 2):
        assert np.mean(np.abs(first - second) > 0.05) > 0.02


def test_aisles_of_the_warehouse_repeat(warehouse: World) -> None:
    south, yard = aisles_unlike(warehouse, WAREHOUSE)
    assert min(south) < 0.35
    assert np.median(south) < 0.75 * np.median(yard)


def test_racks_repeat_few_types_of_bay(warehouse: World) -> None:
    scene = warehouse.visual
    racks = [k for k, name in enumerate(scene.names) if name.startswith("shelf")]
    assert len(racks) == WAREHOUSE.rows * WAREHOUSE.bays
    shapes = set()
    for rack in racks:
        # Where a rack stands changes its corners only.
        of_rack = scene.part == rack
        shapes.add(scene.mesh.uv[of_rack].tobytes() + scene.mesh.tint[of_rack].tobytes())
    assert 2 <= len(shapes) <= WAREHOUSE.bay_types


@pytest.mark.parametrize("seed", [0, 1])
def test_each_room_of_a_house_has_the_furniture_that_makes_it_one(seed: int) -> None:
    names = make_seeded("house", seed).visual.names

    def count(kind: str) -> int:
        return sum(name.startswith(kind) for name in names)

    assert count("bed_") == count("floor_bedroom") + count("floor_playroom") > 0
    assert count("kitchen_counter") >= count("floor_kitchen") > 0
    assert count("bathtub") == count("toilet") == count("floor_bathroom") > 0
    assert count("sofa") == count("television") == count("floor_living") > 0
    assert count("workplace") == count("floor_study") > 0


def test_rooms_of_a_house_repeat_furniture_in_other_colours() -> None:
    world = make_indoor(HouseConfig(seed=3))
    beds = [k for k, name in enumerate(world.visual.names) if name.startswith("bed_")]
    assert len(beds) >= 2
    tints = [
        {tuple(row) for row in np.round(world.visual.mesh.tint[world.visual.part == k], 2).tolist()}
        for k in beds
    ]
    assert tints[0] != tints[1]


def test_a_house_has_many_colours() -> None:
    world = make_indoor(HouseConfig(seed=3))
    caster = RayCaster(world.visual)
    hues = []
    for place in indoor_places(HouseConfig(seed=3)).values():
        rays = directions()
        hits = caster.cast(np.array((*place, 0.5), np.float32), rays)
        rgb = caster.colors(hits, rays, 0.002)
        colourful = np.ptp(rgb, axis=1) > 0.15
        hues.append(np.argsort(rgb[colourful], axis=1)[:, ::-1])
    orders, counts = np.unique(np.concatenate(hues), axis=0, return_counts=True)
    assert len(orders) == 6  # every order of red, green and blue
    assert (counts > 5).all()


def room_with_door(leaf_in: str = "") -> tuple[Room, Opening]:
    room = Room("cell", (0, 0), (4, 4), paint(Look.PLAIN), paint(Look.PLAIN), paint(Look.PLAIN))
    return room, Opening(1.0, 0.0, 0.95, leaf_in)


def test_nothing_is_put_between_a_door_and_the_middle_of_a_room() -> None:
    room, door = room_with_door()
    style = Style(WOODS[0], WHITE, WHITE)
    for seed in range(5):
        site = Site()
        layout = Layout(site, room, [door], np.random.default_rng(seed))
        while layout.along_wall(table(style, 1.0, 0.6)):
            pass
        while layout.anywhere(make_piece("chair", style)):
            pass
        world = site.world("cell", 0, room.centre)
        assert world.map is not None
        # Without walls the whole map's margin is free: look along the lane itself.
        steps = np.linspace(0.3, 2.0, 30)
        free = world.map.inflate(0.22)
        assert free.is_free(np.ones(30), steps).all()
        assert free.is_free(np.linspace(1.0, 2.0, 30), np.full(30, 2.0)).all()


def test_things_in_a_room_do_not_stand_in_each_other() -> None:
    room, door = room_with_door()
    style = Style(WOODS[0], WHITE, WHITE)
    site = Site()
    layout = Layout(site, room, [door], np.random.default_rng(1))
    while layout.along_wall(table(style, 1.0, 0.6)):
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
    room, door = room_with_door()
    site = Site()
    layout = Layout(site, room, [door], np.random.default_rng(0))
    style = Style(WOODS[0], WHITE, WHITE)
    assert not layout.along_wall(table(style, 5.0, 0.6))
    assert not layout.anywhere(table(style, 5.0, 5.0))


def test_each_print_of_a_sheet_is_addressed_by_its_number() -> None:
    assert cut(Look.LABELS, 0, 0.2, 0.3).offset == (0.0, 0.0)
    assert cut(Look.LABELS, 5, 0.2, 0.3).offset == (0.25, 0.25)
    assert cut(Look.LABELS, 16, 0.2, 0.3) == cut(Look.LABELS, 0, 0.2, 0.3)
    assert cut(Look.LABELS, 1, 0.2, 0.3).extent == pytest.approx((0.8, 1.2))


def test_every_piece_of_the_furniture_table_can_be_built() -> None:
    table = yaml.safe_load(Path(furniture.__file__).with_suffix(".yaml").read_text())
    style = Style(WOODS[0], WHITE, WHITE)
    options = {"mirror", "around", "sides", "along", "texture", "fit", "tint", "hit", "seen"}
    for kind, rows in table.items():
        for row in rows:
            assert len(row.keys() - options) == 1, (kind, row)  # a shape, and no misspelt option
        piece = make_piece(kind, style)
        assert piece.kind == kind and len(piece.visual) > 0
        assert piece.collision is not None
        low, high = (getattr(piece.visual.triangles, end)(axis=(0, 1)) for end in ("min", "max"))
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
