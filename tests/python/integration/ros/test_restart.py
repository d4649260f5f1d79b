# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The node ratslam is killed, and its map goes on at the next start."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from drives import RATE, SECOND, Message, lap_course, rmse
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.ratslam import Look, OnlineRatSlam, Sighting
from fusionslam.ros.nodes.lv_matching import template_message
from ros_master import needs_ros
from ros_node import Desk

pytestmark = needs_ros

VIEWS, MAP = "LocalView/Template", "ExperienceMap/Map"
NIGHT = 8 * 3600 * SECOND
COURSE = lap_course(3)
LAP = len(COURSE.speeds) // 3


def give(desk: Desk, messages: Sequence[Message]) -> None:
    """Odometry and recognised views arrive as their nodes publish them."""
    for one in messages:
        if isinstance(one, Look):
            view = one.item
            seen = Sighting(one.stamp_ns, view.view_id, view.relative_rotation, view.relative_place)
            desk.give(VIEWS, template_message(seen, "base", view.is_new))
        else:
            desk.give("odom", one)
    desk.worker.idle()


@pytest.mark.slow
def test_a_robot_that_was_carried_while_its_node_was_killed_is_found_on_its_map(
    tmp_path: Path,
) -> None:
    path = tmp_path / "map.npz"
    first = Desk("ratslam", memory={"file": str(path)})
    give(first, COURSE.messages(0, LAP + LAP // 2))  # and is never closed
    kept = OnlineRatSlam.load(path).slam.map.nodes
    before = first.outlet.of(MAP)[-1].node
    places = [(node.pose.position.x, node.pose.position.y) for node in before]
    np.testing.assert_array_equal(kept[:, :2], places)
    again = Desk("ratslam", memory={"file": str(path)}, export=str(tmp_path / "exported"))
    give(again, COURSE.messages(2 * LAP, 3 * LAP, NIGHT))
    again.node.close()
    stamps = np.array([stamp_of(node.stamp) for node in again.outlet.of(MAP)[-1].node])
    assert len(stamps) > len(before) > 3
    assert stamps[: len(before)].tolist() == [stamp_of(node.stamp) for node in before]
    loops = [each for each in again.outlet.of("PoseCell/TopologicalAction") if each.action == 2]
    after = [stamp_of(each.header.stamp) - NIGHT for each in loops]
    assert 0 < min(late for late in after if late >= 0) < 20 * SECOND + 2 * LAP * SECOND // RATE
    whole = OnlineRatSlam.load(path)
    truth = COURSE.poses[stamps % NIGHT * RATE // SECOND]
    assert rmse(whole.slam.map.nodes, truth) < 0.15 and whole.views.restarts == 0
    exported = {path.name for path in (tmp_path / "exported").iterdir()}
    assert exported >= {"map.json", "map.g2o"}
