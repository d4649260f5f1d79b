# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A hospital: two long corridors joined at their ends, wards outside, offices and stores between.

The wards south of one corridor and north of the other share one plan, rotated by 180 degrees;
they differ by a curtain, a blanket, a chair, a picture. A waiting room in the middle joins the
corridors.
"""

from collections.abc import Callable, Mapping

import numpy as np

from fusionslam.config import Section, option
from fusionslam.sim.indoor import furniture
from fusionslam.sim.indoor.furnishing import Furnisher
from fusionslam.sim.indoor.furniture import CLOTHS, Style, make_piece
from fusionslam.sim.indoor.layout import Layout
from fusionslam.sim.indoor.objects import Site, Thing
from fusionslam.sim.indoor.rooms import (
    WALL_M,
    Opening,
    Room,
    build_room,
    openings_of,
    sides,
    spans,
    window,
)
from fusionslam.sim.indoor.textures import GREY, WHITE, Look
from fusionslam.sim.mesh import Rgb, paint
from fusionslam.sim.world import World

_HEIGHT_M = 2.8
_WARD_M = 5.0
_CORRIDOR_M = 2.4
_CORE_M = 4.4
_DOOR_M = 1.15
_PASSAGE_M = 1.9
_DOOR_TINT = furniture.PALETTE["OAK"]
_CURTAINS: tuple[Rgb, ...] = ((0.62, 0.80, 0.84), (0.74, 0.84, 0.62), (0.92, 0.80, 0.60))
_BLANKETS: tuple[Rgb, ...] = ((0.66, 0.78, 0.88), (0.90, 0.82, 0.62), (0.70, 0.84, 0.72))
_STRIPES: Mapping[str, Rgb] = {
    "south": (0.24, 0.44, 0.70),
    "north": (0.28, 0.58, 0.46),
    "west": (0.84, 0.62, 0.22),
    "east": (0.66, 0.34, 0.52),
}
_CORE_KINDS = ("office", "store", "treatment", "office", "treatment", "store")


class HospitalConfig(Section):
    """Settings of the hospital."""

    seed: int = option(3, "decides the kinds of the core rooms and the movable objects", ge=0)
    wards: int = option(7, "wards along each corridor, 5 m each", ge=4, le=24)
    clutter: float = option(0.5, "share of the movable objects that are present", ge=0, le=1)


def hospital_rooms(config: HospitalConfig) -> tuple[list[Room], list[Opening]]:
    """Corridors, wards and core rooms, and the passages between them."""
    rng = np.random.default_rng([config.seed, 0x48])
    half = config.wards * _WARD_M / 2
    inner, outer = _CORE_M / 2, _CORE_M / 2 + _CORRIDOR_M
    end = half - _CORRIDOR_M
    rooms = [
        _corridor("south", (-half, -outer), (half, -inner)),
        _corridor("north", (-half, inner), (half, outer)),
        _corridor("west", (-half, -inner), (-end, inner)),
        _corridor("east", (end, -inner), (half, inner)),
    ]
    openings = [
        Opening(x, y, _PASSAGE_M)
        for x in (-half + _CORRIDOR_M / 2, half - _CORRIDOR_M / 2)
        for y in (-inner, inner)
    ]
    for room, opening in _wards(config, half, outer):
        rooms.append(room)
        openings.append(opening)
    for room, found in _core(end, inner, rng):
        rooms.append(room)
        openings += found
    return rooms, openings


def make_hospital(config: HospitalConfig) -> World:
    """Build the hospital with visual and collision scene."""
    rooms, openings = hospital_rooms(config)
    site = Site()
    for number, room in enumerate(rooms):
        rng = np.random.default_rng([config.seed, 0x49, number])
        build_room(site, room, openings, _HEIGHT_M)
        if room.name.startswith("ward"):
            _furnish_ward(site, room, config.clutter, rng)
            continue
        layout = Layout(site, room, openings, rng)
        if room.name.startswith("corridor"):
            _furnish_corridor(site, layout, room, openings, config.clutter, rng)
        else:
            kind = room.name.split("_")[0]
            cloth = WHITE if kind == "store" else CLOTHS[rng.integers(len(CLOTHS))]
            style = Style(GREY, cloth, cloth)
            if kind == "office":
                style = Style(_DOOR_TINT, cloth, GREY)
            Furnisher(layout, style, config.clutter, rng).also(kind)
    return site.world("hospital", config.seed, rooms[0].centre)


def _corridor(name: str, low: tuple[float, float], high: tuple[float, float]) -> Room:
    return _room(f"corridor_{name}", low, high, (0.78, 0.82, 0.80), _STRIPES[name])


def _room(
    name: str,
    low: tuple[float, float],
    high: tuple[float, float],
    floor: Rgb = (0.74, 0.80, 0.84),
    skirting: Rgb = GREY,
) -> Room:
    wall = paint(Look.PLASTER, (0.96, 0.96, 0.92))
    return Room(name, low, high, wall, paint(Look.LINOLEUM, floor), paint(Look.PLAIN, skirting))


def _wards(config: HospitalConfig, half: float, outer: float) -> list[tuple[Room, Opening]]:
    """The southern row of wards, then the northern one, each with a door to its corridor."""
    found = []
    for row, turn in (("south", 1.0), ("north", -1.0)):
        for number in range(config.wards):
            x = -half + (number + 0.5) * _WARD_M
            ys = sorted((-turn * outer, -turn * (outer + _WARD_M)))
            name = f"ward_{row}_{number + 1}"
            room = _room(name, (x - _WARD_M / 2, ys[0]), (x + _WARD_M / 2, ys[1]))
            door = Opening(x + turn * 1.2, -turn * outer, _DOOR_M, name, _DOOR_TINT, -1)
            found.append((room, door))
    return found


def _core(end: float, inner: float, rng: np.random.Generator) -> list[tuple[Room, list[Opening]]]:
    """An odd number of rooms between the corridors; the middle one has doors to both."""
    count = 2 * round((2 * end / 4.5 - 1) / 2) + 1
    width = 2 * end / count
    kinds = [str(kind) for kind in rng.permutation(np.resize(_CORE_KINDS, count))]
    kinds[count // 2] = "waiting"
    found = []
    for number, kind in enumerate(kinds):
        name = f"{kind}_{kinds[: number + 1].count(kind)}"
        low = -end + number * width
        room = _room(name, (low, -inner), (low + width, inner))
        x = room.centre[0]
        if kind == "waiting":
            doors = [Opening(x, y, _PASSAGE_M) for y in (-inner, inner)]
        else:
            y = inner if number % 2 else -inner
            doors = [Opening(x + 0.8, y, _DOOR_M, name, _DOOR_TINT, int(np.sign(-y)))]
        found.append((room, doors))
    return found


def _furnish_ward(site: Site, room: Room, clutter: float, rng: np.random.Generator) -> None:
    """Put two beds with their heads to one wall; the door is at +y in the ward's own frame."""
    turn = 1.0 if room.name.startswith("ward_south") else -1.0
    yaw0 = 0.0 if turn > 0 else np.pi

    def put(item: Thing, x: float, y: float, yaw: float, z: float = 0.0) -> None:
        site.put(item, room.centre[0] + turn * x, room.centre[1] + turn * y, yaw0 + yaw, z)

    wall = _WARD_M / 2 - WALL_M / 2
    tint = _CURTAINS[rng.integers(len(_CURTAINS))]
    for y in (-1.35, 0.95):
        blanket = _BLANKETS[rng.integers(len(_BLANKETS))]
        put(make_piece("sickbed", tint=blanket), -wall + 1.1, y, np.pi / 2)
        put(make_piece("bedside_cabinet", tint=_DOOR_TINT), -wall + 0.26, y + 0.75, np.pi / 2)
        if rng.random() < clutter:
            put(make_piece("drip_stand"), -wall + rng.uniform(0.9, 1.6), y - 0.82, 0.0)
    put(furniture.bed_curtain(tint, float(rng.uniform(0.4, 1.6))), -wall + 1.15, -0.15, 0.0)
    put(window(2.2, 1.3), 0.0, -wall, np.pi, 0.95)
    put(make_piece("radiator"), 0.9, -wall + 0.08, np.pi)
    put(make_piece("washbasin"), -1.5, wall - 0.23, 0.0)
    put(make_piece("locker", Style(WHITE, WHITE, WHITE)), wall - 0.28, -0.9, -np.pi / 2)
    pail = make_piece("bin", tint=CLOTHS[rng.integers(len(CLOTHS))])
    put(pail, wall - 0.2, rng.uniform(-0.05, 1.0), 0.0)
    put(furniture.picture(int(rng.integers(16)), 0.6, 0.45), wall, 0.6, -np.pi / 2, 1.2)
    if rng.random() < clutter:
        seat = make_piece("chair", Style(GREY, CLOTHS[rng.integers(len(CLOTHS))], WHITE))
        put(seat, rng.uniform(0.9, 1.5), -wall + 0.45, np.pi)
    if rng.random() < 0.5 * clutter:
        put(furniture.plant(rng), wall - 0.35, -wall + 0.35, 0.0)


