# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sorts events of several streams by time stamp."""

import heapq
from dataclasses import dataclass
from typing import Any, Literal

from fusionslam.base.argument_types import checked
from fusionslam.config import Section, merged, option
from fusionslam.ratslam.events import Event, is_looking, stamp_of
from fusionslam.sensors.messages import NANOSECONDS


class OrderConfig(Section):
    """Settings of the order of events from several streams."""

    wait: float = option(
        0.5, "how much later the newest stamp must be before an event is released", unit="s", ge=0
    )
    in_order: bool = option(
        False,
        "odometry arrives in the order of its stamps, and so do views: an event is released once "
        "both have reached its stamp, and wait is how long one of them may be silent",
    )
    jump: float | None = option(
        None,
        "a stamp farther than this behind the newest of its kind means that the clock went back; "
        "null: late events are refused",
        unit="s",
        gt=0,
    )


# 5 minutes at 30 Hz: bounds the queue if one of the two streams stays far behind.
_MOST_WAITING = 10_000


_NOTHING = (-1, 0)

LateBecause = Literal["order", "wait", "silence", "full"]


@dataclass
class _StreamClock:
    """Clock of one kind of event.

    It holds how often the clock went back, the first and the newest stamp since then, and how far
    the other kind has come since the last event of this one.
    """

    clock: int = 0
    first_ns: int = 0
    newest_ns: int | None = None
    silent_ns: int = 0

    def restart(self, clock: int, stamp_ns: int) -> None:
        self.clock, self.first_ns, self.newest_ns = clock, stamp_ns, stamp_ns


@checked
class StampOrder:
    """Sorts events that arrive in any order by time stamp.

    An event is released once the newest stamp is ``wait`` seconds later than its own. The wall
    clock plays no role: a bag gives the same order at any playback speed, as long as no event
    arrives after others whose stamps are more than ``wait`` later. At equal stamps odometry comes
    before views.

    With ``in_order`` an event is released as soon as odometry and views have both reached its
    stamp, and either may lag behind the other by any time. If one is silent while the other goes on
    for more than ``wait``, the rule above applies. Nothing is released before both have arrived.

    With ``jump`` the clock may go back, for each kind separately. All events from before the jump
    are released before the first one after it.

    Args:
        config: None for the defaults.
        after_ns: the newest stamp that an earlier ``StampOrder`` released; None if there is none.
        changes: configuration values to override.

    Attributes:
        too_late: number of events refused because later ones had already been released.
        late_because: why the last ones were released: odometry and views had both come as far
            ("order": what is refused is behind its own stream), or the newest stamp was more than
            ``wait`` later ("wait"), or by ``settle`` or ``flush`` ("silence"), or because too many
            events waited ("full").
    """

    def __init__(
        self, config: OrderConfig | None = None, *, after_ns: int | None = None, **changes: Any
    ) -> None:
        self.config = merged(config or OrderConfig(), changes)
        self.too_late = 0
        self._waiting: list[tuple[int, int, bool, int, Event]] = []
        self._wait_ns = round(self.config.wait * NANOSECONDS)
        self._clocks = {is_view: _StreamClock(newest_ns=after_ns) for is_view in (False, True)}
        self._released = None if after_ns is None else (0, after_ns, False)
        self._count = 0
        self.late_because: LateBecause = "order"

    def add(self, event: Event) -> list[Event]:
        """Add an event; returns, in order, those that no later arrival can precede.

        Raises:
            DataError: a stamp that is not a whole number of nanoseconds.
        """
        stamp_ns, is_view = stamp_of(event), is_looking(event)
        self._update_clock(stamp_ns, is_view)
        key = (self._clocks[is_view].clock, stamp_ns, is_view)
        if self._released is not None and key < self._released:
            self.too_late += 1
        else:
            self._count += 1
            heapq.heappush(self._waiting, (*key, self._count, event))
        return self._release(*self._complete())

    def settle(self) -> list[Event]:
        """Release the waiting views and what precedes them, in order: nothing came for a while.

        Odometry later than these views still waits, so that the next view is not too late, however
        long its way here takes.
        """
        views = [entry[:2] for entry in self._waiting if entry[2]]
        if not views:
            return []
        clock, stamp_ns = max(views)
        return self._release((clock, stamp_ns + 1), "silence")

    def flush(self) -> list[Event]:
        """Release all waiting events, in order: no more are expected."""
        return self._release(None, "silence")

    def _update_clock(self, stamp_ns: int, is_view: bool) -> None:
        own, other = self._clocks[is_view], self._clocks[not is_view]
        own.silent_ns = 0
        # The other kind's clock went back more than ``wait`` ago: then this one's did too,
        # unnoticed, as its last stamp is earlier than the time to which the clock went back.
        on = (other.newest_ns or 0) - other.first_ns
        missed_jump = own.clock < other.clock and on > self._wait_ns
        if own.newest_ns is None or missed_jump:
            own.restart(other.clock, stamp_ns)
        elif self.config.jump is not None and (
            own.newest_ns - stamp_ns > self.config.jump * NANOSECONDS
        ):
            own.restart(own.clock + 1, stamp_ns)
        else:
            on = max(stamp_ns - own.newest_ns, 0)
            own.newest_ns += on
            # Capped: a forward jump of this clock does not make the other kind silent.
            other.silent_ns += min(on, self._wait_ns // 2 + 1)

    def _complete(self) -> tuple[tuple[int, int], LateBecause]:
        """Clock and stamp before which all events can be released, and why."""
        clocks = [one for one in self._clocks.values() if one.newest_ns is not None]
        marks = [(one.clock, one.newest_ns or 0) for one in clocks]
        waited = [(clock, newest_ns - self._wait_ns) for clock, newest_ns in marks]
        if not self.config.in_order:
            return max(waited), "wait"
        if len(clocks) < len(self._clocks):
            return _NOTHING, "order"
        clock, newest_ns = min(marks)
        # A silent kind is waited for no longer than ``wait`` behind the other.
        alone = [waited[1 - k] for k in (0, 1) if clocks[k].silent_ns > self._wait_ns]
        both = clock, newest_ns + 1
        end = max([both, *alone])
        return end, "order" if end == both else "wait"

    def _release(self, end: tuple[int, int] | None, why: LateBecause) -> list[Event]:
        released = []
        most = _MOST_WAITING if self.config.in_order else len(self._waiting)
        while self._waiting and (
            end is None or self._waiting[0][:2] < end or len(self._waiting) > most
        ):
            clock, stamp_ns, is_view, _, event = heapq.heappop(self._waiting)
            self._released = (clock, stamp_ns, is_view)
            self.late_because = why if end is None or (clock, stamp_ns) < end else "full"
            released.append(event)
        return released
