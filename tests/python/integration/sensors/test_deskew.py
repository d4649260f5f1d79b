# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Motion within scans is undone: against true places of points, live as offline, or said."""

import logging
import pickle
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bags
import fusionslam
from fusionslam.base.arrays import Floats
from fusionslam.datasets.bags import open_bag
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.sensors.frame_builder import FrameBuilder, OnlineConfig
from fusionslam.sensors.imu_buffer import ImuBuffer
from fusionslam.sensors.messages import (
    Event,
    FrameTransform,
    FrameTransforms,
    Imu,
    Odometry,
    Scan,
)
from fusionslam.sensors.transforms import TransformError
from rows import rows

S = 1_000_000_000
START = bags.START
MOUNT = exp(np.array([0.3, 0.1, 1.2, 0.0, 0.1, 0.5]))
"""base_from_lidar."""
SCAN_S = 0.1


def ways(speed: float, turn: float) -> list[float]:
    """A small motion a second: ahead, with a little roll and heave."""
    return [speed, 0.0, 0.05 * min(speed, 1), 0.1 * turn, 0.0, turn]


def pose(motion: list[float], seconds: float | Floats) -> Floats:
    """odom_from_base at constant velocity, (..., 4, 4) of times (...)."""
    return exp(np.multiply.outer(seconds, motion))


def taken(motion: list[float], at: float, places: Floats, times: Floats) -> Floats:
    """Places in odom as the scanner sees them, each at its own time after ``at``."""
    scanner_from_odom = inverse(pose(motion, at + times) @ MOUNT)
    turned = np.einsum("nij,nj->ni", scanner_from_odom[:, :3, :3], places)
    return turned + scanner_from_odom[:, :3, 3]


def drive(
    motion: list[float], *, until: float = 1.4, odometry_hz: float = 50.0, field: str = "time"
) -> tuple[list[Event], Floats]:
    """Scans at 0.2, 0.7 and 1.2 s by a scanner on a robot, and odometry; the true places."""
    random = np.random.default_rng(4)
    ranges = np.r_[np.full(100, 20.0), random.uniform(2, 50, 100)]
    directions = random.standard_normal((200, 3))
    ahead = pose(motion, 0.7) @ MOUNT
    places = ranges[:, None] * directions / np.linalg.norm(directions, axis=1)[:, None]
    places = (ahead @ np.c_[places, np.ones(200)].T).T[:, :3]
    times = np.linspace(0, SCAN_S, 200)
    link = FrameTransform(
        stamp_ns=0, parent="base_link", child="lidar", parent_from_child=MOUNT, static=True
    )
    events = [Event("/tf_static", START, FrameTransforms(transforms=(link,)))]
    for k in range(round(until * odometry_hz)):
        stamp = START + round(k * S / odometry_hz)
        moved = Odometry(
            stamp_ns=stamp,
            frame_id="odom",
            child_frame_id="base_link",
            pose=pose(motion, (stamp - START) / S),
        )
        events.append(Event("/odom", stamp, moved))
    values = {"time": times.astype(np.float32), "t": (times * S).astype(np.uint32)}
    for at in (0.2, 0.7, 1.2):
        stamp = START + round(at * S)
        points = taken(motion, at, places, times).astype(np.float32)
        points[7] = np.nan
        scan = Scan(stamp_ns=stamp, frame_id="lidar", points=points, fields={field: values[field]})
        events.append(Event("/points", stamp, scan))
    return sorted(events, key=lambda event: event.time_ns), places


def build(builder: FrameBuilder, events: Iterable[Event]) -> list[fusionslam.Frame]:
    frames = [frame for event in events for frame in builder.process(event.message)]
    return frames + builder.flush()


def taken_at_stamp(motion: list[float], at: float, places: Floats) -> Floats:
    """What the scanner would have seen at the stamp."""
    return taken(motion, at, places, np.zeros(len(places)))


