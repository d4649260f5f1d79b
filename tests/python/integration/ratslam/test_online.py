# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""RatSLAM out of messages as they arrive, simulated and recorded."""

import logging
import signal
import threading
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drives import (
    SECOND,
    Message,
    circles,
    everything,
    in_order,
    looks_of,
    odometry,
    on_map,
    order_by_arrival,
    process_all,
    process_and_flush,
    same,
    sightings,
    take,
)
from fusionslam.errors import ConfigError
from fusionslam.geometry.odometry_noise import DRIFT
from fusionslam.pipelines.drives import open_drive
from fusionslam.pipelines.map_events import during, events_of, motions_of
from fusionslam.pipelines.maps import run_ratslam
from fusionslam.ratslam import (
    GivenView,
    Look,
    Motion,
    OnlineRatSlam,
    OnlineRatSlamConfig,
    RatSlam,
    Sighting,
    Step,
)
from fusionslam.ratslam.online import (
    BAD_EVENT,
    BAD_ODOMETRY,
    BAD_VIEW,
    TOO_LATE,
    ZERO_STAMP,
    map_from_odometry,
)
from fusionslam.ratslam.view_sources import build_view_source
from fusionslam.sensors.messages import Odometry
from recordings import write_drive
from rows import rows
from threads import run_together

TENTH = SECOND // 10
LAST = 19 * TENTH + 7


class Drive:
    """Odometry from 3 s before the first view to 2 s after the last one, and what a run makes of
    it."""

    def __init__(self, laps: float, preset: str | None = None) -> None:
        way = circles(laps)
        seen = [one for one in sightings(way) if one.stamp_ns > 3 * SECOND]
        # Ids begin at 0 and skip none.
        numbers = {view: k for k, view in enumerate(dict.fromkeys(s.view_id for s in seen))}
        self.odometry = odometry(way)
        # Some views have the stamp of odometry, but not the last one.
        same_ns = {one.stamp_ns for one in self.odometry}
        last = max(k for k, one in enumerate(seen[:-8]) if one.stamp_ns not in same_ns)
        self.seen = [replace(one, view_id=numbers[one.view_id]) for one in seen[: last + 1]]
        assert any(one.stamp_ns in same_ns for one in self.seen)
        self.looks = looks_of(self.seen)
        stamps_ns = np.array([one.stamp_ns for one in self.looks], np.int64)
        self.slam = RatSlam(preset=preset)
        self.steps = take(self.slam, in_order(during(self.odometry, stamps_ns), self.seen))


@pytest.fixture(scope="module")
def drive() -> Drive:
    return Drive(1.3)


@rows("preset", ["robust", "openratslam"])
def test_the_steps_are_those_of_a_run_up_to_the_last_view(preset: str) -> None:
    drive = Drive(1.2, preset)
    online = OnlineRatSlam(ratslam={"preset": preset})
    soon = [one for one in drive.odometry if one.stamp_ns < drive.seen[-1].stamp_ns + SECOND]
    steps = process_all(online, order_by_arrival(soon, drive.looks, 0))
    # The odometry that follows the last view completes it, and waits itself.
    assert steps == drive.steps[:-1] and steps[-1].looked
    rest = online.flush()
    assert rest[0] == drive.steps[-1] and len(rest) == 30
    assert not any(step.looked for step in rest[1:])
    assert not online.refused and online.jumps == 0


def test_the_map_after_the_same_events_is_the_same_to_the_last_bit(drive: Drive) -> None:
    online = OnlineRatSlam()
    stamps_ns = np.array([one.stamp_ns for one in drive.looks], np.int64)
    process_and_flush(
        online, [*order_by_arrival(during(drive.odometry, stamps_ns), drive.looks, 1)]
    )
    assert same(on_map(online.slam), on_map(drive.slam))


