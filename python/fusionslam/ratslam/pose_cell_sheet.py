# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses on the sheet of pose cells, in cells, and motions between them."""

import math
from typing import Any, NamedTuple

import numpy as np

from fusionslam.storage.arrays import Floats

HEADINGS = 36
"""Layers of the sheet: headings ten degrees apart."""
LAYER = 2 * math.pi / HEADINGS
"""Angle between two layers, radians."""


class Place(NamedTuple):
    """A pose on the sheet in cells: x, y in [0, n), th in [0, 36), which is heading / 10 degrees.

    Also a motion: x forward, y to the left, th the turn, counter-clockwise, all of any size.
    """

    x: float
    y: float
    th: float


IDENTITY = Place(0.0, 0.0, 0.0)
"""The motion that changes nothing."""


def compose(place: Place, way: Place) -> Place:
    """Apply a motion to a place, without wrapping; or concatenate two motions."""
    cosine, sine = math.cos(place.th * LAYER), math.sin(place.th * LAYER)
    return Place(
        place.x + cosine * way.x - sine * way.y,
        place.y + sine * way.x + cosine * way.y,
        place.th + way.th,
    )


def inverse(way: Place) -> Place:
    """The inverse motion."""
    cosine, sine = math.cos(way.th * LAYER), math.sin(way.th * LAYER)
    return Place(-cosine * way.x - sine * way.y, sine * way.x - cosine * way.y, -way.th)


def motion_arc(way: float, turn: float) -> Place:
    """The motion along an arc: length in cells, turn in radians."""
    half = turn / 2
    chord = way * float(np.sinc(half / math.pi))
    return Place(chord * math.cos(half), chord * math.sin(half), turn / LAYER)


def wrap(place: Place, size: int) -> Place:
    """Wrap a place into [0, n) and [0, 36)."""
    return Place(
        _wrap_value(place.x, size), _wrap_value(place.y, size), _wrap_value(place.th, HEADINGS)
    )


def _wrap_value(value: float, period: int) -> float:
    rest = value % period
    return rest if rest < period else 0.0  # % rounds a tiny negative value up to the period


def differences(places: Any, other: Any, size: int) -> Floats:
    """The shortest differences on the wrapped sheet, float64 (..., 3), within half a period."""
    period = np.array((size, size, HEADINGS), np.float64)
    raw = np.asarray(places, np.float64) - np.asarray(other, np.float64)
    wrapped: Floats = (raw + period / 2) % period - period / 2
    return wrapped
