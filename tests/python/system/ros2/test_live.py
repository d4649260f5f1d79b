# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes in ROS 2 give what the commands and the library give on the same bag."""

from pathlib import Path

import pytest

from benchmarks.ros.ros2_world import Ros2World, lacking
from cli import succeeds
from fusionslam.config import flatten
from live_results import (
    CONNECTIONS,
    OUTPUTS,
    PATIENT_PAIRING,
    Offline,
    assert_same_loops,
    assert_same_results,
)
from place_maps import assert_same_map
from ros_master import PlayedBag

pytestmark = pytest.mark.skipif(bool(lacking), reason=lacking)

BUILD = ("--no-report", "--topic", "points=/velodyne_points")
IDLE_S = 6.0
"""Twice what DDS needs to send a lost message again: such a wait is no silence of the topics."""
# A machine may be so busy that messages are many seconds of a fast bag behind others.
PATIENT = ("_node.queue:=1000", f"_node.idle:={IDLE_S}")
PAIRING = [f"_online.{name}:={value}" for name, value in flatten(PATIENT_PAIRING).items()]
ORDER = "_order.wait:=600.0"


@pytest.mark.parametrize(
    "rate", [pytest.param(1, marks=pytest.mark.nightly), pytest.param(5, marks=pytest.mark.slow)]
)
def test_clouds_ids_and_map_are_those_of_the_commands(
    rate: int, offline: Offline, tmp_path: Path
) -> None:
    with Ros2World(tmp_path) as world:
        listener = world.listen(*OUTPUTS)
        for name in ("ratslam", "lv_matching"):
            world.node(name, *PATIENT, ORDER)
        world.node("lv_builder", *PATIENT)
        world.node("data_fusion", *offline.bag.sensors, *PATIENT, *PAIRING)
        world.connect(listener, **CONNECTIONS)
        world.play(offline.bag.path, "--rate", str(rate), "--until-idle")
        listener.settle(1.0)
        assert_same_results(listener.messages(), offline)


@pytest.mark.nightly
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


@pytest.mark.nightly
def test_a_map_is_that_of_the_command(played_bag: PlayedBag, tmp_path: Path) -> None:
    pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")
    other = tmp_path / "other.fsmap"
    succeeds("map", "build", played_bag.path, "-o", other, "--session", "monday", *BUILD)
    with Ros2World(tmp_path) as world:
        listener = world.listen("/mapper/cloud", "/mapper/grid", "/mapper/path", "/odom")
        parameters = ("_map.file:=site.fsmap", "_map.session:=monday", *PAIRING)
        node = world.node("mapper", *played_bag.sensors, *parameters, *PATIENT)
        listener.wait_for("/mapper/cloud", "/mapper/grid", "/mapper/path")
        world.play(played_bag.path, "--rate", "5")
        listener.settle(2 * IDLE_S)  # though the mapper publishes on /tf, which it listens to
        assert world.end(node) == 0, world.log("mapper")
        found = listener.messages()
    assert_same_map(tmp_path / "site.fsmap", other)
    assert all(found[f"/mapper/{name}"] for name in ("cloud", "grid", "path"))
