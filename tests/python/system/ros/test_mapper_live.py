# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""On a live ROS, mapper makes the map that ``fusionslam map build`` makes of the same bag."""

import json
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import succeeds
from fusionslam.mapping import PlaceMap
from place_maps import assert_same_map
from ros_master import PlayedBag, RosWorld, needs_ros, wait_until

pytestmark = [needs_ros, pytest.mark.nightly]
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

BUILD = ("--no-report", "--topic", "points=/velodyne_points")
FILE = "_map/file:=site.fsmap"
_CALL = """
import json, sys
from fusionslam.ros.ros1.environment import need_ros
need_ros()
import rospy
from fusionslam.ros.messages.library import service_class
name, kind = sys.argv[1:]
answer = rospy.ServiceProxy(name, service_class(kind))()
print(json.dumps({slot: str(getattr(answer, slot)) for slot in answer.__slots__}))
"""
_STATIC = """
import sys
from fusionslam.ros.ros1.environment import need_ros
need_ros()
import rosbag, rospy
from tf2_msgs.msg import TFMessage
rospy.init_node("static")
publisher = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
links = [each for _, m, _ in rosbag.Bag(sys.argv[1]).read_messages("/tf_static")
         for each in m.transforms]
publisher.publish(TFMessage(links))
print("is ready")
rospy.spin()
"""


def call(world: RosWorld, name: str, kind: str) -> dict[str, str]:
    """The response of a service."""
    process = world.run("call", [sys.executable, "-c", _CALL, name, kind])
    assert process.wait(timeout=300) == 0, world.log("call")
    found: dict[str, str] = json.loads(world.log("call").splitlines()[-1])
    return found


def start(world: RosWorld, bag: PlayedBag, *parameters: str) -> Any:
    return world.node("mapper", *bag.sensors, FILE, *parameters)


def play_on(world: RosWorld, bag: PlayedBag) -> Any:
    """A player that runs on, and static transforms that stay, which the bag sends once."""
    world.run("static", [sys.executable, "-uc", _STATIC, str(bag.path)])
    wait_until(lambda: "is ready" in world.log("static"), "static transforms")
    return world.run("rosbag", ["rosbag", "play", "--quiet", "--clock", str(bag.path)])


def count_keyframes(path: Path) -> int:
    if not path.exists():
        return 0
    with PlaceMap.open(path, read_only=True) as site:
        return len(site)


def test_the_map_of_two_drives_is_that_of_the_command(
    played_bag: PlayedBag, tmp_path: Path
) -> None:
    other = tmp_path / "other.fsmap"
    for session in ("monday", "tuesday"):
        succeeds("map", "build", played_bag.path, "-o", other, "--session", session, *BUILD)
    with RosWorld(tmp_path) as world:
        listener = world.listen("/mapper/cloud", "/mapper/grid", "/mapper/path", "/odom")
        for session, rate in (("monday", "1"), ("tuesday", "5")):
            node = start(world, played_bag, f"_map/session:={session}")
            world.play(played_bag.path, "-r", rate)
            listener.settle()
            assert call(world, "/mapper/localize", "fusionslam_ros/Localize")["found"] == "True"
            assert world.end(node) == 0, world.log("mapper")
        assert "Traceback" not in world.log("mapper")
        found = listener.messages()
    assert_same_map(tmp_path / "site.fsmap", other)
    assert not (tmp_path / "site.fsmap-wal").exists()
    with PlaceMap.open(other, read_only=True) as site:
        assert any(each.kind == "merge" for each in site.edges)
        assert found["/mapper/grid"] and found["/mapper/cloud"]
        assert len(found["/mapper/path"][-1].poses) == len(site.keyframes("tuesday"))


def test_a_map_outlives_a_killed_node_and_goes_on(played_bag: PlayedBag, tmp_path: Path) -> None:
    path = tmp_path / "site.fsmap"
    with RosWorld(tmp_path) as world:
        listener = world.listen("/odom")
        node = start(world, played_bag, "_map/session:=monday")
        player = play_on(world, played_bag)
        wait_until(lambda: count_keyframes(path) > 3, "keyframes")
        world.end(node, signal.SIGKILL)
        with PlaceMap.open(path, read_only=True) as site:
            stamps, frames = site.trajectory("monday")[0], site.frames("monday")
        node = start(world, played_bag, "_map/session:=monday")
        assert player.wait(timeout=600) == 0
        listener.settle()
        assert world.end(node) == 0
    with PlaceMap.open(path, read_only=True) as site:
        after, numbers = site.trajectory("monday")[0], site.frames("monday")
        assert site.check() == [] and site.sessions[0].parts == (0,)
    assert after[: len(stamps)].tolist() == stamps.tolist() and len(stamps) > 3
    assert len(after) > len(stamps) + 3 and np.all(np.diff(after) > 0)
    assert numbers[: len(frames)].tolist() == frames.tolist() and np.all(np.diff(numbers) > 0)
