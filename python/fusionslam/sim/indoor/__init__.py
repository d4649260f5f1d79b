# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Three procedural indoor worlds: a warehouse, a house and a hospital.

>>> from fusionslam.sim.indoor import HouseConfig, make_indoor
>>> world = make_indoor(HouseConfig(seed=7))
>>> world.name
'house'
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fusionslam.sim.indoor.hospital import HospitalConfig, hospital_rooms, make_hospital
from fusionslam.sim.indoor.house import HouseConfig, house_rooms, make_house
from fusionslam.sim.indoor.rooms import Room
from fusionslam.sim.indoor.warehouse import WarehouseConfig, make_warehouse, warehouse_places
from fusionslam.sim.world import World

IndoorConfig = WarehouseConfig | HouseConfig | HospitalConfig


@dataclass(frozen=True)
class IndoorWorld:
    """Configuration class and functions of one indoor world.

    Attributes:
        config: its configuration section; ``config()`` is the default world.
        make: builds the world of a configuration.
        places: free points of a configuration, x and y in metres, by name of room or aisle.
    """

    config: type[IndoorConfig]
    make: Callable[[Any], World]
    places: Callable[[Any], dict[str, tuple[float, float]]]


def _centres(rooms: Sequence[Room], openings: object) -> dict[str, tuple[float, float]]:
    """x, y in metres of the centre of each room, where the floor is free."""
    return {room.name: room.centre for room in rooms}


INDOOR_WORLDS: Mapping[str, IndoorWorld] = {
    "warehouse": IndoorWorld(WarehouseConfig, make_warehouse, warehouse_places),
    "house": IndoorWorld(HouseConfig, make_house, lambda config: _centres(*house_rooms(config))),
    "hospital": IndoorWorld(
        HospitalConfig, make_hospital, lambda config: _centres(*hospital_rooms(config))
    ),
}


def make_indoor(config: IndoorConfig) -> World:
    """Build the world of a configuration; the same configuration gives the same bytes.

    Raises:
        ConfigError: the rooms would be too small or too large.
    """
    return _entry(config).make(config)


def indoor_places(config: IndoorConfig) -> dict[str, tuple[float, float]]:
    """A free point in each room or aisle, x and y in metres."""
    return _entry(config).places(config)


def _entry(config: IndoorConfig) -> IndoorWorld:
    return next(entry for entry in INDOOR_WORLDS.values() if isinstance(config, entry.config))


__all__ = [
    "INDOOR_WORLDS",
    "HospitalConfig",
    "HouseConfig",
    "IndoorConfig",
    "IndoorWorld",
    "WarehouseConfig",
    "indoor_places",
    "make_indoor",
]
