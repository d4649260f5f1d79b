# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What happens to a robot that makes a map, and its order: that of stamps, however it arrives."""

import operator
from dataclasses import dataclass
from typing import Any

from fusionslam.errors import DataError
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Odometry, Picture


@dataclass(frozen=True)
class Motion:
    """How fast a robot moved over the step that ends now, where nobody says its pose.

    Attributes:
        stamp_ns: when the step ended; it began at the stamp of the odometry before.
        v: m/s forwards.
        w: rad/s, counter-clockwise.
    """

    stamp_ns: int
    v: float
    w: float


@dataclass(frozen=True, eq=False)
class Look:
    """Something for the source of views to look at: whatever that takes, such as a cloud."""

    stamp_ns: int
    item: Any


@dataclass(frozen=True)
class Sighting:
    """A view that was recognised, or seen for the first time.

    Attributes:
        stamp_ns: when.
        view_id: a known one, the next new one, or -1 where nothing was recognised.
        relative_rotation: radians, counter-clockwise, that the robot is turned against the view.
        relative_place: metres, x forward and y to the left, where the robot is in the view's frame.
        reason: why it is this view, in a sentence.
    """

    stamp_ns: int
    view_id: int
    relative_rotation: float = 0.0
    relative_place: tuple[float, float] = (0.0, 0.0)
    reason: str = ""


# Stamps are stored as int64; differences of two have to fit, too.
_LATEST_NS = 2**62

Event = Frame | Odometry | Motion | Picture | Look | Sighting
"""What ``RatSlam.step`` takes."""


def stamp_of(event: Event) -> int:
    """Nanoseconds. Raises DataError for what is no whole number, or none that a run can store."""
    try:
        stamp_ns = operator.index(event.stamp_ns)
    except TypeError:
        raise DataError(f"stamp {event.stamp_ns!r}: expected whole nanoseconds") from None
    if abs(stamp_ns) > _LATEST_NS:
        raise DataError(f"stamp {stamp_ns} ns: expected no more than {_LATEST_NS}")
    return stamp_ns


def is_looking(event: Event) -> bool:
    """Whether it is a view or something to look at, not odometry alone."""
    return not isinstance(event, Odometry | Motion)