@settings(max_examples=4)
@drawn(st.integers(0, 2**32 - 1), st.floats(0, 20), st.floats(0, 1.4))
def test_no_interleaving_changes_a_step(
    drive: Drive, seed: int, lag_s: float, jitter_s: float
) -> None:
    online = OnlineRatSlam()
    messages = order_by_arrival(drive.odometry, drive.looks, seed, lag_s=lag_s, jitter_s=jitter_s)
    steps = process_and_flush(online, messages)
    assert steps[: len(drive.steps)] == drive.steps
    assert not online.refused and online.jumps == 0


@rows("views_first", [True, False])
def test_one_whole_stream_before_the_other_changes_no_step(drive: Drive, views_first: bool) -> None:
    streams: list[Any] = [drive.odometry, drive.looks]
    messages = [one for stream in streams[:: -1 if views_first else 1] for one in stream]
    online = OnlineRatSlam(order={"wait": 60.0})
    assert process_and_flush(online, messages)[: len(drive.steps)] == drive.steps
    assert not online.refused


def test_a_step_comes_as_soon_as_both_streams_have_come_as_far() -> None:
    online = OnlineRatSlam()
    assert process_all(online, [Motion(k * TENTH, 0.5, 0.0) for k in range(20)]) == []
    # The last odometry before it counts, and the view, which all later odometry is beyond.
    steps = online.process(Look(12 * TENTH + 1, GivenView(0, True)))
    assert [step.stamp_ns for step in steps] == [12 * TENTH, 12 * TENTH + 1]
    steps = online.process(Look(15 * TENTH, GivenView(0, False)))
    assert [step.stamp_ns // TENTH for step in steps] == [13, 14, 15, 15]
    assert [step.looked for step in steps] == [False, False, False, True]


def test_views_that_fall_silent_are_waited_for_no_longer_than_the_wait() -> None:
    online = OnlineRatSlam(order={"wait": 1.0})
    process_all(online, [Motion(0, 0.5, 0.0), Look(0, GivenView(0, True))])
    behind = []
    for k in range(1, 40):
        steps = online.process(Motion(k * TENTH, 0.5, 0.0))
        behind.append(k - steps[-1].stamp_ns // TENTH if steps else None)
    assert behind[:10] == [None] * 10 and set(behind[11:]) == {11}
    # Late for odometry that was taken; then in time again.
    late = online.process(Look(20 * TENTH, GivenView(1, True)))
    assert late == [] and online.refused == {TOO_LATE: 1}
    assert online.process(Look(39 * TENTH, GivenView(1, True)))[-1].view_id == 1


def test_odometry_alone_is_bounded_and_makes_no_map() -> None:
    online = OnlineRatSlam()
    assert process_all(online, [Motion(k * TENTH, 0.5, 0.0) for k in range(10_100)]) == []
    steps = online.process(Look(10_099 * TENTH, GivenView(0, True)))
    assert [step.stamp_ns // TENTH for step in steps] == [10_099, 10_099]


def odometry_with(**wrong: Any) -> Odometry:
    stamp = {"stamp_ns": 21 * TENTH, "frame_id": "odom", "child_frame_id": ""}
    return Odometry(**stamp | {"pose": np.eye(4)} | wrong)


BAD: list[tuple[Any, str]] = [
    (Motion(np.nan, 0.5, 0), BAD_EVENT),
    (Motion(2**63, 0.5, 0), BAD_EVENT),
    ("odometry", BAD_EVENT),
    (Sighting(20 * TENTH, 0), BAD_EVENT),
    (Motion(0, 0.5, 0), ZERO_STAMP),
    (Motion(15 * TENTH, 0.5, 0), TOO_LATE),
    (Motion(20 * TENTH, 0.5, 0), BAD_ODOMETRY),  # twice
    (Motion(21 * TENTH, np.nan, 0), BAD_ODOMETRY),
    (odometry_with(pose=np.eye(3)), BAD_ODOMETRY),
    (odometry_with(linear=None), BAD_ODOMETRY),
    (odometry_with(angular="fast"), BAD_ODOMETRY),
    (Look(LAST, GivenView(0, False)), BAD_VIEW),  # twice
    (Look(21 * TENTH, np.zeros((4, 4))), BAD_VIEW),
]
BAD += [(Look(21 * TENTH, GivenView(wrong, False)), BAD_VIEW) for wrong in (-2, 0.5, "1")]
BAD += [
    (Look(21 * TENTH, GivenView(1, True, 0.0, wrong)), BAD_VIEW)
    for wrong in ((1.0,), (np.nan, 0), (2e3, 0))
]
BAD += [(Look(21 * TENTH, GivenView(0, False, np.inf)), BAD_VIEW)]


@rows("event, cause", BAD)
def test_a_bad_event_is_counted_and_logged_once_and_changes_nothing(
    event: Any, cause: str, caplog: pytest.LogCaptureFixture
) -> None:
    good = [Motion(k * TENTH, 0.5, 0.0) for k in range(21)]
    looks = [Look(stamp_ns, GivenView(0, stamp_ns == 0)) for stamp_ns in (0, 10 * TENTH, LAST)]
    after = [Motion(30 * TENTH, 0.5, 0.0), Look(30 * TENTH, GivenView(1, True))]
    whole, online = OnlineRatSlam(), OnlineRatSlam()
    expected = process_and_flush(whole, [*good, *looks, *after])
    steps = process_all(online, [*good, *looks])
    with caplog.at_level(logging.WARNING):
        steps += process_all(online, [event, event, *after]) + online.flush()
    assert steps == expected and online.refused == {cause: 2} and online.jumps == 0
    assert same(everything(online.slam), everything(whole.slam))
    assert len(caplog.messages) == 1 and cause in caplog.text


def test_ctrl_c_takes_effect_after_the_step(
    drive: Drive, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    online, messages = OnlineRatSlam(), order_by_arrival(drive.odometry, drive.looks, 0)
    step, done = online.slam.step, list[Step]()

    def interrupted(event: Any) -> Step:
        if len(done) == 100:
            signal.raise_signal(signal.SIGINT)
        done.append(step(event))
        return done[-1]

    monkeypatch.setattr(online.slam, "step", interrupted)
    rest = iter(messages)
    with pytest.raises(KeyboardInterrupt):
        process_all(online, rest)
    assert len(done) > 100 and online.last == done[-1]
    online.save(tmp_path / "map.npz")
    process_all(online, rest)
    online.flush()
    assert done[: len(drive.steps)] == drive.steps


def test_wrong_configurations_are_named_and_others_keep_their_defaults() -> None:
    with pytest.raises(ConfigError, match=r"order\.wait"):
        OnlineRatSlam(order={"wait": -1})
    with pytest.raises(ConfigError, match=r"ratslam\.prese"):
        OnlineRatSlam(ratslam={"prese": "robust"})
    changed = OnlineRatSlam(order={"wait": 3.0}).config
    assert (changed.order.wait, changed.order.in_order, changed.order.jump) == (3.0, True, 1.0)
    assert changed.ratslam == OnlineRatSlamConfig().ratslam


def tilted_odometry(x: float, y: float, yaw: float) -> Odometry:
    """On a slope: 0.3 m up, pitched by 0.1 rad and rolled by -0.2 rad."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("ZYX", [yaw, 0.1, -0.2]).as_matrix()
    pose[:3, 3] = x, y, 0.3
    return Odometry(stamp_ns=0, frame_id="odom", child_frame_id="base", pose=pose)


def test_the_odometry_frame_lies_where_it_puts_the_robot_on_its_pose_of_the_map() -> None:
    said = tilted_odometry(3.0, -2.0, 2.5)
    found = map_from_odometry((1.0, 4.0, -3.0), said)
    assert found.dtype == np.float64
    robot = found @ said.pose
    np.testing.assert_allclose(robot[:3, 3], [1.0, 4.0, 0.3], atol=1e-12)
    turns = Rotation.from_matrix(robot[:3, :3]).as_euler("ZYX")
    np.testing.assert_allclose(turns, [-3.0, 0.1, -0.2], atol=1e-12)
    np.testing.assert_allclose(found[2], [0, 0, 1, 0])
    assert map_from_odometry((0, 0, 0), replace(said, pose=np.full((4, 4), np.nan))) is None


def test_the_odometry_frame_is_that_of_the_last_step(drive: Drive) -> None:
    online = OnlineRatSlam()
    assert online.map_from_odometry is None
    by_stamp = {one.stamp_ns: one for one in drive.odometry}
    last: Step | None = None
    for message in order_by_arrival(drive.odometry, drive.looks, 3):
        for last in online.process(message):
            if last.stamp_ns in by_stamp:
                said = by_stamp[last.stamp_ns]
        if last is not None:
            found = online.map_from_odometry
            assert found is not None and online.last == last
            robot = found @ said.pose
            x, y, heading = last.pose
            np.testing.assert_allclose(robot[:2, 3], [x, y], atol=1e-9)
            np.testing.assert_allclose(robot[:2, 0], [np.cos(heading), np.sin(heading)], atol=1e-9)


def test_velocities_alone_have_no_frame() -> None:
    online = OnlineRatSlam()
    process_and_flush(online, [tilted_odometry(0, 0, 0), Look(0, GivenView(0, True))])
    assert online.map_from_odometry is not None
    process_and_flush(online, [Motion(TENTH, 0.5, 0.0), Look(TENTH, GivenView(0, False))])
    assert online.map_from_odometry is None


def test_two_threads_and_a_third_that_saves_give_the_same_steps(
    drive: Drive, tmp_path: Path
) -> None:
    online, steps, lock = OnlineRatSlam(order={"wait": 1e4}), list[Step](), threading.Lock()

    def run(messages: Sequence[Message]) -> None:
        for message in messages:
            with lock:  # who publishes what is returned has to keep its order, too
                steps.extend(online.process(message))

    def save() -> None:
        for _ in range(5):
            online.save(tmp_path / "map.npz")

    run_together(partial(run, drive.odometry), partial(run, drive.looks), save)
    assert (steps + online.flush())[: len(drive.steps)] == drive.steps
    OnlineRatSlam.load(tmp_path / "map.npz")


class Recorded(NamedTuple):
    """The steps of a run, and the messages of a robot that recognises the views by itself."""

    steps: list[Step]
    odometry: list[Message]
    looks: list[Message]


def record_drive(source: Path) -> Recorded:
    steps: list[Step] = []
    run_ratslam(source, "objects", watch=lambda step, *_: steps.append(step))
    tour, matcher = open_drive(source), build_view_source("objects")
    events = events_of(tour, matcher)
    looks: list[Message] = []
    for index, stamp_ns in enumerate(events.look_stamps_ns.tolist()):
        stored = len(matcher.matcher)
        seen = matcher.look(events.item(index), stamp_ns)
        is_new = seen.view_id >= stored
        values = (seen.relative_rotation, seen.relative_place, seen.reason)
        looks.append(Look(stamp_ns, GivenView(seen.view_id, is_new, *values)))
    return Recorded(steps, [*motions_of(tour, None, DRIFT)[1]], looks)


def check_orders(drive: Recorded) -> None:
    """The steps are those of the recording whatever arrives first."""
    assert len(drive.steps) > 500
    for seed, lag_s in enumerate((0.02, 0.1, 0.5)):
        online = OnlineRatSlam()
        messages = order_by_arrival(drive.odometry, drive.looks, seed, lag_s=lag_s, jitter_s=0.3)
        steps = process_and_flush(online, messages)
        assert steps[: len(drive.steps)] == drive.steps
        assert not any(step.looked for step in steps[len(drive.steps) :])
        assert not online.refused and online.jumps == online.views.restarts == 0


@pytest.mark.slow
def test_no_order_of_arrival_changes_the_steps_of_a_recording(tmp_path: Path) -> None:
    check_orders(record_drive(write_drive(tmp_path / "drive.npz")))


@pytest.mark.nightly
def test_no_order_of_arrival_changes_the_steps_of_a_bag(test_data: Path) -> None:
    check_orders(record_drive(test_data / "bags" / "small_house_20s.bag"))