def errors(frame: fusionslam.Frame, motion: list[float], places: Floats) -> Floats:
    """Metres between a frame's points and what the scanner would have seen at the stamp."""
    assert frame.points is not None
    at = (frame.stamp_ns - START) / S
    true = np.delete(taken_at_stamp(motion, at, places), 7, axis=0)
    return np.linalg.norm(frame.points - true, axis=1)


@rows("turn", [0.0, 0.5, 1.0, 2.0, 3.0])
@rows("speed", [0.0, 5.0, 15.0])
def test_points_are_where_the_scanner_would_have_seen_them_at_the_stamp(
    speed: float, turn: float
) -> None:
    motion = ways(speed, turn)
    events, places = drive(motion)
    builder = FrameBuilder(cameras=())
    frames = build(builder, events)
    assert len(frames) == 3 and not builder.skewed
    for frame in frames:
        off = errors(frame, motion, places)
        # The bound that is asked for is 2 cm in the median, 1 cm at 20 m.
        assert off.max() < 0.004 and np.median(off) < 0.002
        assert frame.deskew is not None and frame.deskew.source == "odometry"
        assert frame.deskew.span == pytest.approx((0.0, SCAN_S))
        turned = np.degrees(np.linalg.norm(motion[3:])) * SCAN_S
        assert frame.deskew.turned_deg == pytest.approx(turned, rel=0.01, abs=1e-6)
        # Nothing stays by which covariances would have to grow.
        assert frame.span is None and frame.point_seconds is None
    bent = build(FrameBuilder(OnlineConfig(deskew=False), cameras=()), events)[1]
    assert bent.deskew is None and bent.span == pytest.approx((0.0, SCAN_S))
    moved = SCAN_S * np.hypot(speed, 20 * turn)
    assert errors(bent, motion, places).max() > 0.3 * moved


def test_a_scan_is_the_same_live_and_from_a_bag(tmp_path: Path) -> None:
    events, _ = drive(ways(5.0, 1.0), field="t", until=1.28)
    path = bags.write_bag(tmp_path / "drive.bag", events)
    with open_bag(path) as bag:
        live = build(FrameBuilder(cameras=()), bag.events())
    stored = fusionslam.open_dataset(path, sensors=["points"])
    as_measured = fusionslam.open_dataset(path, sensors=["points"], deskew=False)
    assert len(live) == len(stored) == 3
    for frame, read, raw in zip(live, stored, as_measured, strict=True):
        assert frame.points is not None and read.points is not None and raw.points is not None
        np.testing.assert_array_equal(frame.points, read.points)
        assert (frame.deskew is None) == (read.deskew is None)
        assert raw.deskew is None
        bend = np.abs(read.points - raw.points).max()
        assert (bend > 0.1) == (read.deskew is not None)
    # Odometry ends before the last point of the last scan.
    assert [frame.deskew is None for frame in live] == [False, False, True]


def test_a_frame_waits_for_odometry_of_its_last_point() -> None:
    motion = ways(2.0, 1.0)
    events, places = drive(motion)
    builder = FrameBuilder(cameras=())
    for event in events:
        for frame in builder.process(event.message):
            late = (event.time_ns - frame.stamp_ns) / S
            assert SCAN_S <= late < SCAN_S + 0.03
            assert errors(frame, motion, places).max() < 0.004


def test_motion_that_odometry_does_not_know_stays_and_is_said(
    caplog: pytest.LogCaptureFixture,
) -> None:
    # The last scan begins at 1.2 s, odometry ends before its last point.
    events, _ = drive(ways(2.0, 1.0), until=1.26)
    builder = FrameBuilder(cameras=())
    with caplog.at_level(logging.WARNING):
        frames = build(builder, events)
    assert [frame.deskew is None for frame in frames] == [False, False, True]
    assert builder.skewed == 1 and not builder.still and frames[2].odometry is not None
    assert frames[2].span == pytest.approx((0.0, SCAN_S))
    (said,) = [each.getMessage() for each in caplog.records]
    assert "motion within scans stays" in said and "needed at" in said


