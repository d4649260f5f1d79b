# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""lv_matching weighs views by odometry: they wait for it, but not for ever."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.messages import Odometry, Scan
from ros_master import needs_ros
from ros_node import CLOUDS, IDS, VIEWS, Desk, causes, ids
from rows import rows
from scenes import place

pytestmark = needs_ros

ODOM = "odom"
S = 1_000_000_000
LOOKS = (0, 1, 2, 3, 1, 2, 4, 2, 1, 3, 2, 1, 0)
WHERE = (0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0)
"""A corridor of places 4 m apart, two of which look like two others."""


def views() -> list[Any]:
    builder = Desk("lv_builder")
    for k, look in enumerate(LOOKS):
        cloud = place(look)
        scan = Scan(stamp_ns=S * (k + 1), frame_id="base", points=cloud.points, colors=cloud.colors)
        builder.give(CLOUDS, scan)
    return builder.outlet.of(VIEWS)


def odometry(k: int) -> Odometry:
    pose = ground_poses(np.array([50 + 4.0 * WHERE[k]]), np.zeros(1), np.zeros(1))[0]
    still = np.zeros(3)
    return Odometry(
        stamp_ns=S * (k + 1),
        frame_id="odom",
        child_frame_id="base",
        pose=pose,
        linear=still,
        angular=still,
    )


@rows("late", [0, 1])
def test_look_alike_places_are_told_apart_however_late_odometry_is(late: int) -> None:
    matcher = Desk("lv_matching", odometry=True)
    for k, view in enumerate(views()):
        matcher.give(VIEWS, view)
        if k >= late:
            matcher.give(ODOM, odometry(k - late))
        assert len(ids(matcher)) == k + 1 - late
    matcher.node.idle()  # what it does after a second of silence
    assert ids(matcher)[: len(WHERE) - late] == list(WHERE)[: len(WHERE) - late]
    assert len(ids(matcher)) == len(WHERE)


def test_without_odometry_views_are_compared_alone_after_a_while(
    caplog: pytest.LogCaptureFixture,
) -> None:
    matcher, alone = Desk("lv_matching", odometry=True), Desk("lv_matching")
    given = views()
    matcher.give(VIEWS, *given[:3])
    assert not ids(matcher)
    matcher.give(VIEWS, *given[3:])
    alone.give(VIEWS, *given)
    assert ids(matcher) == ids(alone) and len(ids(alone)) == len(WHERE)
    assert causes(caplog) == ["no-odometry"]


def test_odometry_that_ends_leaves_the_robot_in_doubt_and_not_standing_still(
    caplog: pytest.LogCaptureFixture,
) -> None:
    matcher, given = Desk("lv_matching", odometry=True), views()
    for k in range(4):
        matcher.give(ODOM, odometry(k))
    matcher.give(VIEWS, *given)
    matcher.node.idle()
    assert ids(matcher)[:4] == list(WHERE)[:4] and len(ids(matcher)) == len(WHERE)
    reasons = [message.reason for message in matcher.outlet.of(IDS)]
    assert all("may be anywhere" in reason for reason in reasons[6:])
    # The seventh place looks like no other, so it is new.
    assert ids(matcher)[6] >= 4
    assert not causes(caplog)


def test_views_that_come_after_a_silence_are_recognised_as_all_others() -> None:
    matcher = Desk("lv_matching", odometry=True)
    matcher.give(ODOM, *map(odometry, range(len(WHERE))))
    for view in views():
        matcher.worker.idle()
        matcher.give(VIEWS, view)
    assert ids(matcher) == list(WHERE) and not matcher.problems()


def test_what_comes_too_late_is_said_to_be_late_for_a_silence_or_out_of_order() -> None:
    matcher, given = Desk("lv_matching", odometry=True), views()
    matcher.give(ODOM, odometry(0))
    matcher.give(VIEWS, *given[:2], given[3])
    matcher.worker.idle()
    matcher.give(ODOM, odometry(1), odometry(2))
    (silence,) = matcher.problems()
    assert "~node/idle, which is 1 s" in silence and silence.startswith("odom: ")
    matcher.give(ODOM, odometry(4))
    matcher.give(VIEWS, given[4], given[3])
    _, out_of_order = matcher.problems()
    assert "stamps that go back" in out_of_order and out_of_order.startswith(VIEWS)
    assert len(ids(matcher)) == 4 and matcher.node.report()["too late"] == 3


def test_a_node_that_restarts_goes_on(tmp_path: Path) -> None:
    memory, given, found = {"file": str(tmp_path / "views.npz"), "every": 1e-9}, views(), []
    for k, view in enumerate(given):
        matcher = Desk("lv_matching", odometry=True, memory=memory)
        matcher.give(ODOM, odometry(k))
        matcher.give(VIEWS, view)
        matcher.node.close()
        found += ids(matcher)
    assert found == list(WHERE)
