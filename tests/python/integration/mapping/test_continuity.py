# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a map goes on after jumps of odometry, silences, restarts and times that go back."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import FusionSlamError
from fusionslam.mapping.config import odometry_covariance
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.sensors.frame import Frame
from map_fixtures import FRAMES
from streets import RETURN, at, changed, frames

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


def test_a_jump_of_odometry_begins_a_part_though_a_frame_shows_nothing(new: PlaceMap) -> None:
    new.add(FRAMES[0])
    step = new.add(FRAMES[1], odometry=at(500, 0, 0, 0))
    assert step.why is not None and step.why.code == "jump"
    assert new.sessions[0].parts == (0, 1)
    with pytest.raises(FusionSlamError):
        new.add(Frame(index=1, points=np.empty((0, 3), np.float32)), odometry=at(1000, 0, 0, 0))
    step = new.add(FRAMES[1], odometry=at(1006, 0, 0, 0))
    assert step.why is not None and step.why.code == "jump"
    assert new.sessions[0].parts == (0, 1, 2)


def later(frame: Frame, seconds: float, odometry: Any = None) -> Frame:
    """The same frame at another time, and with other odometry."""
    values = {} if odometry is None else {"odometry": odometry}
    return changed(frame, stamp_ns=frame.stamp_ns + round(seconds * 1e9), **values)


def test_odometry_that_clouds_confirm_counts_after_a_silence(new: PlaceMap) -> None:
    new.add(FRAMES[0])
    step = new.add(later(FRAMES[1], 3600))
    assert step.keyframe == 1 and step.why is None
    assert new.sessions[0].parts == (0,)


def test_odometry_counts_after_a_silence_in_which_the_robot_drove_elsewhere(new: PlaceMap) -> None:
    for frame in FRAMES[:3]:
        new.add(frame)
    driven = new.odometry("a")[-1] @ at(300, 0, 0, 0)  # where clouds show nothing of before
    (elsewhere,) = frames(RETURN[:1], 200, day=1, place=13)
    step = new.add(later(elsewhere, 600, driven))
    assert step.keyframe == 3 and step.why is None
    assert new.sessions[0].parts == (0,)
    (edge,) = (each for each in new.edges if each.b == 3)  # it may have driven about
    straight = odometry_covariance(edge.pose, new.settings.map)
    assert edge.covariance[0, 0] > 2 * straight[0, 0]


def test_a_robot_that_was_carried_during_a_silence_begins_a_part(new: PlaceMap) -> None:
    new.add(FRAMES[0])
    new.add(FRAMES[1])
    step = new.add(later(FRAMES[5], 3600, FRAMES[1].odometry))  # as if it had not moved
    assert step.keyframe == 2 and step.why is not None
    assert (step.why.code, round(step.why.number)) == ("silence", 3604)
    assert new.sessions[0].parts == (0, 2)
    assert new.add(later(FRAMES[6], 3600, FRAMES[2].odometry)).why is None
    assert new.sessions[0].parts == (0, 2)


def test_odometry_that_began_anew_before_a_session_goes_on_begins_a_part(short: Path) -> None:
    with PlaceMap.open(short, "monday") as site:
        # Nearer than a jump: the robot stands where it stood, and its odometry starts at zero.
        step = site.add(later(FRAMES[3], 86_400, np.eye(4)))
        assert step.why is not None and step.why.code == "restart"
        assert site.sessions[0].parts == (0, 4)


def test_a_time_stamp_that_goes_back_is_named(new: PlaceMap) -> None:
    new.add(FRAMES[0])
    assert new.add(FRAMES[1]).why is None
    for seconds, back, keyframe in ((0.5, 0.5, 2), (0.25, 0.25, None)):  # one is too near
        step = new.add(later(FRAMES[2], seconds - 2))
        assert step.why is not None and step.keyframe == keyframe
        assert (step.why.code, step.why.number) == ("stamp", back)
    assert new.sessions[0].parts == (0,)


def test_a_drive_that_is_played_again_begins_a_part(new: PlaceMap) -> None:
    new.add(later(FRAMES[5], 60))
    # Clouds confirm the odometry of one of them alone; none is as far as a jump.
    for frame, odometry, parts in ((4, 4, (0,)), (1, 3, (0, 3))):
        step = new.add(later(FRAMES[frame], -frame + 1, FRAMES[odometry].odometry))
        assert step.why is not None and step.why.code == "stamp"
        assert new.sessions[0].parts == parts
        new.add(later(FRAMES[frame], 60, FRAMES[odometry].odometry))
