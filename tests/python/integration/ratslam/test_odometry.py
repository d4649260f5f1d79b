# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Events in order, and motion from odometry messages."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import SECOND, circles, odometry, said, take, unchanged
from fusionslam.errors import DataError
from fusionslam.ratslam import Motion, RatSlam, Sighting, StampOrder
from fusionslam.ratslam.events import Event
from fusionslam.ratslam.odometry import Limits, Odometry2D, odometry_of, step_between
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Odometry
from rows import rows

LIMITS = Limits(gap=0.5, max_speed=50.0)
TENTH = SECOND // 10


def at(seconds: float, x: float, y: float = 0.0, yaw: float = 0.0, v: float = 0.0) -> Odometry:
    c, s = np.cos(yaw), np.sin(yaw)
    pose = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])
    return said(round(seconds * SECOND), pose, linear=np.array([v, 0, 0]))


@rows(
    "before, now, step",
    [
        # A quarter of a circle of radius 1, in a second: the chord is sqrt(2) long.
        (at(0, 0, 0, 0), at(1, 1, 1, np.pi / 2), (np.sqrt(2), np.pi / 2, 1)),
        (at(0, 0, 0, 3.1), at(0.1, 0, 0, -3.1), (0, 10 * (2 * np.pi - 6.2), 0.1)),
        (at(0, 0), at(0.1, -0.05), (-0.5, 0, 0.1)),
    ],
)
def test_two_poses_give_speed_and_turn_rate(before: Odometry, now: Odometry, step: Any) -> None:
    found = step_between(odometry_of(before), odometry_of(now), Limits(gap=2, max_speed=50))
    assert found is not None and found.note == ""
    np.testing.assert_allclose(found[:3], step, atol=1e-12)


def test_the_rate_of_odometry_does_not_change_dead_reckoning() -> None:
    way = circles(0.2)
    rates = (5.0, 20.0, 60.0)
    ends = [take(RatSlam(), odometry(way, rate_hz=rate))[-1].dead_reckoning for rate in rates]
    # The last stamps differ by up to a fifth of a second, and so do the poses: chords do not.
    np.testing.assert_allclose(ends[0], ends[2], atol=0.12)
    np.testing.assert_allclose(ends[1], ends[2], atol=0.02)


@rows(
    "events, x",
    [
        # Poses bridge a gap; a velocity counts for no longer than the gap allowed.
        ([at(0, 0), at(0.1, 0.05), at(5.1, 2.55)], 2.55),
        ([Motion(0, 1, 0), Motion(TENTH, 1, 0), Motion(TENTH + 10 * SECOND, 1, 0)], 0.1 + 0.5),
        # Jumps are left out; the velocity counts if there is one.
        ([at(0, 50), at(0.1, 50.05), at(0.2, 0.0, v=0.5)], 0.05 + 0.05),
        ([at(0, 50), at(0.1, 50.05), at(0.2, 0.0, v=np.nan)], 0.05),
        ([Motion(0, 0.5, 0), Motion(TENTH, 1e300, 0.0)], 0),
    ],
)
def test_gaps_and_jumps_are_noted(events: list[Odometry | Motion], x: float) -> None:
    *steps, last = take(RatSlam(), events)
    assert last.why and not any(step.why for step in steps)
    assert last.dead_reckoning[0] == pytest.approx(x)


def test_odometry_continues_after_a_jump() -> None:
    steps = take(RatSlam(), [at(0, 50), at(0.1, 50.05), at(0.2, 0.0), at(0.3, 0.05)])
    assert steps[-1].dead_reckoning[0] == pytest.approx(0.1) and not steps[-1].why


POSES = [(3, 4, 2.5), (-1, 0.5, -1.0), (0, -2, 3.0), (0, 0, 1.0)]


@rows("preset, pose", product(["robust", "openratslam"], POSES))
def test_after_a_silence_the_robot_is_where_its_pose_says(preset: str, pose: Any) -> None:
    slam = RatSlam(preset=preset)
    take(slam, [at(0, 1, 2, 0.5), Sighting(0, 0)])
    step = slam.step(at(9, *pose))
    c, s = np.cos(0.5), np.sin(0.5)
    x, y = pose[0] - 1, pose[1] - 2
    wanted = (c * x + s * y, c * y - s * x, pose[2] - 0.5)
    np.testing.assert_allclose(step.dead_reckoning, wanted, atol=1e-9)


