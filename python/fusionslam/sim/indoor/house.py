# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A flat with rooms on both sides of a hall and furniture in many colours.

Bedrooms and studies share the same few pieces of furniture, so some rooms look alike.
"""

from itertools import cycle, islice, pairwise

import numpy as np

from fusionslam.config import Section, option
from fusionslam.errors import ConfigError
from fusionslam.sim.indoor import furniture
from fusionslam.sim.indoor.furnishing import Furnisher
from fusionslam.sim.indoor.furniture import CLOTHS, WOODS, Style
from fusionslam.sim.indoor.layout import Layout
from fusionslam.sim.indoor.objects import Site
from fusionslam.sim.indoor.rooms import Opening, Room, build_room, sides, window
from fusionslam.sim.indoor.textures import WHITE, Look
from fusionslam.sim.mesh import Rgb, paint
from fusionslam.sim.world import World

_HEIGHT_M = 2.7
_HALL_M = 1.8
_ROOM_M = (2.4, 30.0)
_KINDS = ("living", "kitchen", "bedroom", "study", "bedroom", "bathroom", "playroom")
# Relative width of a room (others: 1).
_SHARE = {"living": 1.5, "kitchen": 1.1, "bathroom": 0.85}
_WALLS: tuple[Rgb, ...] = (
    (0.96, 0.92, 0.82),
    (0.74, 0.84, 0.92),
    (0.80, 0.90, 0.76),
    (0.96, 0.78, 0.70),
    (0.98, 0.88, 0.56),
    (0.86, 0.78, 0.90),
    (0.90, 0.90, 0.90),
    (0.62, 0.78, 0.76),
)


class HouseConfig(Section):
    """Settings of the furnished flat."""

    seed: int = option(3, "decides rooms, colours and furniture", ge=0)
    size_m: tuple[float, float] = option((16.0, 11.0), "extent along x and y", unit="m")
    rooms: int = option(7, "number of rooms beside the hall", ge=2, le=12)
    clutter: float = option(0.7, "share of the small objects that are present", ge=0, le=1)


def house_rooms(config: HouseConfig) -> tuple[list[Room], list[Opening]]:
    """The rooms, the hall first, and the passages between them.

    Raises:
        ConfigError: rooms would be smaller than 2.4 m or larger than 30 m.
    """
    rng = np.random.default_rng([config.seed, 0x40])
    kinds = [str(kind) for kind in rng.permutation(list(islice(cycle(_KINDS), config.rooms)))]
    width, depth = config.size_m
    north = (config.rooms + 1) // 2
    middle = float(rng.uniform(-0.5, 0.5))
    low, high = middle - _HALL_M / 2, middle + _HALL_M / 2
    # kitchen_1, bedroom_1, bedroom_2, ...
    names = [f"{kind}_{kinds[: k + 1].count(kind)}" for k, kind in enumerate(kinds)]
    rooms = [_room("hall", (-width / 2, low), (width / 2, high), rng)]
    for chosen, bottom, top in ((names[:north], high, depth / 2), (names[north:], -depth / 2, low)):
        edges = _edges(chosen, width, rng)
        rooms += [
            _room(name, (x0, bottom), (x1, top), rng)
            for name, x0, x1 in zip(chosen, edges[:-1], edges[1:], strict=True)
        ]
    _check_sizes(rooms, config)
    return rooms, _openings(rooms, rng)


def make_house(config: HouseConfig) -> World:
    """Build the house with visual and collision scene."""
    rooms, openings = house_rooms(config)
    site = Site()
    for number, room in enumerate(rooms):
        rng = np.random.default_rng([config.seed, 0x41, number])
        build_room(site, room, openings, _HEIGHT_M)
        layout = Layout(site, room, openings, rng)
        _put_windows(layout, room, config, rng)
        Furnisher(layout, Style.draw(rng), config.clutter, rng).also(_kind(room.name))
    return site.world("house", config.seed, rooms[0].centre)


def _kind(name: str) -> str:
    return name.split("_")[0]


def _edges(names: list[str], width: float, rng: np.random.Generator) -> list[float]:
    """x of the walls of one row of rooms, outer walls included."""
    shares = np.array([_SHARE.get(_kind(name), 1.0) for name in names])
    shares *= rng.uniform(0.9, 1.1, len(shares))
    inner = -width / 2 + width * np.cumsum(shares)[:-1] / shares.sum()
    return [-width / 2, *(float(edge) for edge in inner), width / 2]


def _room(
    name: str, low: tuple[float, float], high: tuple[float, float], rng: np.random.Generator
) -> Room:
    """A room: tiles in kitchen and bathroom, wood or carpet elsewhere; random wall colour."""
    wall = paint(
        (Look.PLASTER, Look.PLASTER, Look.STRIPES, Look.FLOWERS)[rng.integers(4)],
        _WALLS[rng.integers(len(_WALLS))],
    )
    wood = WOODS[rng.integers(4)]
    floor = paint((Look.PLANKS, Look.PARQUET)[rng.integers(2)], wood)
    if _kind(name) in ("kitchen", "bathroom"):
        floor = paint(Look.TILES, ((0.9, 0.86, 0.8), (0.62, 0.64, 0.68))[rng.integers(2)])
        wall = paint(Look.TILES if _kind(name) == "bathroom" else Look.PLASTER, wall.tint)
    elif rng.random() < 0.25:
        floor = paint(Look.CARPET, CLOTHS[rng.integers(len(CLOTHS))])
    return Room(name, low, high, wall, floor, paint(Look.WOOD, WHITE))


def _check_sizes(rooms: list[Room], config: HouseConfig) -> None:
    """Raise ConfigError if a room is too small for a robot to turn in, or too large."""
    smallest = [_HALL_M] + [_ROOM_M[0]] * (len(rooms) - 1)
    for room, least in zip(rooms, smallest, strict=True):
        size = np.subtract(room.high, room.low)
        # The hall's breadth is computed from its walls: allow for rounding.
        if not (least - 1e-9 <= size.min() and size.max() <= _ROOM_M[1]):
            raise ConfigError(
                f"house.size_m is {config.size_m} and house.rooms {config.rooms}, which makes "
                f"{room.name} {size[0]:.1f} m by {size[1]:.1f} m; expected rooms of "
                f"{_ROOM_M[0]} to {_ROOM_M[1]} m",
                code="room-size",
                fields=(room.name,),
            )


def _openings(rooms: list[Room], rng: np.random.Generator) -> list[Opening]:
    """Every room opens to the hall; some neighbours, but no bathrooms, open to each other too."""
    hall, *others = rooms
    found = []
    for room in others:
        leaf_tint = WOODS[rng.integers(len(WOODS))]
        y = hall.high[1] if room.low[1] >= hall.high[1] else hall.low[1]
        reach = (room.high[0] - room.low[0]) / 2 - 0.75
        x = room.centre[0] + float(rng.uniform(-1, 1)) * min(reach, 1.0)
        wide = _kind(room.name) == "living"
        leaf_in = room.name if not wide and rng.random() < 0.8 else ""
        hinge = int(rng.choice((-1, 1)))
        found.append(Opening(x, y, 1.5 if wide else 0.95, leaf_in, leaf_tint, hinge))
    for first, second in pairwise(others):
        shared = first.high[0] == second.low[0]
        private = "bathroom" in (_kind(first.name), _kind(second.name))
        if shared and not private and rng.random() < 0.6:
            y = first.centre[1] + float(rng.uniform(-0.8, 0.8))
            found.append(Opening(first.high[0], y, 0.95, "", WHITE))
    return found


def _put_windows(layout: Layout, room: Room, config: HouseConfig, rng: np.random.Generator) -> None:
    """Put a window in each outer wall that is long enough, most of them with curtains."""
    edges = np.abs(config.size_m) / 2
    tint = CLOTHS[rng.integers(len(CLOTHS))]
    for number, side in enumerate(sides(room)):
        at = np.abs(side.at(side.length / 2, 0.0))
        if side.length > 2.2 and np.isclose(at, edges).any():
            width = float(rng.choice((1.2, 1.6, 2.0))) if side.length > 3 else 1.0
            if layout.on_wall(window(width, 1.2), 0.9, number) and rng.random() < 0.6:
                layout.over_last(furniture.curtains(tint, width + 0.45, 2.1), 0.15)
