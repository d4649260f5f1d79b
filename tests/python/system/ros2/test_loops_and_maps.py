# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""In ROS 2, loops and maps that last are those of the library."""

from pathlib import Path

import pytest

from benchmarks.ros.ros2_world import Ros2World, lacking
from cli import succeeds
from live_results import assert_same_loops
from place_maps import assert_same_map
from ros_master import PlayedBag

pytestmark = pytest.mark.skipif(bool(lacking), reason=lacking)
pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

BUILD = ("--no-report", "--topic", "points=/velodyne_points")


def test_loops_are_those_of_the_detector(played_bag: PlayedBag, tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        listener = world.listen("/rgb_cloud", "/loop_closures")
        world.node("loop_closure", "_loop_closure.window:=2")
        world.node("data_fusion", *played_bag.sensors)
        world.connect(listener, loop_closure="/rgb_cloud")
        listener.wait_for("/loop_closures")
        world.play(played_bag.path, "--rate", "4")
        listener.settle()
        found = listener.messages()
    assert_same_loops(found["/loop_closures"], found["/rgb_cloud"])


def test_a_map_is_that_of_the_command(played_bag: PlayedBag, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    succeeds("map", "build", played_bag.path, "-o", other, "--session", "monday", *BUILD)
    with Ros2World(tmp_path) as world:
        listener = world.listen("/mapper/cloud", "/mapper/grid", "/mapper/path", "/odom")
        parameters = ("_map.file:=site.fsmap", "_map.session:=monday", "_online.wait:=60.0")
        node = world.node("mapper", *played_bag.sensors, *parameters, "_node.queue:=1000")
        listener.wait_for("/mapper/cloud", "/mapper/grid", "/mapper/path")
        world.play(played_bag.path, "--rate", "5")
        listener.settle()  # though the mapper publishes on /tf, which it listens to
        assert world.end(node) == 0, world.log("mapper")
        found = listener.messages()
    assert_same_map(tmp_path / "site.fsmap", other)
    assert all(found[f"/mapper/{name}"] for name in ("cloud", "grid", "path"))
