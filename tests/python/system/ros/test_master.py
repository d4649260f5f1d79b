# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A live ROS that misbehaves: the master restarts, drivers change, time stands still."""

import signal
import time
from pathlib import Path

import pytest

import benchmarks.ros.world as world_of_ros
from bags import drive, write_bag
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.sensors.messages import Scan
from robot_checks import REMAPPINGS
from ros_master import Listener, RosWorld, needs_ros, wait_until

pytestmark = [needs_ros, pytest.mark.nightly]

FUSION = (*REMAPPINGS, "_online/robot_frame:=base", "_node/report:=0.2")
EVENTS = drive(2.0)
STAMPS = [event.message.stamp_ns for event in EVENTS if isinstance(event.message, Scan)]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("played") / "drive.bag", EVENTS)


def stamps(listener: Listener) -> list[int]:
    return [stamp_of(cloud.header.stamp) for cloud in listener.messages()["/rgb_cloud"]]


def reports(listener: Listener) -> list[dict[str, str]]:
    """Reports of data_fusion, one after another."""
    found = [message.status[0] for message in listener.messages()["/diagnostics"]]
    return [
        {"message": status.message, **{each.key: each.value for each in status.values}}
        for status in found
        if status.name == "fusionslam: data_fusion"
    ]


def wait_for_clouds(listener: Listener, count: int) -> None:
    wait_until(lambda: len(stamps(listener)) >= count, f"{count} clouds")


def test_nodes_outlive_the_master_their_sensors_and_messages_of_other_types(
    bag: Path, tmp_path: Path
) -> None:
    with RosWorld(tmp_path) as world:
        clouds = world.listen("/rgb_cloud")
        fusion = world.node("data_fusion", *FUSION)
        world.play(bag, "-r", "4")
        wait_for_clouds(clouds, len(STAMPS))

        world.end(world.core)
        time.sleep(1.0)
        assert fusion.poll() is None
        world.core = world.start_core()
        wait_until(lambda: "registered again" in world.log("data_fusion"), "registration")
        # Another player, so sensors whose names are new; and a listener that the old master never
        # knew.
        late = world.listen("/rgb_cloud")
        world.play(bag, "-r", "4")
        wait_for_clouds(clouds, 2 * len(STAMPS))

        wrong = ["rostopic", "pub", "-1", "/points", "std_msgs/String", "text"]
        world.run("rostopic", wrong).wait()
        world.play(bag, "-r", "4")
        wait_for_clouds(clouds, 3 * len(STAMPS))
        assert stamps(clouds) == 3 * STAMPS and stamps(late) == 2 * STAMPS
        others = world.listen("/diagnostics")
        wait_until(lambda: reports(others), "a report")
        report, log = reports(others)[-1], world.log("data_fusion")
        assert world.end(fusion, signal.SIGTERM) == 0
    assert [count for key, count in report.items() if "std_msgs/String" in key] == ["1"]
    assert log.count("std_msgs/String") == 1 and "Traceback" not in log
    assert report["frames"] == str(3 * len(STAMPS)) and report["jumps"] == "2"


def test_time_may_be_simulated_stand_still_and_begin_anew(bag: Path, tmp_path: Path) -> None:
    with RosWorld(tmp_path) as world:
        assert world.run("rosparam", ["rosparam", "set", "/use_sim_time", "true"]).wait() == 0
        clouds, others = world.listen("/rgb_cloud"), world.listen("/diagnostics")
        fusion = world.node("data_fusion", *FUSION)
        # Nobody tells the time yet, and it is none of a node's that works by stamps.
        wait_until(lambda: reports(others), "a report")
        player = world.start_player(bag, "--clock", "-r", "2")
        wait_for_clouds(clouds, 2)
        player.send_signal(signal.SIGSTOP)
        count = len(reports(others))
        wait_until(lambda: len(reports(others)) > count + 8, "reports while time stands still")
        player.send_signal(signal.SIGCONT)
        assert player.wait(timeout=world_of_ros.PATIENCE_S) == 0
        wait_for_clouds(clouds, len(STAMPS))
        world.play(bag, "--clock", "-r", "4")
        wait_for_clouds(clouds, 2 * len(STAMPS))
        assert stamps(clouds) == 2 * STAMPS
        assert world.end(fusion) == 0
        assert "Traceback" not in world.log("data_fusion")
