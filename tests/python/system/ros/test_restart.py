# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are killed in the middle of a drive lose nothing that their files hold."""

import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drives import RATE, SECOND, Message, lap_course, rmse
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.ratslam import Look, OnlineRatSlam, Sighting
from fusionslam.ros.nodes.lv_matching import template_message
from fusionslam.ros.ros1.environment import need_ros
from ros_master import PlayedBag, RosWorld, needs_ros

pytestmark = needs_ros

FAST = ("-r", "8")
NIGHT = 8 * 3600 * SECOND
KEEPS = {
    "ratslam": ("_memory/file:=map.npz", "_export:=exported"),
    "lv_matching": ("_memory/file:=views.npz",),
}


def test_map_and_views_go_on_after_nodes_were_killed(played_bag: PlayedBag, tmp_path: Path) -> None:
    with RosWorld(tmp_path) as world:
        listener = world.listen("/LocalView/Template", "/ExperienceMap/Map")
        nodes = {name: world.node(name, *options) for name, options in KEEPS.items()}
        world.node("lv_builder")
        world.node("data_fusion", *played_bag.sensors)
        world.play(played_bag.path, *FAST, "-u", "10")
        listener.settle()
        before = listener.messages()
        for process in nodes.values():
            world.end(process, signal.SIGKILL)
        kept = OnlineRatSlam.load(tmp_path / "map.npz").slam.map.nodes
        nodes = {name: world.node(name, *options) for name, options in KEEPS.items()}
        world.play(played_bag.path, *FAST, "-s", "10")
        listener.settle()
        for process in nodes.values():
            assert world.end(process) == 0
        after = listener.messages()
    first, last = before["/ExperienceMap/Map"][-1], after["/ExperienceMap/Map"][-1]
    np.testing.assert_array_equal(kept[:, :2], places(first))
    assert len(last.node) > len(first.node) > 3
    stamps = [stamp_of(node.stamp) for node in last.node]
    assert stamps[: len(first.node)] == [stamp_of(node.stamp) for node in first.node]
    assert stamps == sorted(stamps)
    whole = OnlineRatSlam.load(tmp_path / "map.npz")
    np.testing.assert_array_equal(whole.slam.map.nodes[:, :2], places(last))
    assert whole.views.restarts == 0
    new = [each.current_id for each in after["/LocalView/Template"] if each.is_new]
    assert new == list(range(len(new)))
    assert {path.name for path in (tmp_path / "exported").iterdir()} >= {"map.json", "map.g2o"}


@pytest.mark.nightly
def test_a_map_outlives_views_that_were_lost(played_bag: PlayedBag, tmp_path: Path) -> None:
    with RosWorld(tmp_path) as world:
        listener = world.listen("/LocalView/Template", "/ExperienceMap/Map")
        world.node("ratslam")
        matching = world.node("lv_matching")
        world.node("lv_builder")
        world.node("data_fusion", *played_bag.sensors)
        world.play(played_bag.path, *FAST, "-u", "10")
        listener.settle()
        count = len(listener.messages()["/ExperienceMap/Map"][-1].node)
        world.end(matching, signal.SIGKILL)
        world.node("lv_matching")
        world.play(played_bag.path, *FAST, "-s", "10")
        listener.settle()
        found = listener.messages()
    new = [each.current_id for each in found["/LocalView/Template"] if each.is_new]
    assert new.count(0) == 2
    last = found["/ExperienceMap/Map"][-1]
    views = [node.view_id for node in last.node]
    assert len(views) > count
    # Ids begin anew with the matcher's memory, but each new view is another one of the map.
    assert max(views) == len(new) - 1


@pytest.mark.nightly
def test_a_robot_that_was_carried_at_night_is_found_on_its_map(tmp_path: Path) -> None:
    course = lap_course(3)
    lap = len(course.speeds) // 3
    days = {
        "first": course.messages(0, lap + lap // 2),
        "second": course.messages(2 * lap, 3 * lap, NIGHT),
    }
    with RosWorld(tmp_path) as world:
        listener = world.listen("/ExperienceMap/Map", "/PoseCell/TopologicalAction")
        for name, messages in days.items():
            write_bag(tmp_path / f"{name}.bag", messages)
            node = world.node("ratslam", *KEEPS["ratslam"])
            world.play(tmp_path / f"{name}.bag", *FAST)
            listener.settle()
            assert world.end(node) == 0, world.log("ratslam")
        found = listener.messages()
    night = days["second"][0].stamp_ns
    loops = [each for each in found["/PoseCell/TopologicalAction"] if each.action == 2]
    after = [stamp_of(each.header.stamp) - night for each in loops]
    assert 0 < min(late for late in after if late >= 0) < 20 * SECOND
    stamps = np.array([stamp_of(node.stamp) for node in found["/ExperienceMap/Map"][-1].node])
    truth = course.poses[stamps % NIGHT * RATE // SECOND]
    assert rmse(OnlineRatSlam.load(tmp_path / "map.npz").slam.map.nodes, truth) < 0.15


def write_bag(path: Path, messages: Sequence[Message]) -> None:
    """Write odometry and recognised views as their nodes publish them."""
    need_ros()
    import rosbag
    from rospy import Time

    from fusionslam.ros.messages.library import build

    with rosbag.Bag(str(path), "w") as bag:
        for one in messages:
            stamp = Time(one.stamp_ns // SECOND, one.stamp_ns % SECOND)
            if isinstance(one, Look):
                view = one.item
                values = view.view_id, view.relative_rotation, view.relative_place
                message = template_message(Sighting(one.stamp_ns, *values), "base", view.is_new)
                bag.write("/LocalView/Template", message, stamp)
            else:
                bag.write("/odom", build(one), stamp)


def places(message: Any) -> list[tuple[float, float]]:
    return [(node.pose.position.x, node.pose.position.y) for node in message.node]
