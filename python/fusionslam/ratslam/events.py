# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Events that RatSLAM processes, in the order of their time stamps."""

import operator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusionslam.errors import DataError, ShapeError
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Odometry, Picture


@dataclass(frozen=True)
class Motion:
    """The robot's velocity over the step that ends now, for odometry without poses.

    Attributes:
        stamp_ns: end of the step; it began at the stamp of the previous odometry.
        v: m/s forward.
        w: rad/s, counter-clockwise.
        sideways: m/s to the left, of a robot that can, or of a sensor that is not on the axle.
            Like ``v`` relative to the heading in the middle of the step.
    """

    stamp_ns: int
    v: float
    w: float
    sideways: float = 0.0


@dataclass(frozen=True, eq=False)
class Look:
    """An item for the view source to recognise, of any type it accepts, such as a cloud."""

    stamp_ns: int
    item: Any


@dataclass(frozen=True)
class Sighting:
    """A view that was recognised or seen for the first time.

    Attributes:
        stamp_ns: time stamp.
        view_id: a known id, the next new one, or -1 if nothing was recognised.
        relative_rotation: rotation of the robot relative to the view, radians, counter-clockwise.
        relative_place: position of the robot in the view's frame, metres, x forward and y left.
        reason: the reason for this view, as a sentence.
    """

    stamp_ns: int
    view_id: int
    relative_rotation: float = 0.0
    relative_place: tuple[float, float] = (0.0, 0.0)
    reason: str = ""

    @property
    def measures_place(self) -> bool:
        """Whether the source measures positions: without, the robot is taken to be at the view."""
        return bool(np.any(self.relative_place))


# Stamps are stored as int64; their differences must fit, too.
_LATEST_NS = 2**62

Event = Frame | Odometry | Motion | Picture | Look | Sighting
"""The events that ``RatSlam.step`` takes."""


def stamp_of(event: Event) -> int:
    """Stamp in nanoseconds.

    Raises:
        ShapeError: not an event. DataError: the stamp is not an integer or too large to store.
    """
    if not isinstance(event, Event):
        found = type(event).__name__
        raise ShapeError(
            f"{found}: expected Odometry, Motion, Frame, Picture, Look or Sighting",
            code="no-event",
            fields=(found,),
        )
    try:
        stamp_ns = operator.index(event.stamp_ns)
    except TypeError:
        raise DataError(f"stamp {event.stamp_ns!r}: expected whole nanoseconds") from None
    if abs(stamp_ns) > _LATEST_NS:
        raise DataError(f"stamp {stamp_ns} ns: expected no more than {_LATEST_NS}")
    return stamp_ns


def check_sighting(sighting: Sighting) -> None:
    """Raise DataError if the view's id is no whole number, or its reason no text."""
    try:
        operator.index(sighting.view_id)
    except TypeError:
        raise DataError(f"view id {sighting.view_id!r}: expected a whole number") from None
    if not isinstance(sighting.reason, str):
        raise DataError(f"reason {sighting.reason!r}: expected text")


def is_looking(event: Event) -> bool:
    """True if the event is a view or can be recognised as one, not only odometry."""
    return not isinstance(event, Odometry | Motion)
