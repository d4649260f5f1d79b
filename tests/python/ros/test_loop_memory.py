# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The memory of the node loop_closure goes on at its next start."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import ConfigError
from fusionslam.loop_closure import LoopConfig
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


def test_a_node_with_other_parameters_refuses_the_memory(tmp_path: Path) -> None:
    node = new_node(tmp_path)
    take(node, [scan(room(0), THERE, AHEAD, seed=0)])
    node._loops.save(tmp_path / "loops")
    with pytest.raises(ConfigError, match="loop_closure"):
        new_node(tmp_path, max_distance=1.0)