def test_odometry_restarted_after_a_gap_leaves_the_robot_where_it_is() -> None:
    before = [at(0, 4, 3, 1), Sighting(0, 0), at(0.1, 4.1, 3, 1)]
    slam = RatSlam()
    *_, there = take(slam, before)
    again = slam.step(at(20, 0.01, 0, 0.01))
    assert again.why and again.dead_reckoning == there.dead_reckoning
    assert slam.step(at(20.1, 0.06, 0, 0.01)).dead_reckoning[0] > there.dead_reckoning[0]
    # It may be another day, but the robot is where it was switched off.
    assert take(RatSlam(), [*before, at(86_400, 0)])[-1].dead_reckoning == there.dead_reckoning
    # Beside its origin, or from near it, the robot may really be there.
    for drive in ([*before, at(20, 0.3)], [at(0, 0.4), Sighting(0, 0), at(5, 0)]):
        *_, last, moved = take(RatSlam(), drive)
        assert np.hypot(*np.subtract(moved.dead_reckoning, last.dead_reckoning)[:2]) > 0.3


def test_motions_that_would_take_the_original_minutes_are_left_out() -> None:
    slam, ours = RatSlam(preset="openratslam"), RatSlam()
    events = [at(0, 0), Sighting(0, 0), at(0.1, 0.05), at(3600, 1800.05, v=0.5), at(3600.1, 1800.1)]
    steps = take(slam, events)
    assert steps[3].why
    # Its velocity counts for half a second.
    assert steps[-1].dead_reckoning[0] == pytest.approx(0.05 + 0.25 + 0.05)
    assert take(ours, events)[-1].dead_reckoning[0] == pytest.approx(1800.1)
    fast = RatSlam(preset="openratslam", gap=3600)
    steps = take(fast, [Motion(0, 1.0, 0.0), Motion(3600 * SECOND, 1.0, 0.0)])
    assert steps[1].why and steps[1].dead_reckoning == (0, 0, 0)


@rows("preset", ["robust", "openratslam"])
def test_a_way_longer_than_the_sheet_of_cells_is_taken(preset: str) -> None:
    slam = RatSlam(preset=preset)
    take(slam, [at(0, 0), Sighting(0, 0), at(0.1, 0.05)])
    step = slam.step(at(1.1, 30.05))
    assert step.dead_reckoning[0] == pytest.approx(30.05)
    activity = slam.cells.activity
    assert np.isfinite(activity).all() and activity.sum() == pytest.approx(1)


@rows(
    "event",
    [
        *[at(seconds, 0.1) for seconds in (0.05, 0.1)],
        *[Motion(stamp_ns, 0.1, 0.0) for stamp_ns in (TENTH, np.nan, 2**63)],
        *[Motion(2 * TENTH, 0.1, 0.0, sideways) for sideways in (np.nan, "left")],
        *[Motion(2 * TENTH, v, w) for v, w in ((np.nan, 0.0), (0.0, np.inf), ("fast", 0.0))],
        replace(at(0.2, np.nan), linear=np.full(3, np.nan)),
    ],
)
def test_invalid_odometry_is_refused_and_changes_nothing(event: Odometry | Motion) -> None:
    slam = RatSlam()
    take(slam, [at(0, 0), Sighting(0, 0), at(0.1, 0.05)])
    with unchanged(slam), pytest.raises(DataError):
        slam.step(event)
    assert slam.step(at(0.3, 0.15)).dead_reckoning[0] == pytest.approx(0.15)


def test_a_pose_that_is_not_finite_is_replaced_by_the_velocity_beside_it() -> None:
    slam = RatSlam()
    steps = take(slam, [at(0, 0), at(0.1, 0.05), at(0.2, np.nan, v=0.5), at(0.3, 9, v=0.5)])
    # The pose after it has no pose before it to be compared with.
    assert [step.dead_reckoning[0] for step in steps] == pytest.approx([0, 0.05, 0.1, 0.15])


@rows("v, w, sideways", [(1.0, 0.5, 0.3), (-1.0, 0.5, 0.3), (0.0, 0.0, -0.4), (0.2, -3.0, 2.0)])
def test_sideways_motion_moves_the_robot_sideways(v: float, w: float, sideways: float) -> None:
    slam = RatSlam()
    step = take(slam, [Motion(k * TENTH, v, w, sideways) for k in range(21)])[-1]
    # Each step is straight, at the heading in its middle: the sum of 20 such vectors.
    headings = (np.arange(20) + 0.5) * w / 10
    x = np.sum(np.cos(headings) * v - np.sin(headings) * sideways) / 10
    y = np.sum(np.sin(headings) * v + np.cos(headings) * sideways) / 10
    assert step.dead_reckoning[:2] == pytest.approx((x, y))
    assert np.cos(step.dead_reckoning[2] - 2 * w) == pytest.approx(1)
    assert step.pose == pytest.approx(step.dead_reckoning)


def test_odometry_in_frames_moves_the_robot() -> None:
    slam = RatSlam()
    for k in range(3):  # without a view source the view is refused, but the odometry counts
        with pytest.raises(DataError):
            slam.step(Frame(index=k, stamp_ns=k * TENTH, odometry=at(0, 0.1 * k).pose))
    assert slam.step(at(0.3, 0.3)).dead_reckoning[0] == pytest.approx(0.3)


