# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Everyday trouble of robots: late TF, lost images, bursts, two publishers, clocks that jump."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bags import SECOND, START
from fusionslam.datasets.bags.messages import stamp_of, value_of
from fusionslam.ros.runtime.message_queue import SECOND_PUBLISHER, TOO_MANY
from fusionslam.sensors.frame_builder import NO_TRANSFORM
from fusionslam.sensors.messages import FrameTransforms, Odometry, Picture, Scan
from fusionslam.sensors.synchronizer import NO_IMAGE
from robots import IMAGES, INFOS, SCANS, Sent, drive_messages, only, spoil, without
from ros_master import needs_ros
from ros_node import Desk, causes
from rows import rows

pytestmark = needs_ros

CLOUDS = "rgb_cloud"
DRIVE = drive_messages()
SCAN_STAMPS = [scan.stamp_ns for scan in only(DRIVE, SCANS)]


def fusion(**parameters: Any) -> Desk:
    return Desk("data_fusion", **parameters)


def play(desk: Desk, messages: Sent) -> None:
    for topic, value in messages:
        desk.give(topic, value)


def played(messages: Sent, **parameters: Any) -> Desk:
    """A node that was given messages, and then nothing for a while."""
    desk = fusion(**parameters)
    play(desk, messages)
    desk.worker.idle()
    return desk


def stamps(desk: Desk) -> list[int]:
    return [stamp_of(cloud.header.stamp) for cloud in desk.outlet.of(CLOUDS)]


def clouds(desk: Desk) -> list[Scan]:
    values = [value_of(m, "sensor_msgs/PointCloud2", CLOUDS) for m in desk.outlet.of(CLOUDS)]
    return [value for value in values if isinstance(value, Scan)]


def late(messages: Sent, topic: str, seconds: float) -> Sent:
    """A topic's messages arrive later than they were stamped; all else in order."""

    def when(item: tuple[int, tuple[str, Any]]) -> float:
        number, (name, value) = item
        stamp_ns = getattr(value, "stamp_ns", START)
        return stamp_ns / SECOND + seconds * (name == topic) + 1e-9 * number

    return [entry for _, entry in sorted(enumerate(messages), key=when)]


def same(first: Desk, second: Desk) -> bool:
    pairs = list(zip(clouds(first), clouds(second), strict=True))
    return all(
        a.stamp_ns == b.stamp_ns
        and np.array_equal(a.points, b.points)
        and np.array_equal(a.colors, b.colors)
        for a, b in pairs
    )


@pytest.fixture(scope="module")
def usual() -> Desk:
    desk = played(DRIVE)
    assert stamps(desk) == SCAN_STAMPS and all(len(cloud.points) for cloud in clouds(desk))
    return desk


def test_transforms_that_come_after_the_first_scans_lose_none(usual: Desk) -> None:
    desk, moment = fusion(), START + 3 * SECOND // 2
    tf = DRIVE[:1]
    before = [entry for entry in DRIVE[1:] if entry[1].stamp_ns <= moment]
    after = [entry for entry in DRIVE[1:] if entry[1].stamp_ns > moment]
    play(desk, before)
    assert not stamps(desk)
    play(desk, tf + after)
    desk.worker.idle()
    assert same(desk, usual) and not desk.problems()


def test_transforms_that_come_very_late_lose_the_scans_before(
    caplog: pytest.LogCaptureFixture,
) -> None:
    desk = played(without(DRIVE, "/tf_static"))
    assert not stamps(desk) and causes(caplog).count(NO_TRANSFORM) == 1
    play(desk, drive_messages(later=10))
    desk.worker.idle()
    assert len(stamps(desk)) == len(SCAN_STAMPS)


@rows("topic", ["odom", IMAGES, INFOS])
def test_messages_that_arrive_a_second_late_change_nothing(topic: str, usual: Desk) -> None:
    # At five times the speed, so long takes a thread that waits for a fifth of a second.
    # Before the first odometry, only the parameter tells the robot's name.
    desk = played(late(DRIVE, topic, 1.0), online={"robot_frame": "base"})
    assert same(desk, usual) and desk.node.report()["without odometry"] == 0


def test_images_that_are_lost_on_the_way_cost_only_their_scans(
    caplog: pytest.LogCaptureFixture,
) -> None:
    lost = range(START + SECOND, START + 2 * SECOND)
    kept = [entry for entry in DRIVE if entry[0] != IMAGES or entry[1].stamp_ns not in lost]
    desk = played(kept)
    # Images further away than 0.1 s are not of a scan; that at 1 s still has one.
    gone = [s for s in SCAN_STAMPS if s in lost and s - START > SECOND]
    assert stamps(desk) == [s for s in SCAN_STAMPS if s not in gone] and len(gone) == 1
    assert desk.node.report()["points: no image near"] == len(gone)
    assert causes(caplog) == [NO_IMAGE]


def test_a_burst_drops_the_oldest_counts_them_and_ends_well(
    caplog: pytest.LogCaptureFixture,
) -> None:
    from fusionslam.ros.messages.library import build

    desk = fusion(node={"queue": 10})
    image = only(DRIVE, IMAGES)[0]
    for k in range(300):
        desk.put(IMAGES, build(replace(image, stamp_ns=START + k)))
    assert desk.worker.queue.dropped == {(IMAGES, TOO_MANY): 290}
    assert desk.worker.queue.taken[IMAGES] == 300
    assert causes(caplog) == [TOO_MANY]
    desk.work()
    play(desk, drive_messages(later=5))
    desk.worker.idle()
    assert len(stamps(desk)) == len(SCAN_STAMPS)


