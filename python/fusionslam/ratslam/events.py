# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What happens to a robot that makes a map, and its order: that of stamps, however it arrives."""

import heapq
import operator
from dataclasses import dataclass
from typing import Any

from fusionslam.config import Section, merged, option
from fusionslam.errors import DataError
from fusionslam.messages import NANOSECONDS, Odometry, Picture
from fusionslam.sensors import Frame


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


Event = Frame | Odometry | Motion | Picture | Look | Sighting
"""What ``RatSlam.step`` takes."""

# Stamps are stored as int64; differences of two have to fit, too.
_LATEST_NS = 2**62


def stamp_of(event: Event) -> int:
    """Nanoseconds. Raises DataError for what is no whole number, or none that a run can store."""
    try:
        stamp_ns = operator.index(event.stamp_ns)
    except TypeError:
        raise DataError(f"stamp {event.stamp_ns!r}: expected whole nanoseconds") from None
    if abs(stamp_ns) > _LATEST_NS:
        raise DataError(f"stamp {stamp_ns} ns: expected no more than {_LATEST_NS}")
    return stamp_ns


class OrderConfig(Section):
    """How events of several sources are put in order."""

    wait: float = option(
        0.5, "how much later stamps may be before an event counts as complete", unit="s", ge=0
    )


class StampOrder:
    """Puts events that arrive in any order into that of their stamps.

    An event is given out once the newest stamp is ``wait`` seconds later than its own. Nothing
    depends on a clock on the wall: a bag that is played at any speed gives the same order, as long
    as no event arrives after others whose stamps are more than ``wait`` later. At the same stamp
    odometry comes before views.

    Args:
        config: None for the defaults.
        changes: values of the configuration that differ from it.

    Attributes:
        too_late: number of events that were refused because later ones had been given out.
    """

    def __init__(self, config: OrderConfig | None = None, **changes: Any) -> None:
        self.config = merged(config or OrderConfig(), changes)
        self.too_late = 0
        self._waiting: list[tuple[int, int, int, Event]] = []
        self._wait_ns = round(self.config.wait * NANOSECONDS)
        self._newest: int | None = None
        self._given: tuple[int, int] | None = None
        self._count = 0

    def add(self, event: Event) -> list[Event]:
        """Take an event; returns those that nothing can come before any more, in order.

        Raises:
            DataError: a stamp that is no whole number of nanoseconds.
        """
        key = (stamp_of(event), _is_view(event))
        if self._given is not None and key < self._given:
            self.too_late += 1
            return []
        self._count += 1
        heapq.heappush(self._waiting, (*key, self._count, event))
        known = event.stamp_ns if self._newest is None else self._newest
        self._newest = max(event.stamp_ns, known)
        return self._until(self._newest - self._wait_ns)

    def flush(self) -> list[Event]:
        """All that still waits, in order."""
        return self._until(None)

    def _until(self, stamp_ns: int | None) -> list[Event]:
        given = []
        while self._waiting and (stamp_ns is None or self._waiting[0][0] < stamp_ns):
            *_, event = heapq.heappop(self._waiting)
            self._given = (event.stamp_ns, _is_view(event))
            given.append(event)
        return given


def _is_view(event: Event) -> bool:
    return not isinstance(event, Odometry | Motion)
