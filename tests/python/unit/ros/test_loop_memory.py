# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The memory of the node loop_closure goes on at its next start."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusionslam.errors import ConfigError
from fusionslam.loop_closure import LoopConfig
from fusionslam.ros.messages.types import pose_with_covariance
from fusionslam.ros.nodes.loop_closure import LoopClosure, LoopClosureConfig
from fusionslam.ros.runtime.checkpoints import SavingConfig
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Scan
from worlds import AHEAD, Pose, room, scan

THERE: Pose = (0.2, -0.3, 0.5)


class Outlet:
    """Keeps what a node publishes."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []

    def publish(self, name: str, message: Any) -> None:
        self.published.append((name, message))


def take(node: LoopClosure, clouds: list[Cloud]) -> None:
    for cloud in clouds:
        first = len(node._loops)
        node._take(
            Scan(stamp_ns=first * 10**9, frame_id="base", points=cloud.points, colors=cloud.colors)
        )


def new_node(folder: Path, **loops: Any) -> LoopClosure:
    config = LoopClosureConfig(
        loop_closure=LoopConfig(window=1, **loops),
        memory=SavingConfig(file=str(folder / "loops")),
    )
    return LoopClosure(config, Outlet())


def test_a_node_in_a_room_goes_on_from_its_memory(tmp_path: Path) -> None:
    pytest.importorskip("rospy", reason="messages of ROS")
    clouds = [scan(room(number), THERE, AHEAD, seed=number) for number in (0, 1, 2)]
    node = new_node(tmp_path)
    take(node, clouds)
    node._loops.save(tmp_path / "loops")
    again = new_node(tmp_path, max_frames=50)
    assert len(again._loops) == 3
    assert again._loops.config.max_frames == 50
    take(again, [scan(room(0), (0.4, -0.2, 0.6), AHEAD, seed=0)])
    (published,) = again.outlet.published
    assert (published[1].query, published[1].match) == (3, 0)
    assert published[1].match_stamp.to_nsec() == 0
    assert np.isfinite(published[1].probability)


def test_a_message_has_the_pose_of_the_loop_and_how_sure_it_is(tmp_path: Path) -> None:
    pytest.importorskip("rospy", reason="messages of ROS")
    node = new_node(tmp_path, candidates=3)
    take(node, [scan(room(number), THERE, AHEAD, seed=number) for number in (0, 1, 2, 3)])
    take(node, [scan(room(0), (0.4, -0.2, 0.8), AHEAD, seed=9)])
    ((_, message),) = node.outlet.published
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


def test_a_loop_that_was_not_verified_says_so(tmp_path: Path) -> None:
    pytest.importorskip("rospy", reason="messages of ROS")
    node = new_node(tmp_path, verify=False, threshold=2.0)
    take(node, [scan(room(0), THERE, AHEAD, seed=0)] * 3)
    ((_, message),) = node.outlet.published
    assert (message.query, message.match) == (2, 0)
    assert (message.probability, message.overlap, message.rejected) == (-1, -1, 0)


def test_a_node_with_other_parameters_refuses_the_memory(tmp_path: Path) -> None:
    node = new_node(tmp_path)
    take(node, [scan(room(0), THERE, AHEAD, seed=0)])
    node._loops.save(tmp_path / "loops")
    with pytest.raises(ConfigError, match="loop_closure"):
        new_node(tmp_path, max_distance=1.0)
