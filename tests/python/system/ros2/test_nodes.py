# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes in ROS 2: parameters, qualities of service, bad input, services, ends and restarts."""

import json
import signal
from pathlib import Path
from typing import Any

import pytest

from benchmarks.ros.ros2_world import JAZZY, Ros2World, lacking
from benchmarks.ros.world import wait_until
from fusionslam.config import unit_of, walk
from fusionslam.ros.nodes.data_fusion import DataFusion
from ros_master import PlayedBag
from rows import rows

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(bool(lacking), reason=lacking)]

BEGIN = """
import json, sys, time
import rclpy
rclpy.init()
node = rclpy.create_node("other")
def ask(kind, name, **fields):
    client = node.create_client(kind, name)
    assert client.wait_for_service(60), name
    future = client.call_async(kind.Request(**fields))
    rclpy.spin_until_future_complete(node, future, timeout_sec=120)
    return future.result()
"""
PARAMETERS = """
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
found = ask(DescribeParameters, "/data_fusion/describe_parameters", names=sys.argv[1:])
value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=0.5)
changed = ask(SetParameters, "/data_fusion/set_parameters",
              parameters=[Parameter(name="fusion.voxel", value=value)])
print(json.dumps({
    "refused": not changed.results[0].successful,
    "descriptions": {each.name: each.description for each in found.descriptors},
    "voxel": [[r.from_value for r in each.floating_point_range] for each in found.descriptors
              if each.name == "fusion.voxel"][0],
}))
"""
LOCALIZE = """
from fusionslam_msgs.srv import Localize
from std_srvs.srv import Trigger
found = ask(Localize, "/mapper/localize")
solved = ask(Trigger, "/mapper/solve")
print(json.dumps([found.found, found.code, found.reason, solved.success]))
"""
PUBLISH = """
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from sensor_msgs.msg import PointCloud2
kind, reliability = {"String": String, "PointCloud2": PointCloud2}[sys.argv[1]], sys.argv[2]
quality = QoSProfile(depth=5, reliability=ReliabilityPolicy[reliability])
publisher = node.create_publisher(kind, "/velodyne_points", quality)
print("is ready", flush=True)
while True:
    publisher.publish(kind())
    rclpy.spin_once(node, timeout_sec=0.1)
"""


def run(world: Ros2World, name: str, code: str, *arguments: str) -> Any:
    """A program of plain rclpy."""
    return world.run(name, [str(JAZZY / "bin/python"), "-c", BEGIN + code, *arguments])


def answer(world: Ros2World, code: str, *arguments: str) -> Any:
    """What such a program prints."""
    process = run(world, "ask", code, *arguments)
    assert process.wait(timeout=300) == 0, world.log("ask")
    return json.loads(world.log("ask").splitlines()[-1])


def test_parameters_are_described_and_cannot_be_set(tmp_path: Path) -> None:
    values = {key: definition for key, _, definition in walk(DataFusion.defaults)}
    with Ros2World(tmp_path) as world:
        world.node("data_fusion", "_fusion.voxel:=0.25")
        found = answer(world, PARAMETERS, *values)
    assert found["refused"] and found["voxel"] == [0.0]
    assert found["descriptions"].keys() == values.keys()
    for key, definition in values.items():
        unit = unit_of(definition)
        assert definition.description and definition.description in found["descriptions"][key]
        assert not unit or f"[{unit}]" in found["descriptions"][key]


@rows(
    "argument, words",
    [
        ("_fusion.voxl:=0.1", "unknown parameter 'fusion.voxl'; did you mean 'voxel'"),
        ("_fusion.voxel:=-1.0", "fusion.voxel"),
        ("_fusion.voxel:=much", "fusion.voxel"),
        ("_node.stamps:=heder", "did you mean"),
    ],
)
def test_wrong_parameters_are_refused(argument: str, words: str, tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        process = world.node("data_fusion", argument, ready=False)
        assert process.wait(timeout=300) == 2
        text = world.log("data_fusion")
    assert words in text and "Traceback" not in text and "~" not in text


@rows(
    "options, words",
    [
        (("--topic", "/x"), "has no topic /x: expected"),
        (("--start", "99"), "none of the topics has a message from 99 s on"),
        (("--rate", "0"), "--rate is 0"),
    ],
)
def test_a_bag_that_cannot_be_played_as_asked_says_why(
    options: tuple[str, str], words: str, played_bag: PlayedBag, tmp_path: Path
) -> None:
    with Ros2World(tmp_path) as world:
        player = world.start_player(played_bag.path, "--wait", "0", *options)
        assert player.wait(timeout=300) in (1, 2)
        assert words in world.log("rosbag") and "Traceback" not in world.log("rosbag")


def test_a_topic_of_another_type_is_named(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        run(world, "wrong", PUBLISH, "String", "RELIABLE")
        world.node("data_fusion")
        wait_until(lambda: "std_msgs/String" in world.log("data_fusion"), "the complaint")
        assert "expected sensor_msgs/PointCloud2" in world.log("data_fusion")


def test_a_best_effort_scanner_is_heard_and_a_second_one_is_named(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        node = world.node("data_fusion")
        run(world, "first", PUBLISH, "PointCloud2", "BEST_EFFORT")
        wait_until(lambda: "points: best effort" in world.log("data_fusion"), "the first")
        # What it sends has no fields.
        wait_until(lambda: "point fields are none" in world.log("data_fusion"), "what it sends")
        run(world, "second", PUBLISH, "PointCloud2", "RELIABLE")
        wait_until(lambda: "several publishers" in world.log("data_fusion"), "the second")
        assert world.end(node, signal.SIGTERM) == 0


def test_services_answer_with_the_reason(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        node = world.node("mapper", "_map.file:=site.fsmap")
        found, code, reason, solved = answer(world, LOCALIZE)
        assert not found and code == "no-frame" and "sensors" in reason and solved
        assert world.end(node) == 0