@rows("metres, hz", [(5.0, 50.0), (0.5, 50.0), (8.0, 10.0), (0.2, 100.0)])
def test_odometry_that_jumps_within_a_scan_bends_no_cloud(
    caplog: pytest.LogCaptureFixture, metres: float, hz: float
) -> None:
    events, _ = drive(ways(2.0, 0.5), odometry_hz=hz, until=1.6)
    jumped = []
    for event in events:
        moved = event.message
        if isinstance(moved, Odometry) and moved.stamp_ns > START + 0.75 * S:
            shifted = exp(np.array([metres, 0, 0, 0, 0, 0])) @ moved.pose
            event = replace(event, message=replace(moved, pose=shifted))
        jumped.append(event)
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        frames = build(builder := FrameBuilder(cameras=()), jumped)
    assert [frame.deskew is None for frame in frames] == [False, True, False]
    assert builder.skewed == 1
    assert "odometry jumps" in caplog.text and "expected up to" in caplog.text


def test_odometry_with_pauses_undoes_nothing_and_a_bag_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    events, _ = drive(ways(2.0, 1.0))
    paused = [
        event
        for event in events
        if event.topic != "/odom" or not 0.6 < (event.time_ns - START) / S < 0.95
    ]
    path = bags.write_bag(tmp_path / "drive.bag", paused)
    live = build(builder := FrameBuilder(cameras=()), paused)
    with caplog.at_level(logging.WARNING):
        stored = [*fusionslam.open_dataset(path, sensors=["points"])]
        assert [frame.deskew is None for frame in stored] == [False, True, False]
    assert [frame.deskew is None for frame in live] == [False, True, False]
    assert builder.skewed == 1 and "is not known for 0.36" in caplog.text


def test_robots_may_be_placed_by_another_frame_than_odometry_tells() -> None:
    motion = ways(1.0, 1.0)
    events, places = drive(motion)
    front = exp(np.array([1.5, 0, 0, 0, 0, 0]))
    link = FrameTransform(
        stamp_ns=0, parent="base_link", child="front", parent_from_child=front, static=True
    )
    events.insert(0, Event("/tf_static", START, FrameTransforms(transforms=(link,))))
    frames = build(FrameBuilder(OnlineConfig(robot_frame="front"), cameras=()), events)
    for frame in frames:
        assert errors(frame, motion, places).max() < 0.004


@rows("field", ["time", "timestamp"])
def test_times_of_arrival_do_not_hide_the_times_of_points(tmp_path: Path, field: str) -> None:
    """The scanner's clock is an hour ahead of all others."""
    motion = ways(2.0, 1.0)
    events, places = drive(motion)
    shifted = []
    for event in events:
        taken = event.message
        if isinstance(taken, Scan):
            ahead = taken.stamp_ns + 3600 * S
            times = {field: taken.fields["time"].astype(np.float64)}
            times["timestamp"] = ahead / S + taken.fields["time"].astype(np.float64)
            event = replace(
                event, message=replace(taken, stamp_ns=ahead, fields={field: times[field]})
            )
        shifted.append(event)
    path = bags.write_bag(tmp_path / f"{field}.bag", shifted)
    dataset = fusionslam.open_dataset(path, sensors=["points"], stamps="bag")
    for frame in dataset:
        assert frame.deskew is not None and frame.points is not None
        at = (frame.stamp_ns - START) / S
        off = frame.points - np.delete(taken_at_stamp(motion, at, places), 7, axis=0)
        assert np.linalg.norm(off, axis=1).max() < 0.004


@rows("values", [np.zeros(5), np.zeros((200, 2)), np.array(["a"] * 200)])
def test_times_that_do_not_fit_the_points_stop_no_robot(
    caplog: pytest.LogCaptureFixture, values: Any
) -> None:
    events, _ = drive(ways(2.0, 1.0))
    bad = [
        replace(event, message=replace(event.message, fields={"time": values}))
        if isinstance(event.message, Scan)
        else event
        for event in events
    ]
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        frames = build(FrameBuilder(cameras=()), bad)
    assert len(frames) == 3 and all(frame.deskew is None for frame in frames)
    assert "taken as unknown" in caplog.text