def test_of_two_publishers_the_first_is_heard(
    usual: Desk, caplog: pytest.LogCaptureFixture
) -> None:
    desk, number = fusion(), 0
    for topic, value in DRIVE:
        desk.give(topic, value)
        if topic == SCANS:
            wrong = replace(value, points=value.points + 1, stamp_ns=value.stamp_ns + 1)
            desk.give(topic, wrong, callerid="/other")
            number += 1
    desk.worker.idle()
    assert same(desk, usual)
    assert desk.worker.queue.dropped == {(SCANS, SECOND_PUBLISHER): number}
    assert causes(caplog) == [SECOND_PUBLISHER]


def test_a_sensor_whose_driver_comes_back_under_another_name_is_heard_at_once() -> None:
    desk = fusion()
    play(desk, DRIVE)
    desk.gone.add("/somebody")
    for topic, value in drive_messages(later=10):
        desk.give(topic, value, callerid="/again")
    desk.worker.idle()
    assert len(stamps(desk)) == 2 * len(SCAN_STAMPS) and not desk.problems()


def test_a_bag_played_twice_gives_the_same_twice_and_the_jump_is_logged(
    usual: Desk, caplog: pytest.LogCaptureFixture
) -> None:
    desk = fusion()
    play(desk, DRIVE)
    play(desk, DRIVE)
    desk.worker.idle()
    found = stamps(desk)
    # Messages that waited when the clock went back are dropped.
    assert found[-len(SCAN_STAMPS) :] == SCAN_STAMPS
    assert found[: -len(SCAN_STAMPS)] == SCAN_STAMPS[: len(found) - len(SCAN_STAMPS)]
    assert desk.node.report()["jumps"] == 1 and len(found) >= 2 * len(SCAN_STAMPS) - 1
    desk.outlet.messages = desk.outlet.messages[-len(SCAN_STAMPS) :]
    assert same(desk, usual)
    assert causes(caplog).count("clock") == 1


def test_after_a_jump_scans_wait_for_odometry_that_comes_later() -> None:
    desk = fusion(online={"robot_frame": "base", "history": 1.0})
    behind = late(DRIVE, "odom", 0.3)
    play(desk, behind)
    play(desk, behind)
    desk.worker.idle()
    assert stamps(desk)[-len(SCAN_STAMPS) :] == SCAN_STAMPS
    assert desk.node.report()["without odometry"] == 0


def test_clouds_come_from_compressed_images_as_from_raw_ones(usual: Desk) -> None:
    from fusionslam.ros.messages.library import build

    def stored(value: Any) -> Any:
        # Without loss; some of them stay raw.
        return value if value.stamp_ns % SECOND == 0 else build(value, "png")

    desk = played(spoil(DRIVE, IMAGES, stored))
    assert same(desk, usual)


def without_stamp(value: Any) -> Any:
    if isinstance(value, FrameTransforms):
        return value
    return replace(value, stamp_ns=0)


def test_sensors_that_do_not_stamp_are_dated_by_their_arrival() -> None:
    desk = fusion(node={"stamps": "arrival"})
    for topic, value in DRIVE:
        if isinstance(value, (Scan, Picture, Odometry)):
            # As it arrives: it may wait before it is worked off.
            desk.now_ns = value.stamp_ns
        desk.give(topic, without_stamp(value))
    desk.worker.idle()
    assert stamps(desk) == SCAN_STAMPS and not desk.problems()


def test_arrival_without_a_clock_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    desk = fusion(node={"stamps": "arrival"})
    play(desk, DRIVE)
    assert {*causes(caplog)} == {"no-clock"}
    desk.now_ns = START
    desk.give(SCANS, only(DRIVE, SCANS)[0])
    assert desk.node.report()["frames"] == 0 and desk.worker.queue.taken[SCANS] == 10


def test_a_topic_that_nothing_arrives_on_is_named_with_how_to_remap_it(
    caplog: pytest.LogCaptureFixture,
) -> None:
    desk = fusion()
    play(desk, without(DRIVE, INFOS))
    caplog.clear()
    desk.worker.log_silent()
    assert causes(caplog) == ["silent"] and INFOS in caplog.text
    assert [entry.topic for entry in desk.worker.silent] == [INFOS]
    play(desk, DRIVE)
    assert not desk.worker.silent


def test_a_defect_in_a_node_is_logged_once_with_its_traceback(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: Any) -> None:
        raise RuntimeError("by a test")

    desk = fusion()
    with monkeypatch.context() as patch:
        patch.setattr("fusionslam.ros.nodes.data_fusion.fuse", broken)
        play(desk, DRIVE)
    assert len([record for record in caplog.records if record.exc_info]) == 1
    assert causes(caplog) == ["RuntimeError"]
    play(desk, drive_messages(later=10))
    desk.worker.idle()
    assert len(stamps(desk)) >= len(SCAN_STAMPS)
