# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry of scans and IMU as they arrive is that of their recording, or says what is lacking."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from error_codes import has_code
from fusionslam import open_dataset
from fusionslam.base.arrays import Floats
from fusionslam.datasets.bags import open_bag
from fusionslam.errors import FusionSlamError
from fusionslam.geometry.se3 import inverse
from fusionslam.odometry import LidarOdometryConfig, LiveOdometry
from fusionslam.pipelines.lidar_odometry import track_lidar
from fusionslam.sensors.messages import FrameTransforms, Imu, Message, Odometry, Scan
from fusionslam.sensors.robot_frames import RobotFrames
from inertial_house import inertial_house
from rows import rows

pytest.importorskip("rko_lio", reason="the library of odometry by LiDAR and IMU is an extra")

S = 1_000_000_000
SCANS = 12
"""That most tests drive: their processor time is limited."""


class Robot:
    """What reaches a robot's odometry, and what comes of it."""

    def __init__(self, imu: str = "always") -> None:
        self.frames = RobotFrames(history_s=10)
        self.refused: list[FusionSlamError] = []
        config = LidarOdometryConfig(imu=imu)
        self.odometry = LiveOdometry(
            config, self.frames, self.refused.append, wait_s=0.5, jump_s=1.0
        )
        self.found: list[Odometry] = []

    def take(self, messages: Iterable[Message]) -> None:
        for message in messages:
            if isinstance(message, Imu):
                self.frames.imu.add(message)
            elif isinstance(message, FrameTransforms):
                self.frames.add(message)
            if isinstance(message, Scan | Imu | FrameTransforms):
                self.found += self.odometry.process(message)

    def end(self) -> None:
        self.found += self.odometry.settle()

    @property
    def poses(self) -> Floats:
        return np.stack([each.pose for each in self.found])

    @property
    def codes(self) -> list[str]:
        return [each.code for each in self.refused]


@pytest.fixture(scope="module")
def house() -> Path:
    return inertial_house()


@pytest.fixture(scope="module")
def messages(house: Path) -> list[Message]:
    """All but the robot's own odometry and truth, in the order of the bag."""
    with open_bag(house) as bag:
        every = [event.message for event in bag.events()]
    kept: list[Message] = []
    for message in every:
        if isinstance(message, FrameTransforms):
            links = tuple(each for each in message.transforms if each.static)
            kept += [FrameTransforms(transforms=links)] if links else []
        elif isinstance(message, Scan | Imu):
            kept.append(message)
    return kept


def first_scans(messages: Iterable[Message], count: int = SCANS) -> Iterator[Message]:
    """Until so many scans, with what the IMU says 0.2 s longer."""
    scans, end_ns = 0, None
    for message in messages:
        if isinstance(message, Scan):
            scans += 1
            if scans > count:
                continue
            end_ns = message.stamp_ns + S // 5 if scans == count else None
        if isinstance(message, Imu) and end_ns is not None and message.stamp_ns > end_ns:
            return
        yield message


@pytest.fixture(scope="module")
def recorded(house: Path) -> Floats:
    track = track_lidar(open_dataset(house, sensors=["points"]), LidarOdometryConfig(imu="always"))
    return track.poses


def stamp_of(message: Message) -> int:
    return 0 if isinstance(message, FrameTransforms) else message.stamp_ns


def delayed(messages: Iterable[Message], kind: type, delay_s: float) -> list[Message]:
    """The same messages, those of a kind arriving later."""

    def arrival(message: Message) -> float:
        return stamp_of(message) + (delay_s * S if isinstance(message, kind) else 0)

    return sorted(messages, key=arrival)


@pytest.mark.slow
def test_a_whole_drive_is_tracked_as_its_recording_is(
    messages: list[Message], recorded: Floats
) -> None:
    robot = Robot()
    robot.take(messages)
    # The end of the stream flushes the scans whose end the IMU has not reached.
    robot.end()
    assert robot.poses.tobytes() == recorded.tobytes()
    assert robot.refused == [] and robot.odometry.restarts == 0
    assert {(each.frame_id, each.child_frame_id) for each in robot.found} == {
        ("odom", robot.frames.robot)
    }
    assert "by scans and IMU (gravity 9." in robot.odometry.state


@pytest.mark.slow
@rows(
    "arrange",
    [
        lambda every: delayed(every, Imu, 0.35),
        lambda every: delayed(every, Scan, 0.4),
        lambda every: delayed(every, FrameTransforms, 1000.2),
        lambda every: sorted(every, key=stamp_of),
    ],
)
def test_the_order_in_which_topics_arrive_is_no_matter(
    arrange: Callable[[list[Message]], list[Message]], messages: list[Message], recorded: Floats
) -> None:
    robot = Robot()
    robot.take(arrange([*first_scans(messages)]))
    robot.end()
    assert robot.poses.tobytes() == recorded[:SCANS].tobytes()
    assert robot.refused == []