def imu_events(motion: list[float], *, hz: float = 200.0, until: float = 1.4) -> list[Event]:
    """What an IMU on the robot says, whose axes are turned against the robot's."""
    mount = exp(np.array([0.1, 0, 0.5, 0.4, -0.2, 1.1]))
    link = FrameTransform(
        stamp_ns=0, parent="base_link", child="imu", parent_from_child=mount, static=True
    )
    rate = mount[:3, :3].T @ np.array(motion[3:])
    events = [Event("/tf_static", START, FrameTransforms(transforms=(link,)))]
    for k in range(round(until * hz)):
        stamp = START + round(k * S / hz)
        said = Imu(stamp_ns=stamp, frame_id="imu", angular=rate, linear=np.array([0, 0, 9.8]))
        events.append(Event("/imu", stamp, said))
    return events


def in_order(*events: list[Event]) -> list[Event]:
    return sorted([each for some in events for each in some], key=lambda event: event.time_ns)


@rows(
    "odometry_hz, speed, source, most",
    [
        (50.0, 15.0, "odometry", 0.004),
        (10.0, 15.0, "imu and odometry", 0.004),
        (None, 0.0, "imu", 0.004),
    ],
)
def test_an_imu_tells_the_turn_where_odometry_is_slow_or_not_there(
    tmp_path: Path, odometry_hz: float | None, speed: float, source: str, most: float
) -> None:
    motion = [speed, 0, 0, 0, 0.3, 3.0]
    events, places = drive(motion, odometry_hz=odometry_hz or 50.0, until=1.6)
    if odometry_hz is None:
        events = [event for event in events if event.topic != "/odom"]
    events = in_order(events, imu_events(motion, until=1.6))
    live = build(builder := FrameBuilder(OnlineConfig(robot_frame="base_link"), cameras=()), events)
    path = bags.write_bag(tmp_path / f"{source}.bag".replace(" ", "-"), events)
    stored = [*fusionslam.open_dataset(path, sensors=["points"])]
    assert len(live) == len(stored) == 3 and not builder.skewed
    for frame, read in zip(live, stored, strict=True):
        assert frame.deskew is not None and read.deskew is not None and read.points is not None
        assert frame.deskew.source == read.deskew.source == source
        np.testing.assert_array_equal(frame.points, read.points)
        assert errors(frame, motion, places).max() < most


def test_where_odometry_fails_an_imu_tells_the_turn() -> None:
    motion = ways(0.0, 2.0)
    events, places = drive(motion, until=1.24)
    frames = build(
        builder := FrameBuilder(cameras=()), in_order(events, imu_events(motion, until=1.4))
    )
    sources = [frame.deskew.source for frame in frames if frame.deskew is not None]
    assert sources == ["odometry", "odometry", "imu"] and not builder.skewed
    assert errors(frames[2], motion, places).max() < 0.004


def test_an_imu_that_pauses_or_is_nowhere_on_the_robot_tells_nothing() -> None:
    motion = ways(0.0, 2.0)
    events, _ = drive(motion)
    events = [event for event in events if event.topic != "/odom"]
    told = imu_events(motion)
    paused = [each for each in told if not 0.72 < (each.time_ns - START) / S < 0.78]
    lost = [each for each in told if each.topic != "/tf_static"]
    for imu, undone in ((paused, [True, False, True]), (lost, [False, False, False])):
        builder = FrameBuilder(OnlineConfig(robot_frame="base_link"), cameras=())
        frames = build(builder, in_order(events, imu))
        assert [frame.deskew is not None for frame in frames] == undone


@rows("name", ["drive.bag", "drive.mcap", "drive.db3"])
def test_what_an_imu_says_is_kept_by_bags(tmp_path: Path, name: str) -> None:
    events = [event for event in imu_events(ways(0.0, 1.0)) if event.topic == "/imu"][:20]
    path = bags.write_bag(tmp_path / name, events)
    with open_bag(path) as bag:
        read = [*bag.events()]
    assert len(read) == 20
    for one, other in zip(events, read, strict=True):
        assert one.time_ns == other.time_ns and bags.same(one.message, other.message)


