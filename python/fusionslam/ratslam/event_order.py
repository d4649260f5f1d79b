# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Events of several streams, put into the order of their stamps."""

import heapq
from dataclasses import dataclass
from typing import Any

from fusionslam.config import Section, merged, option
from fusionslam.ratslam.events import Event, is_looking, stamp_of
from fusionslam.sensors.messages import NANOSECONDS


class OrderConfig(Section):
    """How events of several sources are put in order."""

    wait: float = option(
        0.5, "how much later stamps may be before an event counts as complete", unit="s", ge=0
    )
    in_order: bool = option(
        False,
        "odometry comes in the order of its stamps, and so do views: an event is complete once "
        "both have come as far, and wait is how long one of them may be silent",
    )
    jump: float | None = option(
        None,
        "a stamp farther behind the newest of its kind means that the clock went back; "
        "null: that it is late",
        unit="s",
        gt=0,
    )


# 5 minutes at 30 Hz: what waits must not grow without end where one of two stays far behind.
_MOST_WAITING = 10_000


_NOTHING = (-1, 0)


@dataclass
class _Heard:
    """Of one kind of event: how often its clock went back, the first and the newest stamp since
    then, and how far the other kind came since the last of this one."""

    clock: int = 0
    first_ns: int = 0
    newest_ns: int | None = None
    silent_ns: int = 0

    def starts(self, clock: int, stamp_ns: int) -> None:
        self.clock, self.first_ns, self.newest_ns = clock, stamp_ns, stamp_ns


class StampOrder:
    """Puts events that arrive in any order into that of their stamps.

    An event is given out once the newest stamp is ``wait`` seconds later than its own. Nothing
    depends on a clock on the wall: a bag that is played at any speed gives the same order, as long
    as no event arrives after others whose stamps are more than ``wait`` later. At the same stamp
    odometry comes before views.

    With ``in_order`` an event is given out as soon as odometry and views have both come as far, and
    one of them may lag behind the other by any time. Only where one falls silent while the other
    goes on for more than ``wait``, it is waited for no longer than above. Nothing is given out
    before both were heard of.

    With ``jump`` the clock may go back. The stamps of each kind go back by themselves; all events
    from before are given out before the first one from after, whose stamp tells.

    Args:
        config: None for the defaults.
        after_ns: the newest stamp that was given out before, by another order; None for none.
        changes: values of the configuration that differ from it.

    Attributes:
        too_late: number of events that were refused because later ones had been given out.
    """

    def __init__(
        self, config: OrderConfig | None = None, *, after_ns: int | None = None, **changes: Any
    ) -> None:
        self.config = merged(config or OrderConfig(), changes)
        self.too_late = 0
        self._waiting: list[tuple[int, int, bool, int, Event]] = []
        self._wait_ns = round(self.config.wait * NANOSECONDS)
        self._heard = {is_view: _Heard(newest_ns=after_ns) for is_view in (False, True)}
        self._given = None if after_ns is None else (0, after_ns, False)
        self._count = 0

    def add(self, event: Event) -> list[Event]:
        """Take an event; returns those that nothing can come before any more, in order.

        Raises:
            DataError: a stamp that is no whole number of nanoseconds.
        """
        stamp_ns, is_view = stamp_of(event), is_looking(event)
        self._hear(stamp_ns, is_view)
        key = (self._heard[is_view].clock, stamp_ns, is_view)
        if self._given is not None and key < self._given:
            self.too_late += 1
        else:
            self._count += 1
            heapq.heappush(self._waiting, (*key, self._count, event))
        return self._until(self._complete())

    def flush(self) -> list[Event]:
        """All that still waits, in order."""
        return self._until(None)

    def _hear(self, stamp_ns: int, is_view: bool) -> None:
        heard, other = self._heard[is_view], self._heard[not is_view]
        heard.silent_ns = 0
        if heard.newest_ns is None or self._left_behind(heard, other):
            heard.starts(other.clock, stamp_ns)
        elif self.config.jump is not None and (
            heard.newest_ns - stamp_ns > self.config.jump * NANOSECONDS
        ):
            heard.starts(heard.clock + 1, stamp_ns)
        else:
            on = max(stamp_ns - heard.newest_ns, 0)
            heard.newest_ns += on
            # Where the clock goes forward by an hour, the other one is not silent for it.
            other.silent_ns += min(on, self._wait_ns // 2 + 1)

    def _left_behind(self, heard: _Heard, other: _Heard) -> bool:
        """Whether the other kind's clock went back long ago: then this one's did, too, unnoticed,
        as its last stamp was from before the time that it came back to."""
        on = (other.newest_ns or 0) - other.first_ns
        return heard.clock < other.clock and on > self._wait_ns

    def _complete(self) -> tuple[int, int]:
        """Clock and stamp before which nothing more is waited for."""
        heard = [one for one in self._heard.values() if one.newest_ns is not None]
        marks = [(one.clock, one.newest_ns or 0) for one in heard]
        waited = [(clock, newest_ns - self._wait_ns) for clock, newest_ns in marks]
        if not self.config.in_order:
            return max(waited)
        if len(heard) < len(self._heard):
            return _NOTHING
        clock, newest_ns = min(marks)
        # Of a kind that is silent, no more is expected than the wait behind the other.
        alone = [waited[1 - k] for k in (0, 1) if heard[k].silent_ns > self._wait_ns]
        return max([(clock, newest_ns + 1), *alone])

    def _until(self, end: tuple[int, int] | None) -> list[Event]:
        given = []
        most = _MOST_WAITING if self.config.in_order else len(self._waiting)
        while self._waiting and (
            end is None or self._waiting[0][:2] < end or len(self._waiting) > most
        ):
            clock, stamp_ns, is_view, _, event = heapq.heappop(self._waiting)
            self._given = (clock, stamp_ns, is_view)
            given.append(event)
        return given
