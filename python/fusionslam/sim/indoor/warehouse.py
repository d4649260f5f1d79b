# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A hall of pallet racks with equal aisles, loading bays along one wall and a packing corner.

Racks are built from a few types of bay, so the same shelf with the same load appears in many
places; goods on the floor, gates and signs distinguish these places.
"""

from dataclasses import dataclass

import numpy as np

from fusionslam.config import Section, option
from fusionslam.sim.indoor import warehouse_furniture as furniture
from fusionslam.sim.indoor.furniture import CLOTHS, make_piece
from fusionslam.sim.indoor.layout import Layout
from fusionslam.sim.indoor.objects import Site
from fusionslam.sim.indoor.rooms import Room, build_room, window
from fusionslam.sim.indoor.textures import GREY, Look
from fusionslam.sim.mesh import paint
from fusionslam.sim.world import World

_HEIGHT_M = 4.5
_YARD_M = 7.0
# Distance from the gates to the centre of the lane along the marked bays.
_LANE_M = 2.9
_CROSS_M = 2.6
# Least aisle width at which goods of 0.8 m beside a rack leave the middle free.
_SPACIOUS_M = 2.3
_YELLOW = (0.95, 0.80, 0.15)


class WarehouseConfig(Section):
    """Settings of the warehouse."""

    seed: int = option(3, "decides loads, signs and movable objects", ge=0)
    rows: int = option(5, "rows of racks; one aisle more than rows", ge=1, le=12)
    bays: int = option(4, "bays of 2.7 m in a row", ge=2, le=12)
    aisle_m: float = option(2.4, "width of an aisle", unit="m", ge=1.2, le=5.0)
    bay_types: int = option(4, "types of loaded bay; fewer make aisles more alike", ge=1, le=20)
    fill: float = option(0.8, "share of pallet places taken", ge=0, le=1)
    clutter: float = option(0.6, "share of the places on the floor where goods stand", ge=0, le=1)


@dataclass(frozen=True)
class _Plan:
    """Floor plan in metres: rows of racks run along y, the yard with the gates is at low y."""

    width: float
    depth: float
    row_x: tuple[float, ...]
    aisle_x: tuple[float, ...]
    bay_y: tuple[float, ...]
    cross_y: tuple[float, ...]
    yard_y: float


def _plan(config: WarehouseConfig) -> _Plan:
    pitch = furniture.DEPTH_M + config.aisle_m
    width = config.rows * pitch + config.aisle_m + 0.4
    first = -width / 2 + 0.2
    rows = tuple(
        first + config.aisle_m + furniture.DEPTH_M / 2 + k * pitch for k in range(config.rows)
    )
    aisles = tuple(first + config.aisle_m / 2 + k * pitch for k in range(config.rows + 1))
    depth = _YARD_M + config.bays * furniture.BAY_M + 2 * _CROSS_M
    start, half = -depth / 2 + _YARD_M, config.bays // 2
    gaps = [0.0 if k < half else _CROSS_M for k in range(config.bays)]
    bays = tuple(start + (k + 0.5) * furniture.BAY_M + gap for k, gap in enumerate(gaps))
    cross = (start + half * furniture.BAY_M + _CROSS_M / 2, depth / 2 - _CROSS_M / 2)
    return _Plan(width, depth, rows, aisles, bays, cross, -depth / 2 + _LANE_M)


def warehouse_places(config: WarehouseConfig) -> dict[str, tuple[float, float]]:
    """x, y of a free point near both ends of each aisle, in each cross aisle and in the yard."""
    plan = _plan(config)
    places = {"yard": (0.0, plan.yard_y)}
    for number, x in enumerate(plan.aisle_x, 1):
        places[f"aisle_{number}_south"] = (x, plan.bay_y[0])
        places[f"aisle_{number}_north"] = (x, plan.bay_y[-1])
    for number, y in enumerate(plan.cross_y, 1):
        places[f"cross_aisle_{number}"] = (0.0, y)
    return places


def make_warehouse(config: WarehouseConfig) -> World:
    """Build the warehouse with visual and collision scene."""
    rng = np.random.default_rng([config.seed, 0x57])
    plan, site = _plan(config), Site()
    high = (plan.width / 2, plan.depth / 2)
    wall = paint(Look.CORRUGATED, (0.80, 0.86, 0.92))
    floor, skirting = paint(Look.CONCRETE), paint(Look.PLASTER, GREY)
    hall = Room("hall", (-high[0], -high[1]), high, wall, floor, skirting)
    build_room(site, hall, (), _HEIGHT_M)
    _put_racks(site, plan, config, rng)
    _put_yard(site, plan, config, rng)
    _put_goods(site, plan, config, rng)
    layout = Layout(site, hall, (), rng)
    for number in (1, 3):
        for _ in range(3):
            layout.on_wall(window(2.0, 1.0), 2.6, number)
    return site.world("warehouse", config.seed, (0.0, plan.yard_y))


def _put_racks(site: Site, plan: _Plan, config: WarehouseConfig, rng: np.random.Generator) -> None:
    """Put rows of racks that repeat a few patterns of a few types of bay."""
    types = [furniture.rack_bay(rng, config.fill) for _ in range(config.bay_types)]
    patterns = rng.integers(len(types), size=((config.rows + 1) // 2, config.bays))
    for number, x in enumerate(plan.row_x):
        for kind, y in zip(patterns[rng.integers(len(patterns))], plan.bay_y, strict=True):
            site.put(types[kind], x, y, np.pi / 2)
        ends = (plan.bay_y[0] - furniture.BAY_M / 2, plan.bay_y[-1] + furniture.BAY_M / 2)
        for y, yaw in ((ends[0], 0.0), (ends[1], np.pi)):
            outward = -np.cos(yaw)
            site.put(make_piece("guard_rail"), x, y + 0.2 * outward)
            site.put(make_piece("sign", number=number), x, y, yaw, z=1.6)


def _put_yard(site: Site, plan: _Plan, config: WarehouseConfig, rng: np.random.Generator) -> None:
    """Put gates with marked bays in front, a fork-lift, columns and stacks of empty pallets."""
    south = -plan.depth / 2
    count = max(1, int(plan.width // 4.6))
    for number in range(count):
        x = (number + 0.5) * plan.width / count - plan.width / 2
        site.put(make_piece("gate", number=number), x, south + 0.08, np.pi)
        tint = _YELLOW if number % 2 else (0.92, 0.92, 0.92)
        site.put(furniture.marking(3.0, 2.2, tint), x, south + 1.45)
        for u, v in ((-0.7, 0.9), (0.7, 0.9), (-0.7, 1.95), (0.7, 1.95)):
            if rng.random() < config.clutter:
                # Nearly square, as a fork-lift driver does.
                goods = furniture.loaded_pallet(rng)
                site.put(goods, x + u, south + v, float(rng.normal(0, 0.03)))
        if number and rng.random() < config.clutter:
            between = x - plan.width / count / 2
            site.put(furniture.pallet_stack(rng), between, south + 1.0, np.pi / 2)
    start = plan.bay_y[0] - furniture.BAY_M / 2
    parked = int(rng.integers(len(plan.row_x)))
    for number, x in enumerate(plan.row_x):
        if number == parked:
            tint = CLOTHS[rng.integers(len(CLOTHS))]
            site.put(make_piece("forklift", tint=tint), x, start - 1.8, -np.pi / 2)
        elif number % 2:
            site.put(make_piece("column"), x, start - 0.7)


def _put_goods(site: Site, plan: _Plan, config: WarehouseConfig, rng: np.random.Generator) -> None:
    """Put cages and pallets beside the racks if the aisle stays wide enough, benches at the end."""
    if config.aisle_m >= _SPACIOUS_M:
        for x in plan.aisle_x:
            for y in plan.bay_y:
                if rng.random() < 0.35 * config.clutter:
                    make = (furniture.cage, furniture.loaded_pallet, furniture.pallet_stack)[
                        rng.integers(3)
                    ]
                    goods = make(rng)
                    shift = config.aisle_m / 2 - goods.size[1] / 2 - 0.06
                    side = float(rng.choice((-1, 1)))
                    site.put(goods, x + side * shift, y + rng.uniform(-0.6, 0.6), np.pi / 2)
    for x in plan.row_x:
        if rng.random() < config.clutter:
            site.put(
                make_piece("workbench", tint=CLOTHS[rng.integers(len(CLOTHS))]),
                x,
                plan.depth / 2 - 0.52,
            )