@rows("by_tf", [False, True])
def test_an_imu_that_means_something_else_is_not_believed(
    caplog: pytest.LogCaptureFixture, by_tf: bool
) -> None:
    """Its rates are in degrees. Odometry at 5 Hz comes as messages, or in TF alone."""
    motion = [0, 0, 0, 0, 0.3, 2.0]
    events, places = drive(motion, odometry_hz=5.0, until=1.7)
    if by_tf:
        events = [in_tf(event) if event.topic == "/odom" else event for event in events]
    right = imu_events(motion, until=1.7)
    wrong = [
        replace(each, message=replace(each.message, angular=np.degrees(each.message.angular)))
        if isinstance(each.message, Imu)
        else each
        for each in right
    ]
    caplog.clear()
    for imu, source in ((right, "imu and odometry"), (wrong, "odometry")):
        builder = FrameBuilder(OnlineConfig(robot_frame="base_link"), cameras=())
        with caplog.at_level(logging.WARNING):
            frames = build(builder, in_order(events, imu))
        assert len(frames) == 3
        assert {frame.deskew.source for frame in frames if frame.deskew} == {source}
        assert errors(frames[1], motion, places).max() < 0.03
    assert "are its rates in rad/s" in caplog.text


def in_tf(event: Event) -> Event:
    assert isinstance(event.message, Odometry)
    return Event("/tf", event.time_ns, FrameTransforms(transforms=(event.message.transform,)))


def test_an_imu_that_falls_silent_holds_nothing_up() -> None:
    motion = ways(2.0, 1.0)
    events, _ = drive(motion, odometry_hz=10.0, until=1.7)
    builder, waited = FrameBuilder(cameras=()), {}
    for event in in_order(events, imu_events(motion, until=0.4)):
        for frame in builder.process(event.message):
            assert frame.deskew is not None
            waited[frame.deskew.source] = (event.time_ns - frame.stamp_ns) / S
    assert waited["imu and odometry"] < 0.21 and waited["odometry"] < 0.21


def test_an_imu_whose_clock_goes_back_takes_no_frame_along() -> None:
    motion = ways(2.0, 1.0)
    imu = imu_events(motion)
    imu[100] = replace(imu[100], message=replace(imu[100].message, stamp_ns=START - 2 * S))
    frames = build(builder := FrameBuilder(cameras=()), in_order(drive(motion)[0], imu))
    assert len(frames) == 3 and not builder.dropped and not builder.jumps


@rows(
    "changes, words",
    [
        ({"angular": np.array([0, np.nan, 0])}, "not finite"),
        ({"angular": np.zeros(2)}, "expected three numbers"),
        ({"angular": None}, "expected three numbers"),
        ({"stamp_ns": None}, "stamp"),
        ({"frame_id": "other"}, "'other', expected those of 'imu'"),
    ],
)
def test_what_no_imu_says_is_refused_and_counted(
    caplog: pytest.LogCaptureFixture, changes: dict[str, Any], words: str
) -> None:
    motion = ways(2.0, 1.0)
    imu = imu_events(motion)
    imu[90] = replace(imu[90], message=replace(imu[90].message, **changes))
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        frames = build(builder := FrameBuilder(cameras=()), in_order(drive(motion)[0], imu))
    assert len(frames) == 3 and builder.refused["Imu"] == 1 and words in caplog.text


