# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Build rooms that share walls: floors, ceilings, openings, frames, door leaves, windows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusionslam.sim.indoor.objects import Site, Thing, block, flat, front, thing
from fusionslam.sim.indoor.textures import WHITE, Look, fit
from fusionslam.sim.mesh import Mesh, Paint, Rgb, Side, box, join_meshes, level, paint

WALL_M = 0.16
DOOR_M = 2.05
_HALF = WALL_M / 2
_FRAME_M = 0.03
_SAME_M = 1e-6


@dataclass(frozen=True)
class Room:
    """A rectangular room, bounded by the centre lines of its walls, metres."""

    name: str
    low: tuple[float, float]
    high: tuple[float, float]
    wall: Paint
    floor: Paint
    skirting: Paint

    @property
    def centre(self) -> tuple[float, float]:
        """x, y of the room's centre, metres."""
        return (self.low[0] + self.high[0]) / 2, (self.low[1] + self.high[1]) / 2


@dataclass(frozen=True)
class Opening:
    """A passage through a wall.

    Attributes:
        x, y: its centre, on the wall's centre line, metres.
        width: of the hole in the wall, metres.
        leaf_in: name of the room that the open leaf stands in, "" for none.
        leaf: colour of leaf and frame.
        hinge: 1 or -1, the end of the opening (seen from that room) with the hinges.
    """

    x: float
    y: float
    width: float = 0.95
    leaf_in: str = ""
    leaf: Rgb = WHITE
    hinge: int = 1


def sides(room: Room) -> tuple[Side, ...]:
    """South, east, north and west wall."""
    (x0, y0), (x1, y1) = room.low, room.high
    width, depth = x1 - x0, y1 - y0
    starts = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
    lengths = (width, depth, width, depth)
    return tuple(
        Side(start, k * np.pi / 2, length)
        for k, (start, length) in enumerate(zip(starts, lengths, strict=True))
    )


def openings_of(side: Side, openings: Sequence[Opening]) -> list[tuple[float, Opening]]:
    """The openings in one wall with their positions along it, in order."""
    found = []
    for opening in openings:
        along, inward = side.along(opening.x, opening.y)
        if abs(inward) < _SAME_M and 0 < along < side.length:
            found.append((along, opening))
    return sorted(found, key=lambda pair: pair[0])


def build_room(site: Site, room: Room, openings: Sequence[Opening], height: float) -> None:
    """Add floor, ceiling, walls and open door leaves of a room to the site."""
    extent = room.high[0] - room.low[0], room.high[1] - room.low[1]
    corner = np.array(extent) / 2
    floor = level(-corner, corner, 0.0, room.floor)
    ceiling = level(-corner, corner, 0.0, paint(Look.PANELS, (1.7, 1.7, 1.7)), upward=False)
    site.put(Thing(f"floor_{room.name}", floor, floor, extent, is_ground=True), *room.centre)
    site.put(Thing(f"ceiling_{room.name}", ceiling, ceiling, extent), *room.centre, z=height)
    visual: list[Mesh] = []
    solid: list[Mesh] = []
    for side in sides(room):
        found = openings_of(side, openings)
        walls, extras = [], []
        for start, end in spans(side.length, found):
            walls.append(box((start, 0, 0), (end, _HALF, height), room.wall))
            extras.append(box((start, _HALF, 0), (end, _HALF + 0.012, 0.08), room.skirting))
        for along, opening in found:
            low, high = along - opening.width / 2, along + opening.width / 2
            walls.append(block((low, 0, DOOR_M), (high, _HALF, height), room.wall))
            extras.append(_frame(along, opening))
            if opening.leaf_in == room.name:
                _put_leaf(site, side, along, opening)
        place = (*side.start, 0)
        visual.append(join_meshes([*walls, *extras]).move(place, side.yaw))
        solid.append(join_meshes(walls).move(place, side.yaw))
    site.put(thing(f"wall_{room.name}", visual, solid), 0.0, 0.0)


def window(width: float, height: float) -> Thing:
    """A window with its sill; its back is at y = 0, its lower edge at z = 0."""
    pane = front((-width / 2, 0), (width / 2, height), -0.006, fit(Look.WINDOW, width, height))
    x = width / 2 + 0.05
    sill = block((-x, -0.06, -0.04), (x, 0, 0), paint(Look.PLAIN, WHITE))
    return flat("window", [pane, sill])


def spans(length: float, found: Sequence[tuple[float, Opening]]) -> list[tuple[float, float]]:
    """Sections of a wall between its openings: (from, to) along it."""
    edges = [0.0]
    for along, opening in found:
        edges += [along - opening.width / 2, along + opening.width / 2]
    edges.append(length)
    return list(zip(edges[::2], edges[1::2], strict=True))


def _frame(along: float, opening: Opening) -> Mesh:
    """This room's half of the frame: it lines the opening and overlaps the wall."""
    cover, depth = paint(Look.WOOD, opening.leaf), _HALF + 0.015
    half = opening.width / 2
    posts = [
        box((x - 0.02, 0, 0), (x + _FRAME_M, depth, DOOR_M), cover)
        for x in (along - half - 0.03, along + half - _FRAME_M + 0.02)
    ]
    head = block(
        (along - half - 0.05, 0, DOOR_M - _FRAME_M),
        (along + half + 0.05, depth, DOOR_M + 0.05),
        cover,
    )
    return join_meshes([*posts, head])


def _put_leaf(site: Site, side: Side, along: float, opening: Opening) -> None:
    """Put an open leaf perpendicular to the wall beside the opening."""
    width = opening.width - 2 * _FRAME_M
    cover = fit(Look.DOOR, width, DOOR_M, opening.leaf)
    leaf = block((-width / 2, -0.02, 0.01), (width / 2, 0.02, DOOR_M - _FRAME_M), cover)
    knobs = [
        block(
            (width / 2 - 0.16, y - 0.01, 1.0),
            (width / 2 - 0.05, y + 0.01, 1.03),
            paint(Look.PLAIN, (0.5, 0.5, 0.5)),
        )
        for y in (-0.05, 0.05)
    ]
    place = along + opening.hinge * (opening.width / 2 + 0.03)
    x, y = side.at(place, _HALF + width / 2 + 0.02)
    site.put(thing("door", [leaf, *knobs], [leaf]), x, y, side.yaw + np.pi / 2)