def _furnish_corridor(
    site: Site,
    layout: Layout,
    room: Room,
    openings: list[Opening],
    clutter: float,
    rng: np.random.Generator,
) -> None:
    """Put rails and room numbers on both sides, and benches and trolleys at random places."""
    tint = _STRIPES[room.name.split("_")[1]]
    number = int(rng.integers(16))
    for side in sides(room):
        found = openings_of(side, openings)
        for start, end in spans(side.length, found):
            if end - start > 0.8:
                x, y = side.at((start + end) / 2, WALL_M / 2)
                site.put(furniture.handrail(end - start - 0.4, tint), x, y, side.yaw + np.pi)
        for along, opening in found:
            if opening.leaf_in:
                x, y = side.at(along + opening.width / 2 + 0.25, WALL_M / 2)
                site.put(
                    make_piece("number", tint=tint, number=number), x, y, side.yaw + np.pi, 1.35
                )
                number += 1
    long = max(np.subtract(room.high, room.low))
    for _ in range(round(long / 3.5)):
        if rng.random() < clutter:
            layout.along_wall(_corridor_thing(rng))
    layout.along_wall(make_piece("extinguisher"))
    for _ in range(max(1, round(long / 9))):
        layout.on_wall(furniture.picture(int(rng.integers(16)), 0.9, 0.7), 1.25)


def _corridor_thing(rng: np.random.Generator) -> Thing:
    tint = CLOTHS[rng.integers(len(CLOTHS))]
    makers: tuple[Callable[[], Thing], ...] = (
        lambda: make_piece("bench.three_seats", tint=_STRIPES["south"]),
        lambda: make_piece("bench.two_seats", tint=_STRIPES["south"]),
        lambda: make_piece("trolley", tint=tint),
        lambda: furniture.plant(rng),
        lambda: make_piece("bin", tint=tint),
    )
    return makers[rng.integers(len(makers))]()
