# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A town of blocks between straight streets. x points east, y north, z up; street level is z = 0.

Street crossings are numbered (column, row) from (0, 0) in the south-west, which is the origin.
An extra ring of blocks surrounds the configured ones, so that every street has two sides.
"""

from collections.abc import Iterator
from functools import lru_cache
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import Section, option
from fusionslam.sim.mesh import Mesh, Side, box, join_meshes, level, paint, panels
from fusionslam.sim.scene import Scene
from fusionslam.sim.town import street_furniture as street
from fusionslam.sim.town.houses import WALL_TINTS, HouseType, house, house_type
from fusionslam.sim.town.textures import Look, town_textures
from fusionslam.sim.world import Part, scene_of

PARKING_M = 2.0
PAVEMENT_M = 2.6
ROAD_M = 11.0
_CURB_M = 0.12
_KINDS = ("row", "villa", "flats", "park")
_PARKED, _BUILT = 1, 0


class TownConfig(Section):
    """A town of street blocks."""

    seed: int = option(3, "decides every house, tree and parked car", ge=0)
    blocks: tuple[int, int] = option((3, 2), "blocks from west to east and from south to north")
    block_m: float = option(56.0, "distance between parallel streets", unit="m", ge=40, le=200)
    house_types: int = option(
        6, "types of house per kind; fewer make streets more alike", ge=1, le=50
    )
    row_houses: float = option(0.40, "share of blocks with terraced houses", ge=0, le=1)
    villas: float = option(0.30, "share of blocks with detached houses and gardens", ge=0, le=1)
    flats: float = option(0.18, "share of blocks with apartment houses", ge=0, le=1)
    parks: float = option(0.12, "share of blocks that are parks", ge=0, le=1)
    street_trees: float = option(0.5, "share of street sides lined with trees", ge=0, le=1)
    parked_cars: float = option(0.30, "share of parking places taken on each lap", ge=0, le=1)


def make_town(config: TownConfig, lap: int = 0) -> Scene:
    """Build the town for one lap: houses and trees stay the same, parked cars differ."""
    parked = [Part("parked car", mesh) for mesh in _parked_cars(config, lap)]
    return scene_of([*_build_blocks(config), *parked], town_textures(config.seed))


@lru_cache(maxsize=2)
def _build_blocks(config: TownConfig) -> tuple[Part, ...]:
    rng = np.random.default_rng([config.seed, _BUILT])
    types = _house_types(config, rng)
    weights = np.array((config.row_houses, config.villas, config.flats, config.parks)) + 1e-9
    parts = [Part("streets", _streets(config, rng), is_ground=True)]
    for corner in _blocks(config):
        kind = str(rng.choice(_KINDS, p=weights / weights.sum()))
        parts.append(Part("floor", _floor(corner, _inside(config), kind), is_ground=True))
        things = _block(config, corner, kind, types.get(kind, []), rng)
        parts.append(Part("block", join_meshes(things)))
    return tuple(parts)


def _house_types(config: TownConfig, rng: np.random.Generator) -> dict[str, list[HouseType]]:
    """The town's house types by kind of block; colours repeat only once all have been used."""
    order = rng.permutation(len(WALL_TINTS))
    colours = cycle([WALL_TINTS[k] for k in order])
    return {
        kind: [house_type(rng, kind, next(colours)) for _ in range(config.house_types)]
        for kind in _KINDS[:3]
    }


def _parked_cars(config: TownConfig, lap: int) -> list[Mesh]:
    """Cars in the parking strips; the configured share of places, varied by side, is taken."""
    rng = np.random.default_rng([config.seed, _PARKED, lap])
    cars = []
    for corner in _blocks(config):
        for side in _sides(corner, _inside(config)):
            taken = config.parked_cars * rng.uniform(0.5, 1.5)
            for along in np.arange(7.0, side.length - 6.0, 6.0):
                if rng.random() < taken:
                    shift, turn = rng.uniform(-0.4, 0.4), np.pi * rng.integers(2)
                    vehicle = street.car(rng).move((0, 0, 0), turn + rng.normal(0, 0.02))
                    cars.append(_place(side, vehicle, along + shift, -0.5 * PARKING_M - 0.05))
    return cars