def test_a_pose_after_a_velocity_needs_a_velocity() -> None:
    said = Odometry2D(TENTH, None, (0.1, 0.0))
    with pytest.raises(DataError):
        step_between(said, Odometry2D(2 * TENTH, (0, 0, 0), None), LIMITS)


MS = 1_000_000


def release_all(order: StampOrder, events: list[Event]) -> list[Event]:
    return [one for event in events for one in order.add(event)] + order.flush()


def stamps(events: list[Event]) -> list[int]:
    return [event.stamp_ns for event in events]


def motion(stamp_ns: int) -> Event:
    return Motion(stamp_ns, 0, 0)


def sighting(stamp_ns: int) -> Event:
    return Sighting(stamp_ns, 0)


@rows(
    "options, story, too_late",
    [
        # An event waits until nothing can come before it.
        ({"wait": 0.1}, "m0 m100 m101>m0 end>m100,m101", 0),
        # What is too late is left out; what is no later than what was given out is in time.
        ({"wait": 0.1}, "m0 m500>m0 m-1 m200>m200 end>m500", 1),
        ({"wait": 0.01}, "m0 m-9 m2>m-9", 0),
        ({"wait": 0}, "m1 m2>m1", 0),
        # In order, both kinds have to reach a stamp; where both have the same, odometry is first.
        ({"in_order": True}, "m0 m30 s10>m0,s10 s40>m30 s50 m50>s40,m50,s50", 0),
        # A clock that goes back is followed kind by kind; less than the jump is late.
        (
            {"in_order": True, "jump": 0.5},
            "m9000 s9000>m9000,s9000 m9100 m0 s9050>s9050 m10 s5>m9100,m0,s5 m-1",
            1,
        ),
        # Without an order by kind, too.
        ({"jump": 5.0}, "m9000 s9500 m0>m9000,s9500 m1001>m0", 0),
    ],
)
def test_events_are_released_in_order_after_the_wait(
    options: dict[str, Any], story: str, too_late: int
) -> None:
    """A story has arriving events, m of odometry and s of views in milliseconds, and after > those
    that are released."""
    order = StampOrder(**{"wait": 1.0} | options)
    for chapter in story.split():
        arrived, _, released = chapter.partition(">")
        found = order.flush() if arrived == "end" else order.add(event_of(arrived))
        assert found == [event_of(name) for name in released.split(",") if name], chapter
    assert order.too_late == too_late


def event_of(name: str) -> Event:
    return {"m": motion, "s": sighting}[name[0]](int(name[1:]) * MS)


def test_a_stamp_that_is_no_number_is_refused_and_nothing_is_lost() -> None:
    order = StampOrder(wait=0.1)
    order.add(Motion(0, 0.0, 0.0))
    with pytest.raises(DataError):
        order.add(Motion(float("nan"), 0.0, 0.0))
    assert [event.stamp_ns for event in order.flush()] == [0]


def test_in_order_a_kind_that_lags_behind_is_waited_for_as_long_as_it_arrives() -> None:
    order = StampOrder(wait=1.0, in_order=True)
    released = [*order.add(Motion(0, 0, 0)), *order.add(Sighting(0, 0))]
    for k in range(1, 100):  # views are 5 s behind
        released += order.add(Motion(k * 100 * MS, 0, 0))
        released += order.add(Sighting(max(k - 50, 0) * 100 * MS + 1, 0))
    assert order.too_late == 0 and released[-1].stamp_ns == 49 * 100 * MS + 1
    assert stamps(released) == sorted(stamps(released))


@rows("silent, heard", [(motion, sighting), (sighting, motion)])
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


@settings(max_examples=20)
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
    out = release_all(order, [next(both[turn]) for turn in turns])
    lap = sorted(motions[:60] + looks[:20], key=lambda e: (e.stamp_ns, isinstance(e, Sighting)))
    assert out == lap * (jumps + 1) and order.too_late == 0


def test_the_queue_is_bounded() -> None:
    order = StampOrder(wait=1.0, in_order=True)
    out = [event.stamp_ns for k in range(10_010) for event in order.add(motion(k))]
    assert out == list(range(10))


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(0, 0.5))
def test_delays_within_the_wait_never_change_the_order(seed: int, delay_s: float) -> None:
    rng = np.random.default_rng(seed)
    events: list[Event] = [Motion(k * 33 * MS, 0.5, 0) for k in range(60)]
    events += [Sighting(k * 100 * MS, 0) for k in range(20)]
    arrivals = [event.stamp_ns + rng.uniform(0, delay_s * 1e9) for event in events]
    arrived = [events[k] for k in np.argsort(arrivals, kind="stable")]
    order = StampOrder(wait=0.5)
    out = release_all(order, arrived)
    assert out == sorted(events, key=lambda e: (e.stamp_ns, isinstance(e, Sighting)))
    assert order.too_late == 0
