# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are killed in the middle of a drive lose nothing that their files hold."""

import signal
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.ratslam import OnlineRatSlam
from ros_master import PlayedBag, RosWorld, needs_ros

pytestmark = needs_ros

FAST = ("-r", "8")
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


def places(message: Any) -> list[tuple[float, float]]:
    return [(node.pose.position.x, node.pose.position.y) for node in message.node]