def _blocks(config: TownConfig) -> Iterator[tuple[float, float]]:
    """South-west corners of all blocks, including the surrounding ring."""
    columns, rows = config.blocks
    for column in range(-1, columns + 1):
        for row in range(-1, rows + 1):
            yield (column * config.block_m + ROAD_M / 2, row * config.block_m + ROAD_M / 2)


def _inside(config: TownConfig) -> float:
    return config.block_m - ROAD_M


def _sides(corner: tuple[float, float], size: float) -> list[Side]:
    x, y = corner
    starts = ((x, y), (x + size, y), (x + size, y + size), (x, y + size))
    return [Side(start, k * np.pi / 2, size) for k, start in enumerate(starts)]


def _place(side: Side, mesh: Mesh, along: float, inward: float, z: float = 0.0) -> Mesh:
    """Place a mesh that faces -y on one side of a block, facing the street."""
    return mesh.move((*side.at(along, inward), z), side.yaw)


def _block(
    config: TownConfig,
    corner: tuple[float, float],
    kind: str,
    types: list[HouseType],
    rng: np.random.Generator,
) -> list[Mesh]:
    size = _inside(config)
    parts = []
    for number, side in enumerate(_sides(corner, size)):
        parts += _street_furniture(config, side, rng)
        if kind == "park":
            parts += _park_edge(side, rng)
        else:
            parts += _house_row(side, kind, types, rng, first=number % 2 == 0)
    parts += _green(corner, size, 22 if kind == "park" else 4, rng)
    return parts


def _floor(corner: tuple[float, float], size: float, kind: str) -> Mesh:
    x, y = corner
    paved = paint(Look.PAVEMENT)
    yard = paint(Look.GRAVEL if kind == "row" else Look.GRASS)
    pavement = box((x, y, 0), (x + size, y + size, _CURB_M), paved)
    low, high = PAVEMENT_M, size - PAVEMENT_M
    z = _CURB_M + 0.02
    inner = box((x + low, y + low, _CURB_M), (x + high, y + high, z), yard)
    return join_meshes([pavement, inner])


def _house_row(
    side: Side, kind: str, types: list[HouseType], rng: np.random.Generator, *, first: bool
) -> list[Mesh]:
    """Houses along one side; sides that are not ``first`` leave the corners free."""
    setback = PAVEMENT_M + {"row": 0.2, "villa": 3.5, "flats": 3.0}[kind]
    gaps = {"row": (0.0, 0.0), "villa": (2.5, 7.0), "flats": (4.0, 9.0)}[kind]
    margin = setback if first else setback + 12.0
    parts, along = [], margin + rng.uniform(0, 1.5)
    while True:
        chosen = types[rng.integers(len(types))]
        if along + chosen.width > side.length - margin:
            break
        back = setback + (rng.uniform(0, 2.5) if kind == "villa" else rng.choice((0.0, 0.4)))
        parts.append(_place(side, house(chosen, rng), along, back, _CURB_M))
        if kind != "row":
            parts += _front_garden(side, along, chosen.width, back, rng)
        along += chosen.width + rng.uniform(*gaps) + (3.0 if rng.random() < 0.12 else 0.0)
    return parts


def _front_garden(
    side: Side, along: float, width: float, back: float, rng: np.random.Generator
) -> list[Mesh]:
    """A hedge, fence or wall with an opening, and a bush or a small tree."""
    parts = []
    border = int(rng.integers(4))
    opening = rng.uniform(0.3, 0.6) * width
    height = rng.uniform(0.7, 1.3)
    kinds = ("hedge", "fence", "wall")
    if border < 3:
        for start, end in ((0.0, opening), (opening + 1.6, width + 1.0)):
            if end - start > 0.5:
                piece = street.border(kinds[border], end - start, height)
                parts.append(_place(side, piece, along + start, PAVEMENT_M + 0.1, _CURB_M))
    if back > PAVEMENT_M + 3 and rng.random() < 0.7:
        plant = street.bush(rng) if rng.random() < 0.6 else street.conifer(rng)
        parts.append(_place(side, plant, along + rng.uniform(0, width), PAVEMENT_M + 1.6, _CURB_M))
    return parts


