# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Place things in a room, keeping the lanes from its doors to the centre free."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusionslam.sim.indoor.objects import Site, Thing
from fusionslam.sim.indoor.rooms import WALL_M, Opening, Room, openings_of, sides
from fusionslam.sim.mesh import Side

# A robot of 0.22 m radius passes through a lane with room to spare.
LANE_M = 0.80
_GAP_M = 0.03
_STEP_M = 0.1
_TRIES = 60
_Rectangle = NDArray[np.float64]


class Layout:
    """Places things in one room; lanes from every door to the room's centre stay free."""

    def __init__(
        self, site: Site, room: Room, openings: Sequence[Opening], rng: np.random.Generator
    ) -> None:
        self._site = site
        self._room = room
        self._rng = rng
        self._sides = sides(room)
        self._doors = [openings_of(side, openings) for side in self._sides]
        centre = np.asarray(room.centre)
        self._taken = [_around(centre, centre, 1.0)]
        for side, doors in zip(self._sides, self._doors, strict=True):
            for along, opening in doors:
                self._taken += _lane(side, along, opening, centre)
        self._hung: list[_Rectangle] = []
        self._last = (0.0, 0.0, 0.0)  # x, y and yaw of the thing hung last

    def along_wall(self, thing: Thing) -> bool:
        """Stand a thing with its back to a wall.

        Returns False, and places nothing, if there is no room for it.
        """
        width, depth = thing.size
        for number in self._rng.permutation(4):
            wall = self._sides[number]
            reach = WALL_M / 2 + width / 2 + _GAP_M
            spots = np.arange(reach, wall.length - reach, _STEP_M)
            for along in self._rng.permutation(spots):
                x, y = wall.at(along, WALL_M / 2 + _GAP_M + depth / 2)
                if self._stand(thing, x, y, wall.yaw + np.pi):
                    return True
        return False

    def anywhere(self, thing: Thing) -> bool:
        """Stand a thing at a random free place in the room, rotated by a multiple of 90 degrees."""
        margin = max(thing.size) / 2 + WALL_M / 2 + 0.1
        low, high = np.asarray(self._room.low) + margin, np.asarray(self._room.high) - margin
        if (low >= high).any():
            return False
        for _ in range(_TRIES):
            x, y = (float(value) for value in self._rng.uniform(low, high))
            if self._stand(thing, x, y, float(self._rng.integers(4) * np.pi / 2)):
                return True
        return False

    def lay(self, carpet: Thing) -> None:
        """Lay a carpet in the middle of the room, along its longer side."""
        x, y = self._room.centre
        wide, deep = np.subtract(self._room.high, self._room.low)
        self._site.put(carpet, x, y, 0.0 if wide >= deep else np.pi / 2)

    def on_wall(self, thing: Thing, z: float, side: int | None = None) -> bool:
        """Hang a flat thing (its back at y = 0) on a wall, clear of doors and other hung things.

        Args:
            thing: the thing.
            z: height of its lower edge, metres.
            side: 0 south, 1 east, 2 north, 3 west; None for any.
        """
        half = thing.size[0] / 2 + 0.08
        chosen = self._rng.permutation(4) if side is None else [side]
        for number in chosen:
            wall = self._sides[number]
            for along in self._rng.permutation(
                np.arange(half + 0.2, wall.length - half - 0.2, 0.2)
            ):
                if self._hangs_free(int(number), float(along), half):
                    x, y = wall.at(along, WALL_M / 2)
                    self._hung.append(np.array((number, along - half, along + half)))
                    self._last = (x, y, wall.yaw + np.pi)
                    self._site.put(thing, *self._last, z)
                    return True
        return False

    def over_last(self, thing: Thing, z: float) -> None:
        """Hang a thing in front of the one hung last."""
        self._site.put(thing, *self._last, z)

    def _hangs_free(self, side: int, along: float, half: float) -> bool:
        for place, opening in self._doors[side]:
            if abs(along - place) < half + opening.width / 2 + 0.1:
                return False
        return all(
            wall != side or high < along - half or low > along + half
            for wall, low, high in self._hung
        )

    def _stand(self, thing: Thing, x: float, y: float, yaw: float) -> bool:
        width, depth = thing.size if round(yaw / (np.pi / 2)) % 2 == 0 else thing.size[::-1]
        half = np.array((width, depth)) / 2
        centre = np.array((x, y))
        place = np.concatenate([centre - half, centre + half])
        inner = np.concatenate(
            [np.add(self._room.low, WALL_M / 2), np.subtract(self._room.high, WALL_M / 2)]
        )
        if (place[:2] < inner[:2]).any() or (place[2:] > inner[2:]).any():
            return False
        for other in self._taken:
            if (place[:2] < other[2:]).all() and (other[:2] < place[2:]).all():
                return False
        self._taken.append(place)
        self._site.put(thing, x, y, yaw)
        return True


def _lane(
    side: Side, along: float, opening: Opening, centre: NDArray[np.float64]
) -> list[_Rectangle]:
    """Space for the door leaf, then straight in from the door, then to the room's centre."""
    door = np.array((opening.x, opening.y))
    depth = side.along(*centre)[1]
    knee = np.array(side.at(along, depth))
    leaf = np.array(side.at(along, opening.width / 2))
    return [
        _around(door, knee, LANE_M),
        _around(knee, centre, LANE_M),
        _around(leaf, leaf, opening.width + 0.2),
    ]


def _around(first: NDArray[np.float64], second: NDArray[np.float64], width: float) -> _Rectangle:
    low, high = np.minimum(first, second), np.maximum(first, second)
    return np.concatenate([low - width / 2, high + width / 2])