def test_a_scan_waits_until_the_imu_is_beyond_its_last_point(messages: list[Message]) -> None:
    robot = Robot()
    every = [*first_scans(messages, 3)]
    until = [each for each in every if not isinstance(each, Imu)]
    robot.take(until)
    assert robot.found == []  # and so the first two
    imus = [each for each in every if isinstance(each, Imu)]
    third = [each for each in until if isinstance(each, Scan)][2]
    assert third.span is not None
    end_ns = third.stamp_ns + round(third.span[1] * S)
    robot.take(each for each in imus if each.stamp_ns <= end_ns)
    assert [each.stamp_ns < third.stamp_ns for each in robot.found] == [True, True]
    robot.take(each for each in imus if each.stamp_ns > end_ns)
    assert robot.found[-1].stamp_ns == third.stamp_ns


def begin_of(messages: Iterable[Message]) -> int:
    return next(each.stamp_ns for each in messages if isinstance(each, Scan))


def without_imu(messages: list[Message], begin_s: float, end_s: float) -> list[Message]:
    begin = begin_of(messages)
    return [
        each
        for each in messages
        if not (isinstance(each, Imu) and begin_s * S < each.stamp_ns - begin < end_s * S)
    ]


@pytest.mark.slow
@rows(
    "lost_s, restarts",
    [
        ((-10.0, 100.0), 0),  # there is none
        ((-10.0, 0.65), 0),  # it begins late
        ((0.45, 0.85), 1),  # it pauses
        ((0.45, 100.0), 1),  # it ends
    ],
)
def test_what_an_imu_does_not_say_is_counted_and_named(
    lost_s: tuple[float, float], restarts: int, messages: list[Message]
) -> None:
    robot = Robot()
    robot.take(without_imu([*first_scans(messages, 20)], *lost_s))
    robot.end()
    assert {*robot.codes} == {"no-imu"}
    assert robot.odometry.restarts == restarts
    counts = robot.odometry.counts
    assert counts["tracked"] + counts["scans left out"] == 20
    begin = begin_of(messages)
    seconds = [(each.stamp_ns - begin) / S for each in robot.found]
    if lost_s[1] < 2 and restarts:  # it goes on from where it was
        assert seconds[-1] > 1.8 and min(seconds) == 0
        steps = np.linalg.norm(np.diff(robot.poses[:, :3, 3], axis=0), axis=1)
        assert steps.max() < 0.2
    elif lost_s[1] < 2:
        assert 0.5 < min(seconds) < 0.9 and seconds[-1] > 1.8
    elif restarts:
        assert 0.3 < max(seconds) < 0.5
    else:
        assert seconds == []


def test_an_imu_of_another_clock_is_named(messages: list[Message]) -> None:
    for hours in (-1, 1):
        robot = Robot()
        moved = [
            replace(each, stamp_ns=each.stamp_ns + hours * 3600 * S)
            if isinstance(each, Imu)
            else each
            for each in first_scans(messages, 8)
        ]
        robot.take(moved)
        robot.end()
        assert {*robot.codes} == {"no-imu"} and robot.found == []


def test_units_that_are_none_are_refused_and_tried_again_once_in_a_second(
    messages: list[Message],
) -> None:
    robot = Robot()
    robot.take(
        replace(each, linear=each.linear / 2) if isinstance(each, Imu) else each
        for each in first_scans(messages, 14)
    )
    robot.end()
    assert robot.found == [] and robot.codes == ["imu-unit"] * 2
    assert robot.odometry.counts["scans left out"] == 14


def test_scans_without_times_are_named(messages: list[Message]) -> None:
    robot = Robot()
    robot.take(
        replace(each, fields={}) if isinstance(each, Scan) else each
        for each in first_scans(messages, 2)
    )
    robot.end()
    assert robot.codes == ["no-times"] * 2


def test_a_clock_that_goes_back_begins_anew_at_the_last_pose(messages: list[Message]) -> None:
    robot = Robot()
    driven = [*first_scans(messages, 4)]
    robot.take(driven)
    robot.end()
    last = robot.found[-1].pose
    later = [
        replace(each, stamp_ns=each.stamp_ns - 100 * S)
        for each in driven
        if hasattr(each, "stamp_ns")
    ]
    robot.take(later)
    robot.end()
    assert len(robot.found) == 8 and robot.refused == []
    np.testing.assert_array_equal(robot.found[4].pose, last @ robot.found[0].pose)
    np.testing.assert_allclose(inverse(last) @ robot.found[-1].pose, last, atol=1e-9)


def test_scans_alone_need_no_imu(house: Path, messages: list[Message]) -> None:
    pytest.importorskip("kiss_icp", reason="the library of odometry by LiDAR is an extra")
    robot = Robot("never")
    robot.take(each for each in first_scans(messages, 5) if not isinstance(each, Imu))
    dataset = open_dataset(house, sensors=["points"])[:5].as_measured()
    track = track_lidar(dataset, LidarOdometryConfig(imu="never"))
    assert robot.poses.tobytes() == track.poses.tobytes()
    assert robot.odometry.state.startswith("by scans alone")


def test_a_missing_package_is_found_at_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = "fusionslam.odometry.inertial_matcher._start"

    def fail() -> None:
        raise FusionSlamError("none", code="missing-extra", fields=("inertial",))

    monkeypatch.setattr(missing, fail)
    with pytest.raises(FusionSlamError, check=has_code("missing-extra", "inertial")):
        Robot()