def _street_furniture(config: TownConfig, side: Side, rng: np.random.Generator) -> list[Mesh]:
    """Lamps, signs and bins at the kerb, and on some sides a line of trees."""
    parts = []
    for along in np.arange(rng.uniform(2, 12), side.length - 2, 22.0):
        parts.append(_place(side, street.lamp(rng), along + rng.uniform(-2, 2), 0.4, _CURB_M))
    for _ in range(int(rng.integers(1, 4))):
        make = street.sign if rng.random() < 0.6 else street.litter_bin
        place = rng.uniform(2, side.length - 2)
        parts.append(_place(side, make(rng), place, rng.uniform(0.35, 0.6), _CURB_M))
    if rng.random() < config.street_trees:
        step = rng.uniform(7, 12)
        for along in np.arange(rng.uniform(4, 9), side.length - 4, step):
            if rng.random() < 0.75:
                place = along + rng.uniform(-1.5, 1.5)
                parts.append(_place(side, street.tree(rng), place, 0.8, _CURB_M))
    return parts


def _park_edge(side: Side, rng: np.random.Generator) -> list[Mesh]:
    parts = []
    if rng.random() < 0.6:
        border = street.border("hedge", side.length - 14, rng.uniform(0.6, 1.1))
        parts.append(_place(side, border, 7.0, PAVEMENT_M + 0.1, _CURB_M))
    for along in rng.uniform(8, side.length - 8, 2):
        parts.append(_place(side, street.bench(), along, PAVEMENT_M + 1.2, _CURB_M))
    return parts


def _green(
    corner: tuple[float, float], size: float, count: int, rng: np.random.Generator
) -> list[Mesh]:
    """Trees and bushes inside a block: many in a park, a few in a courtyard."""
    spread = size / 2 - (PAVEMENT_M + 1.5 if count > 10 else 15.0)
    middle = np.asarray(corner) + size / 2
    make = (street.tree, street.tree, street.conifer, street.bush)
    parts = []
    for _ in range(count):
        x, y = middle + rng.uniform(-1, 1, 2) * max(spread, 2.0)
        parts.append(make[rng.integers(len(make))](rng).move((x, y, _CURB_M)))
    return parts


def _streets(config: TownConfig, rng: np.random.Generator) -> Mesh:
    columns, rows = config.blocks
    half, step = ROAD_M / 2, config.block_m
    parts = [level((-1500.0, -1500.0), (1500.0, 1500.0), -0.05, paint(Look.GRASS))]
    for x, y in np.ndindex(columns + 3, rows + 3):
        centre = np.array((x - 1, y - 1)) * step
        parts.append(_quad(centre, (-half, -half), (half, half), Look.CROSSING, turned=False))
        road = Look.ROAD if rng.random() < 0.6 else Look.PATCHED_ROAD
        parts.append(_quad(centre, (-half, half), (half, step - half), road, turned=False))
        parts.append(_quad(centre, (half, -half), (step - half, half), road, turned=True))
    return join_meshes(parts)


def _quad(
    centre: NDArray[np.float64],
    low: tuple[float, float],
    high: tuple[float, float],
    look: Look,
    *,
    turned: bool,
) -> Mesh:
    """A piece of street; ``turned`` lays the texture along x instead of along y."""
    (x0, y0), (x1, y1) = centre + np.asarray(low), centre + np.asarray(high)
    corners = [(x0, y0, 0.0), (x1, y0, 0.0), (x1, y1, 0.0), (x0, y1, 0.0)]
    return panels([corners[1:] + corners[:1] if turned else corners], paint(look))
