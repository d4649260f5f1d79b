# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes in ROS 2: parameters, qualities of service, bad input, services, ends and restarts."""

import json
import signal
from pathlib import Path
from typing import Any

import pytest

from benchmarks.ros.ros2_world import JAZZY, PUBLISHER, Ros2World, lacking
from benchmarks.ros.world import wait_until
from cli import fails
from fusionslam.config import unit_of, walk
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.ros.nodes.data_fusion import DataFusion
from ros_master import PlayedBag

needs_ros2 = pytest.mark.skipif(bool(lacking), reason=lacking)

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
LATE = """
sys.path.insert(0, sys.argv[1])
import publisher
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
messages = {publisher.SCANS: publisher.cloud(2000), publisher.IMAGES: publisher.image(),
            publisher.INFO: publisher.calibration()}
publishers = {topic: node.create_publisher(type(message), topic, 50)
              for topic, message in messages.items()}
kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
transforms = node.create_publisher(TFMessage, "/tf_static", kept)
while any(each.get_subscription_count() < 1 for each in (*publishers.values(), transforms)):
    time.sleep(0.1)
for number in range(12):
    if number == 6:
        link = TransformStamped(header=Header(frame_id="scanner"), child_frame_id="optical")
        transforms.publish(TFMessage(transforms=[link]))
    for topic, message in messages.items():
        frame = "scanner" if topic == publisher.SCANS else "optical"
        message.header = Header(stamp=rclpy.time.Time(seconds=100 + 0.2 * number).to_msg(),
                                frame_id=frame)
        for _ in range(2 if topic == publisher.SCANS else 1):
            publishers[topic].publish(message)
    time.sleep(0.2)
for each in (*publishers.values(), transforms):
    each.wait_for_all_acked(Duration(seconds=30))
"""


def run(world: Ros2World, name: str, code: str, *arguments: str) -> Any:
    """A program of plain rclpy."""
    return world.run(name, [str(JAZZY / "bin/python"), "-c", BEGIN + code, *arguments])


def answer(world: Ros2World, code: str, *arguments: str) -> Any:
    """What such a program prints."""
    process = run(world, "ask", code, *arguments)
    assert process.wait(timeout=300) == 0, world.log("ask")
    return json.loads(world.log("ask").splitlines()[-1])


def test_without_ros_2_the_commands_say_how_to_get_it() -> None:
    for words in (("run", "data_fusion"), ("play", "drive.bag"), ("check",)):
        assert "make ros2" in fails(2 if words[0] == "run" else 1, "ros2", *words)


@needs_ros2
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


@needs_ros2
@pytest.mark.parametrize(
    ("argument", "words"),
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


@needs_ros2
def test_arguments_of_ros_1_are_refused(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        command = [str(JAZZY / "bin/python"), "-m", "fusionslam", "ros2", "run", "data_fusion"]
        process = world.run("node", [*command, "_fusion/voxel:=1"])
        assert process.wait(timeout=300) == 2
        assert "--ros-args -p" in world.log("node")


@needs_ros2
@pytest.mark.parametrize(
    ("options", "words"),
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


@needs_ros2
def test_a_topic_of_another_type_is_named(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        run(world, "wrong", PUBLISH, "String", "RELIABLE")
        world.node("data_fusion")
        wait_until(lambda: "std_msgs/String" in world.log("data_fusion"), "the complaint")
        assert "expected sensor_msgs/PointCloud2" in world.log("data_fusion")


@needs_ros2
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


@needs_ros2
def test_a_node_asks_for_less_when_a_publisher_offers_less(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        world.node("data_fusion")
        first = run(world, "first", PUBLISH, "PointCloud2", "RELIABLE")
        wait_until(lambda: "points: reliable" in world.log("data_fusion"), "the first")
        world.end(first)
        run(world, "second", PUBLISH, "PointCloud2", "BEST_EFFORT")
        wait_until(lambda: "points: best effort" in world.log("data_fusion"), "the second")


@needs_ros2
def test_views_go_on_after_their_node_was_killed(played_bag: PlayedBag, tmp_path: Path) -> None:
    keep = "_memory.file:=views.npz"
    with Ros2World(tmp_path) as world:
        listener = world.listen("/LocalView/Template")
        matching = world.node("lv_matching", keep)
        world.node("lv_builder")
        world.node("data_fusion", *played_bag.sensors)
        heard = {"lv_builder": "/rgb_cloud", "lv_matching": "/current_scene_description"}
        world.connect(**heard)
        listener.wait_for("/LocalView/Template")
        world.play(played_bag.path, "--rate", "8", "--stop", "10")
        listener.settle()
        before = listener.messages()["/LocalView/Template"]
        world.end(matching, signal.SIGKILL)
        matching = world.node("lv_matching", keep)
        world.play(played_bag.path, "--rate", "8", "--start", "10")
        listener.settle()
        assert world.end(matching) == 0
        after = listener.messages()["/LocalView/Template"]
    assert len(after) > len(before) > 5
    stamps = [stamp_of(each.header.stamp) for each in after]
    assert stamps == sorted(stamps)
    new = [each.current_id for each in after if each.is_new]
    assert new == list(range(len(new)))


@needs_ros2
def test_services_answer_with_the_reason(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        node = world.node("mapper", "_map.file:=site.fsmap")
        found, code, reason, solved = answer(world, LOCALIZE)
        assert not found and code == "no-frame" and "sensors" in reason and solved
        assert world.end(node) == 0


@pytest.mark.nightly
@needs_ros2
def test_a_bag_that_is_played_again_gives_all_clouds_again(
    played_bag: PlayedBag, tmp_path: Path
) -> None:
    with Ros2World(tmp_path) as world:
        listener = world.listen("/rgb_cloud")
        world.node("data_fusion", *played_bag.sensors, "_online.wait:=60.0", "_node.queue:=1000")
        listener.wait_for("/rgb_cloud")
        for _ in range(2):
            world.play(played_bag.path, "--rate", "8")
            listener.settle()
        stamps = [stamp_of(each.header.stamp) for each in listener.messages()["/rgb_cloud"]]
        assert "the clock went back" in world.log("data_fusion")
    assert len(stamps) == 2 * played_bag.scans
    assert stamps[: played_bag.scans] == stamps[played_bag.scans :]


@needs_ros2
def test_scans_wait_for_late_transforms_and_count_once(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        listener = world.listen("/rgb_cloud")
        frames = ("_online.robot_frame:=scanner", "_fusion.frame:=scan", "_online.wait:=60.0")
        # A driver that a busy machine holds up is silent, after which scans do not wait any longer.
        world.node("data_fusion", *frames, "_node.idle:=1000.0")
        listener.wait_for("/rgb_cloud")
        driver = run(world, "driver", LATE, str(PUBLISHER.parent))
        assert driver.wait(timeout=300) == 0, world.log("driver")
        wait_until(lambda: listener.count() >= 12, "all clouds")
        listener.settle()
        stamps = [stamp_of(each.header.stamp) for each in listener.messages()["/rgb_cloud"]]
        assert "is its driver running twice" in world.log("data_fusion")
    assert len(stamps) == 12 and stamps == sorted(set(stamps))
