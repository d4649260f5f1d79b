# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes on a live ROS give what the offline commands give on the same bag."""

from pathlib import Path

import pytest

from live_results import OUTPUTS, Offline, assert_same_results, run_offline
from ros_master import PlayedBag, RosWorld, needs_ros

pytestmark = needs_ros


@pytest.fixture(scope="module")
def offline(played_bag: PlayedBag, tmp_path_factory: pytest.TempPathFactory) -> Offline:
    return run_offline(played_bag, tmp_path_factory.mktemp("offline"))


@pytest.mark.parametrize("rate", [pytest.param(1, marks=pytest.mark.nightly), 5])
def test_clouds_ids_and_map_are_those_of_the_commands(
    rate: int, offline: Offline, tmp_path: Path
) -> None:
    with RosWorld(tmp_path) as world:
        listener = world.listen(*OUTPUTS)
        # The view of the last cloud comes only once data_fusion has met with a second of silence.
        world.node("ratslam")
        for name in ("lv_matching", "lv_builder"):
            world.node(name)
        world.node("data_fusion", *offline.bag.sensors)
        world.play(offline.bag.path, "-r", str(rate))
        listener.settle()
        found = listener.messages()
    assert_same_results(found, offline)