def test_of_equal_stamps_the_first_counts_in_any_order() -> None:
    def said(milliseconds: int, rate: float) -> Imu:
        stamp_ns, angular = milliseconds * S // 1000, np.array([0, 0, rate])
        return Imu(stamp_ns=stamp_ns, frame_id="imu", angular=angular, linear=np.zeros(3))

    turns = []
    for order in ((0, 10, 20), (0, 20, 10)):
        buffer = ImuBuffer()
        for milliseconds in order:
            buffer.add(said(milliseconds, 1.0))
            buffer.add(said(milliseconds, 50.0))
        turns.append(buffer.turned(np.array([0, S // 100]))[1])
    np.testing.assert_array_equal(*turns)
    np.testing.assert_allclose(turns[0], exp(np.array([0, 0, 0, 0, 0, 0.01]))[:3, :3], atol=1e-12)


def test_a_bag_with_an_imu_is_read_alike_by_threads_and_other_processes(tmp_path: Path) -> None:
    motion = ways(2.0, 1.0)
    events = in_order(drive(motion, odometry_hz=10.0, until=1.7)[0], imu_events(motion, until=1.7))
    path = bags.write_bag(tmp_path / "drive.bag", events)
    dataset = fusionslam.open_dataset(path, sensors=["points"])
    with ThreadPoolExecutor(3) as pool:
        undone = [frame.deskew for frame in pool.map(dataset.__getitem__, range(3))]
    assert [each.source for each in undone if each is not None] == ["imu and odometry"] * 3
    copy = pickle.loads(pickle.dumps(dataset))
    np.testing.assert_array_equal(copy[1].points, dataset[1].points)


def test_the_turn_of_an_imu_is_that_of_its_rates() -> None:
    """Against small steps: rates that change while they turn about changing axes."""
    times = np.arange(0, 0.5, 0.005)

    def rate(t: Floats) -> Floats:
        return np.stack([np.sin(7 * t), 2 * np.cos(3 * t), 1 + t], axis=-1)

    buffer = ImuBuffer()
    for t, angular in zip(times, rate(times), strict=True):
        buffer.add(Imu(stamp_ns=round(t * S), frame_id="imu", angular=angular, linear=np.zeros(3)))
    fine = np.arange(0.1003, 0.3, 1e-5)
    true = np.eye(3)
    steps = np.c_[np.zeros((len(fine), 3)), rate(fine + 5e-6) * 1e-5]
    for turn in exp(steps)[:, :3, :3]:
        true = true @ turn
    found = buffer.turned(np.array([round(0.1003 * S), round(0.3 * S)]))
    np.testing.assert_allclose(found[0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found[1], true, atol=5e-5)
    buffer.forget_after(round(0.25 * S))
    with pytest.raises(TransformError, match="is not known from 0") as error:
        buffer.turned(np.array([round(0.1 * S), round(0.3 * S)]))
    assert error.value.may_come


def test_points_of_one_time_and_robots_without_odometry_stay_as_they_are() -> None:
    events, _ = drive(ways(2.0, 1.0))
    once = [
        replace(event, message=replace(event.message, fields={"time": np.zeros(200, np.float32)}))
        if isinstance(event.message, Scan)
        else event
        for event in events
    ]
    without = [event for event in events if event.topic != "/odom"]
    for given in (once, without):
        builder = FrameBuilder(cameras=())
        frames = build(builder, given)
        assert len(frames) == 3 and not builder.skewed
        assert all(frame.deskew is None for frame in frames)


def test_arrays_that_do_not_fit_are_refused() -> None:
    points, seconds, poses = np.ones((3, 3), np.float32), np.zeros(3), np.eye(4)[None]
    good = (points, seconds, poses, (0.0, 0.1))
    np.testing.assert_array_equal(fusionslam.deskew(*good), points)
    cases = [
        ((points, np.zeros(2), poses, (0.0, 0.1)), ShapeError, "2 times for 3 points"),
        ((points, np.array([0, np.nan, 0]), poses, (0.0, 0.1)), DataError, "time of point 1"),
        ((points, seconds, poses[:0], (0.0, 0.1)), DataError, "no pose"),
        ((points, seconds, poses * np.nan, (0.0, 0.1)), DataError, "not finite"),
        ((points, seconds, poses, (0.1, 0.0)), DataError, "from 0.100000 to 0.0"),
        ((points, seconds, poses, (-np.inf, np.inf)), DataError, "to inf"),
        ((points, seconds, np.eye(4), (0.0, 0.1)), ShapeError, "expected (K, 4, 4)"),
    ]
    for given, kind, words in cases:
        with pytest.raises(kind) as error:
            fusionslam.deskew(*given)
        assert words in str(error.value)
