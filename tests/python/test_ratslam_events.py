# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Events that arrive in any order are put into that of their stamps, whatever the time is."""

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
        order.add(Motion(float("nan"), 0.0, 0.0))  # type: ignore[arg-type]
    assert [event.stamp_ns for event in order.flush()] == [0]


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
