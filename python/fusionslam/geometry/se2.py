# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses on the sheet of pose cells, and ways from one to another."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.storage.arrays import Floats

HEADINGS = 36
"""Layers of the sheet: headings ten degrees apart."""
LAYER = 2 * math.pi / HEADINGS
"""Radians from one layer to the next."""


class Place(NamedTuple):
    """A pose on the sheet in cells: x, y in [0, n), th in [0, 36), which is heading / 10 degrees.

    Also a way: x forwards, y to the left, th the turn, counter-clockwise, all of any size.
    """

    x: float
    y: float
    th: float


NOWHERE = Place(0.0, 0.0, 0.0)
"""The way that leads nowhere."""


def after(place: Place, way: Place) -> Place:
    """Where a way leads to from a place, not wrapped; or two ways one after the other."""
    cosine, sine = math.cos(place.th * LAYER), math.sin(place.th * LAYER)
    return Place(
        place.x + cosine * way.x - sine * way.y,
        place.y + sine * way.x + cosine * way.y,
        place.th + way.th,
    )


def back(way: Place) -> Place:
    """The way back."""
    cosine, sine = math.cos(way.th * LAYER), math.sin(way.th * LAYER)
    return Place(-cosine * way.x - sine * way.y, sine * way.x - cosine * way.y, -way.th)


def arc(way: float, turn: float) -> Place:
    """The way of a robot that turns evenly: length in cells, turn in radians."""
    half = turn / 2
    chord = way * float(np.sinc(half / math.pi))
    return Place(chord * math.cos(half), chord * math.sin(half), turn / LAYER)


def on_sheet(place: Place, size: int) -> Place:
    """The same place in [0, n) and [0, 36)."""
    return Place(_wrapped(place.x, size), _wrapped(place.y, size), _wrapped(place.th, HEADINGS))


def _wrapped(value: float, period: int) -> float:
    rest = value % period
    return rest if rest < period else 0.0  # a tiny negative value is rounded up to the period


def differences(places: Any, other: Any, size: int) -> Floats:
    """The shortest differences on the sheet, float64 (..., 3), each in half a period both ways."""
    period = np.array((size, size, HEADINGS), np.float64)
    raw = np.asarray(places, np.float64) - np.asarray(other, np.float64)
    wrapped: Floats = (raw + period / 2) % period - period / 2
    return wrapped


_UPRIGHT = np.cos(np.radians(30))


def places_of(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """float64 (n, 3): x, y and yaw of poses (n, 4, 4) of a body whose z axis points up.

    A world whose z axis is not up, such as KITTI's, is turned first, so that it is.
    """
    up = poses[:, :3, 2].mean(axis=0)
    up /= np.linalg.norm(up)
    turned = poses if up[2] > _UPRIGHT else _to_z(up) @ poses[:, :3]
    yaw = np.arctan2(turned[:, 1, 0], turned[:, 0, 0])
    return np.stack([turned[:, 0, 3], turned[:, 1, 3], yaw], axis=1)


def _to_z(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """float64 (3, 3): the turn that takes a direction to z."""
    aside = np.eye(3)[np.argmin(np.abs(up))]
    x = np.cross(aside, up)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def wrapped(angles: Floats) -> Floats:
    """The same angles, radians, in (-pi, pi]."""
    return np.asarray(np.pi - (np.pi - angles) % (2 * np.pi))
