# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Events that arrive in any order are put into that of their stamps, whatever the time is."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionslam.errors import ConfigError, DataError
from fusionslam.ratslam import Motion, Sighting, StampOrder
from fusionslam.ratslam.events import Event

MS = 1_000_000


def given_out(order: StampOrder, events: list[Event]) -> list[Event]:
    return [one for event in events for one in order.add(event)] + order.flush()


def stamps(events: list[Event]) -> list[int]:
    return [event.stamp_ns for event in events]


def test_an_event_waits_until_nothing_can_come_before_it() -> None:
    order = StampOrder(wait=0.1)
    assert order.add(Motion(0, 0, 0)) == []
    assert order.add(Motion(100 * MS, 0, 0)) == []
    assert stamps(order.add(Motion(101 * MS, 0, 0))) == [0]
    assert stamps(order.flush()) == [100 * MS, 101 * MS]


def test_at_the_same_stamp_odometry_comes_before_views_and_the_rest_as_it_arrived() -> None:
    order = StampOrder(wait=0.1)
    events: list[Event] = [Sighting(5, 0), Motion(5, 1, 0), Sighting(5, 1), Motion(5, 2, 0)]
    assert given_out(order, events) == [events[1], events[3], events[0], events[2]]


def test_an_event_that_is_too_late_is_counted_and_left_out() -> None:
    order = StampOrder(wait=0.1)
    assert stamps(order.add(Motion(0, 0, 0)) + order.add(Motion(500 * MS, 0, 0))) == [0]
    assert order.add(Motion(-1, 0, 0)) == [] and order.too_late == 1
    # One that is late, but not later than what was given out, is in time.
    assert stamps(order.add(Motion(200 * MS, 0, 0))) == [200 * MS]
    assert stamps(order.flush()) == [500 * MS] and order.too_late == 1


def test_stamps_may_be_negative() -> None:
    order = StampOrder(wait=0.001)
    events: list[Event] = [Motion(k * MS, 0, 0) for k in (-9, -10, -5, -2)]
    assert stamps(given_out(order, events)) == [-10 * MS, -9 * MS, -5 * MS, -2 * MS]
    around = StampOrder(wait=0.01)
    assert stamps(around.add(Motion(0, 0, 0)) + around.add(Motion(-9 * MS, 0, 0))) == []
    assert stamps(around.add(Motion(2 * MS, 0, 0))) == [-9 * MS]


def test_no_wait_keeps_the_order_of_arrival_where_it_is_that_of_stamps() -> None:
    order = StampOrder(wait=0)
    assert stamps(order.add(Motion(1, 0, 0)) + order.add(Motion(2, 0, 0))) == [1]


def test_a_stamp_that_is_no_number_is_refused_and_nothing_is_lost() -> None:
    order = StampOrder(wait=0.1)
    order.add(Motion(0, 0.0, 0.0))
    with pytest.raises(DataError, match="stamp nan: expected whole nanoseconds"):
        order.add(Motion(float("nan"), 0.0, 0.0))
    assert [event.stamp_ns for event in order.flush()] == [0]


def test_in_order_an_event_is_given_out_once_both_kinds_have_come_as_far() -> None:
    order = StampOrder(wait=1.0, in_order=True)
    assert order.add(Motion(0, 0, 0)) == [] == order.add(Motion(30 * MS, 0, 0))
    assert stamps(order.add(Sighting(10 * MS, 0))) == [0, 10 * MS]
    assert stamps(order.add(Sighting(40 * MS, 0))) == [30 * MS]
    # At the same stamp odometry comes first, and one of the two is enough for neither.
    assert stamps(order.add(Sighting(50 * MS, 0))) == []
    assert stamps(order.add(Motion(50 * MS, 0, 0))) == [40 * MS, 50 * MS, 50 * MS]


def test_in_order_a_kind_that_lags_behind_is_waited_for_as_long_as_it_is_heard() -> None:
    order = StampOrder(wait=1.0, in_order=True)
    given_out_of = [*order.add(Motion(0, 0, 0)), *order.add(Sighting(0, 0))]
    for k in range(1, 100):  # views are 5 s behind
        given_out_of += order.add(Motion(k * 100 * MS, 0, 0))
        given_out_of += order.add(Sighting(max(k - 50, 0) * 100 * MS + 1, 0))
    assert order.too_late == 0 and given_out_of[-1].stamp_ns == 49 * 100 * MS + 1
    assert stamps(given_out_of) == sorted(stamps(given_out_of))


