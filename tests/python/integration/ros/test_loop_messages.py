# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the node loop_closure."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusionslam.loop_closure import LoopConfig
from fusionslam.ros.messages.types import pose_with_covariance
from fusionslam.ros.nodes.loop_closure import LoopClosure, LoopClosureConfig
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Scan
from ros_node import Kept
from worlds import AHEAD, Pose, room, scan

THERE: Pose = (0.2, -0.3, 0.5)


def detect(clouds: list[Cloud], **loops: Any) -> tuple[LoopClosure, Any]:
    """A node that was given clouds, and its only message."""
    pytest.importorskip("rospy", reason="messages of ROS")
    outlet = Kept()
    node = LoopClosure(LoopClosureConfig(loop_closure=LoopConfig(window=1, **loops)), outlet)
    for k, cloud in enumerate(clouds):
        points, colors = cloud.points, cloud.colors
        node._take(Scan(stamp_ns=k * 10**9, frame_id="base", points=points, colors=colors))
    ((_, message),) = outlet.messages
    return node, message


def test_a_message_has_the_pose_of_the_loop_and_how_sure_it_is() -> None:
    rooms = [scan(room(number), THERE, AHEAD, seed=number) for number in (0, 1, 2, 3)]
    again = scan(room(0), (0.4, -0.2, 0.8), AHEAD, seed=9)
    node, message = detect([*rooms, again], candidates=3)
    assert (message.query, message.match, message.match_stamp.to_nsec()) == (4, 0, 0)
    loop = node._loops.nearest
    assert loop.match_from_query is not None and loop.covariance is not None
    assert (message.probability, message.overlap) == (loop.probability, loop.overlap)
    assert message.rejected == len(node._loops.rejected) > 0
    found = message.match_from_query.pose
    turn = Rotation.from_quat([getattr(found.orientation, axis) for axis in "xyzw"]).as_matrix()
    place = [getattr(found.position, axis) for axis in "xyz"]
    np.testing.assert_allclose(turn, loop.match_from_query[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(place, loop.match_from_query[:3, 3])
    assert (message.pose.position.x, message.pose.position.y) == tuple(place[:2])
    assert message.match_from_query.covariance == pytest.approx(
        pose_with_covariance(loop.match_from_query, loop.covariance).covariance
    )


def test_a_covariance_is_turned_into_the_frame_of_the_pose() -> None:
    pytest.importorskip("rospy", reason="messages of ROS")
    rng = np.random.default_rng(0)
    shape = rng.normal(size=(6, 6)) * [0.1, 0.2, 0.3, 0.01, 0.02, 0.03]
    covariance = shape.T @ shape
    pose = np.eye(4)
    pose[:3, :3] = (turn := Rotation.from_euler("xyz", [0.5, -0.8, 2.0])).as_matrix()
    pose[:3, 3] = 1, 2, 3
    stated = np.array(pose_with_covariance(pose, covariance).covariance).reshape(6, 6)
    steps = rng.multivariate_normal(np.zeros(6), covariance, size=100_000)
    turned = (turn * Rotation.from_rotvec(steps[:, 3:]) * turn.inv()).as_rotvec()
    sampled = np.cov(np.hstack([turn.apply(steps[:, :3]), turned]).T)
    sds = np.sqrt(np.diag(sampled))
    np.testing.assert_allclose(stated / np.outer(sds, sds), sampled / np.outer(sds, sds), atol=0.02)


def test_a_loop_that_was_not_verified_says_so() -> None:
    same = [scan(room(0), THERE, AHEAD, seed=0)] * 3
    _, message = detect(same, verify=False, threshold=2.0)
    assert (message.query, message.match) == (2, 0)
    assert (message.probability, message.overlap, message.rejected) == (-1, -1, 0)
