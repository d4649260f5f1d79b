# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot was on the ground at any time: known, not yet known, or never."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from error_codes import has_code
from fusionslam.errors import ClockError, DataError
from fusionslam.sensors.messages import Odometry
from fusionslam.sensors.pose_buffer import Ground, PoseBuffer, PoseQueue
from fusionslam.sensors.transforms import TransformError
from rows import rows

S = 1_000_000_000


def odometry(seconds: float, x: float, y: float, yaw: float, **names: str) -> Odometry:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    pose[:2, 3] = x, y
    ends: dict[str, Any] = {"frame_id": "odom", "child_frame_id": "base", **names}
    return Odometry(stamp_ns=round(seconds * S), pose=pose, **ends)


def driven(until: float, **options: float) -> PoseBuffer:
    """Along a line at 2 m/s, turning left at 0.3 rad/s, ten times a second from 100 s on."""
    poses = PoseBuffer(**options)
    for step in range(round(until * 10) + 1):
        t = step / 10
        poses.add(odometry(100 + t, 2 * t, 1 - t, 0.3 * t))
    return poses


def why_not(poses: PoseBuffer, seconds: float) -> TransformError:
    with pytest.raises(TransformError) as caught:
        poses.at(round(seconds * S))
    return caught.value


def test_between_two_messages_the_pose_is_interpolated() -> None:
    poses = driven(20)
    for t in (0, 0.1, 3.14, 11.055, 20):
        turn = np.angle(np.exp(0.3j * t))
        assert poses.at(round((100 + t) * S)) == pytest.approx((2 * t, 1 - t, turn), abs=1e-9)
    poses = PoseBuffer()  # of a driver that leaves the names empty
    poses.add(odometry(1, 3, 4, 0.5, frame_id="", child_frame_id=""))
    assert poses.at(S) == pytest.approx((3, 4, 0.5))


def test_what_is_not_known_yet_may_come_and_what_was_before_or_forgotten_never_will() -> None:
    poses = PoseBuffer()
    assert why_not(poses, 100).may_come and why_not(poses, 100).code == "no-odometry"
    poses = driven(5)
    late, early = why_not(poses, 105.02), why_not(poses, 99.9)
    assert late.may_come and late.code == "too-late"
    assert not early.may_come and early.code == "too-early"
    poses.add(odometry(105.1, 10.2, -4.1, 1.53))
    assert poses.at(round(105.02 * S))[0] == pytest.approx(10.04)
    poses = driven(20, history_s=5)
    assert poses.at(115 * S)[0] == pytest.approx(30)
    assert not why_not(poses, 114.9).may_come


def test_messages_that_changed_places_are_taken_and_a_clock_that_went_back_is_not() -> None:
    poses = driven(5)
    poses.add(odometry(104.95, 9.95, -3.95, 0))
    assert poses.at(round(104.95 * S))[0] == pytest.approx(9.95)
    before = poses.at(105 * S)
    with pytest.raises(ClockError, match=r"102\.5 s"):
        poses.add(odometry(2.5, 0, 0, 0))
    assert poses.at(105 * S) == before and not why_not(poses, 2.5).may_come


def test_odometry_of_two_robots_or_that_is_no_pose_is_refused() -> None:
    poses = driven(5)
    before = poses.at(105 * S)
    for other in ({"frame_id": "map"}, {"child_frame_id": "other"}):
        with pytest.raises(DataError, check=has_code("two-robots")):
            poses.add(odometry(105, 0, 0, 0, **other))
    bad = odometry(105, np.nan, 0, 0)
    with pytest.raises(DataError, check=has_code("no-transform", "odom", "base")):
        poses.add(bad)
    assert poses.at(105 * S) == before
    fresh = PoseBuffer()
    with pytest.raises(DataError, check=has_code("no-transform")):
        fresh.add(bad)
    assert why_not(fresh, 105).code == "no-odometry"


def waiting(**options: Any) -> PoseQueue[str]:
    """Odometry up to 101 s is known."""
    posed: PoseQueue[str] = PoseQueue(**options)
    for step in range(11):
        assert posed.move(odometry(100 + step / 10, step, 0, 0)) == []
    return posed


def told(decided: list[tuple[int, str, Ground | None]]) -> list[tuple[float, str, float | None]]:
    """Seconds, thing, and x of its pose."""
    return [
        (stamp / S, thing, None if pose is None else round(pose[0], 6))
        for stamp, thing, pose in decided
    ]


def test_things_are_given_out_once_their_pose_is_known_or_never_will_be() -> None:
    posed = waiting()
    assert told(posed.add(round(100.55 * S), "known")) == [(100.55, "known", 5.5)]
    assert told(posed.add(round(99.9 * S), "too early")) == [(99.9, "too early", None)]
    assert posed.add(round(101.15 * S), "late") == [] == posed.move(odometry(101.1, 11, 0, 0))
    assert told(posed.move(odometry(101.2, 12, 0, 0))) == [(101.15, "late", 11.5)]


def test_they_come_out_in_the_order_in_which_they_came() -> None:
    posed = waiting()
    assert posed.add(round(101.4 * S), "first") == posed.add(round(100.5 * S), "second") == []
    assert told(posed.flush()) == [(101.4, "first", None), (100.5, "second", 5)]
    assert posed.flush() == []


def test_no_more_wait_than_allowed() -> None:
    posed = waiting(most=2)
    assert posed.add(105 * S, "a") == posed.add(106 * S, "b") == []
    assert told(posed.add(107 * S, "c")) == [(105, "a", None)]


@rows("first", ["odometry", "thing"])
def test_when_the_clock_goes_back_all_starts_anew_with_poses_of_the_new_time(first: str) -> None:
    posed = waiting()
    assert posed.add(102 * S, "old") == []
    if first == "odometry":
        assert told(posed.move(odometry(3, 70, 0, 0))) == [(102, "old", None)]
        assert posed.add(round(3.5 * S), "new") == []
    else:
        assert told(posed.add(round(3.5 * S), "new")) == [(102, "old", None)]
        assert posed.move(odometry(3, 70, 0, 0)) == []
    assert told(posed.move(odometry(4, 80, 0, 0))) == [(3.5, "new", 75)]
    assert posed.jumps == 1


def test_a_clock_that_goes_back_is_noticed_although_nothing_waits() -> None:
    posed = waiting()
    assert told(posed.add(101 * S, "old")) == [(101, "old", 10)]
    # The odometry of the time before the jump still knows 100.5 s - but of another drive.
    assert posed.add(99 * S, "new") == posed.add(round(100.5 * S), "new") == []
    assert posed.jumps == 1


@rows("at, x, frame, code", [(101.1, 0, "map", "two-robots"), (3, np.nan, "odom", "no-transform")])
def test_bad_odometry_is_refused_and_the_rest_waits(
    at: float, x: float, frame: str, code: str
) -> None:
    posed = waiting()
    assert posed.add(round(101.05 * S), "late") == []
    with pytest.raises(DataError, check=has_code(code)):
        posed.move(odometry(at, x, 0, 0, frame_id=frame))
    assert posed.jumps == 0  # nor is NaN from long ago a clock that went back
    assert told(posed.move(odometry(101.1, 11, 0, 0))) == [(101.05, "late", 10.5)]