def motion(stamp_ns: int) -> Event:
    return Motion(stamp_ns, 0, 0)


def sighting(stamp_ns: int) -> Event:
    return Sighting(stamp_ns, 0)


@pytest.mark.parametrize(("silent", "heard"), [(motion, sighting), (sighting, motion)])
def test_in_order_a_kind_that_falls_silent_is_waited_for_no_longer_than_the_wait(
    silent: Callable[[int], Event], heard: Callable[[int], Event]
) -> None:
    order = StampOrder(wait=1.0, in_order=True)
    assert stamps([*order.add(silent(0)), *order.add(heard(0))]) == [0, 0]
    out = [stamps(order.add(heard(k * 100 * MS))) for k in range(1, 21)]
    assert out == [[]] * 11 + [[k * 100 * MS] for k in range(1, 10)]
    # Too late; but it is heard again, and waited for until it has come as far.
    assert order.add(silent(500 * MS)) == [] and order.too_late == 1
    assert stamps(order.add(heard(2100 * MS))) == []
    assert stamps(order.add(silent(1050 * MS))) == [1000 * MS, 1050 * MS]


def test_a_clock_that_goes_back_is_followed_kind_by_kind() -> None:
    order = StampOrder(wait=1.0, in_order=True, jump=0.5)
    before = [motion(9000 * MS), sighting(9000 * MS), motion(9100 * MS)]
    assert stamps(given_until(order, before)) == [9000 * MS, 9000 * MS]
    # Odometry is back at 0 while a view of before is still on its way.
    assert order.add(motion(0)) == []
    assert stamps(order.add(sighting(9050 * MS))) == [9050 * MS]
    assert stamps(order.add(motion(10 * MS))) == []
    assert stamps(order.add(sighting(5 * MS))) == [9100 * MS, 0, 5 * MS]
    # Less than the jump is late.
    assert order.add(motion(-1 * MS)) == [] and order.too_late == 1


def test_a_clock_that_goes_back_needs_no_order_by_kind() -> None:
    order = StampOrder(wait=1.0, jump=5.0)
    assert order.add(motion(9000 * MS)) == [] == order.add(sighting(9500 * MS))
    assert stamps(order.add(motion(0))) == [9000 * MS, 9500 * MS]
    assert stamps(order.add(motion(1001 * MS))) == [0]


def given_until(order: StampOrder, events: list[Event]) -> list[Event]:
    return [one for event in events for one in order.add(event)]


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(0, 3))
def test_in_order_no_interleaving_of_kinds_changes_the_order(seed: int, jumps: int) -> None:
    rng = np.random.default_rng(seed)
    laps = range(jumps + 1)
    motions = [motion(k * 33 * MS) for _ in laps for k in range(60)]
    looks = [sighting(k * 100 * MS) for _ in laps for k in range(20)]
    # Which of the two is next; runs of one alone stay below the wait.
    turns = rng.permutation(np.repeat([0, 1], [len(motions), len(looks)]))
    both = iter(motions), iter(looks)
    order = StampOrder(wait=60.0, in_order=True, jump=1.0)
    out = given_out(order, [next(both[turn]) for turn in turns])
    lap = sorted(motions[:60] + looks[:20], key=lambda e: (e.stamp_ns, isinstance(e, Sighting)))
    assert out == lap * (jumps + 1) and order.too_late == 0


def test_what_waits_is_bounded() -> None:
    order = StampOrder(wait=1.0, in_order=True)
    out = [event.stamp_ns for k in range(10_010) for event in order.add(motion(k))]
    assert out == list(range(10))


def test_a_negative_wait_is_refused() -> None:
    with pytest.raises(ConfigError, match="wait"):
        StampOrder(wait=-1)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(0, 0.5))
def test_delays_within_the_wait_never_change_the_order(seed: int, delay_s: float) -> None:
    rng = np.random.default_rng(seed)
    events: list[Event] = [Motion(k * 33 * MS, 0.5, 0) for k in range(60)]
    events += [Sighting(k * 100 * MS, 0) for k in range(20)]
    arrivals = [event.stamp_ns + rng.uniform(0, delay_s * 1e9) for event in events]
    arrived = [events[k] for k in np.argsort(arrivals, kind="stable")]
    order = StampOrder(wait=0.5)
    out = given_out(order, arrived)
    assert out == sorted(events, key=lambda e: (e.stamp_ns, isinstance(e, Sighting)))
    assert order.too_late == 0
