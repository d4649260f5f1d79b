# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes in ROS 2 give what the offline commands give on the same bag."""

from pathlib import Path

import pytest

from benchmarks.ros.ros2_world import Ros2World, lacking
from live_results import CONNECTIONS, OUTPUTS, Offline, assert_same_results, run_offline
from ros_master import PlayedBag

PATIENT = "_node.queue:=1000"
IDLE_S = 8.0
# Clouds of a busy machine come seconds apart; after a silence a node takes none that is older.
SLOW = ("_order.wait:=60.0", f"_node.idle:={IDLE_S}")
pytestmark = pytest.mark.skipif(bool(lacking), reason=lacking)


@pytest.fixture(scope="module")
def offline(played_bag: PlayedBag, tmp_path_factory: pytest.TempPathFactory) -> Offline:
    return run_offline(played_bag, tmp_path_factory.mktemp("offline"))


@pytest.mark.parametrize("rate", [pytest.param(1, marks=pytest.mark.nightly), 5])
def test_clouds_ids_and_map_are_those_of_the_commands(
    rate: int, offline: Offline, tmp_path: Path
) -> None:
    with Ros2World(tmp_path) as world:
        listener = world.listen(*OUTPUTS)
        # On a busy machine messages are many seconds of a fast bag behind others.
        for name in ("ratslam", "lv_matching"):
            world.node(name, *SLOW, PATIENT)
        world.node("lv_builder", PATIENT)
        world.node("data_fusion", *offline.bag.sensors, "_online.wait:=60.0", PATIENT)
        world.connect(listener, **CONNECTIONS)
        world.play(offline.bag.path, "--rate", str(rate))
        listener.settle(IDLE_S + 3)
        found = listener.messages()
    assert_same_results(found, offline)
