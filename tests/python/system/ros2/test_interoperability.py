# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Programs of others read what the nodes publish: another distribution, another vendor's DDS."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from benchmarks.ros.ros2_world import (
    PUBLISHER,
    PeerListener,
    Ros2Listener,
    Ros2World,
    lacking,
    type_store,
)
from benchmarks.ros.world import wait_until
from fusionslam.datasets.bags.messages import value_of
from fusionslam.sensors.messages import Scan
from live_results import CONNECTIONS
from project import SUPPORT
from ros_master import PlayedBag

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(bool(lacking), reason=lacking)]

OURS = (
    "/current_scene_description",
    "/LocalView/Template",
    "/PoseCell/TopologicalAction",
    "/ExperienceMap/Map",
    "/loop_closures",
)
SENSORS = ("/velodyne_points", "/camera/rgb/image_raw", "/camera/rgb/camera_info")
CYCLONE = SUPPORT / "cyclone_listener.py"


def start_all(world: Ros2World, bag: PlayedBag) -> None:
    """Start the nodes from sensors to the map, and that of loops, which takes any."""
    for name in ("ratslam", "lv_matching", "lv_builder"):
        world.node(name)
    world.node(
        "loop_closure",
        "_loop_closure.verify:=false",
        "_loop_closure.threshold:=1000.0",
        "_loop_closure.window:=2",
    )
    world.node("data_fusion", *bag.sensors)


def test_types_and_bytes_are_those_that_rosbags_makes(
    played_bag: PlayedBag, tmp_path: Path
) -> None:
    with Ros2World(tmp_path) as world:
        listener = world.listen(*OURS)
        start_all(world, played_bag)
        world.connect(listener, **CONNECTIONS, loop_closure="/rgb_cloud")
        world.play(played_bag.path, "--rate", "5")
        listener.settle()
        contents = [each for each in listener.contents() if each[0] in OURS]
        hashes = {topic: listener.type_hash(topic) for topic in OURS}
    types = {topic: type_name for topic, type_name, _ in contents}
    assert set(types) == set(OURS)
    for topic, type_name in types.items():
        assert type_name.startswith("fusionslam_msgs/msg/")
        assert hashes[topic] == type_store().hash_rihs01(type_name)
    for _, type_name, data in contents:
        assert_same_bytes(data, type_name)


def assert_same_bytes(data: bytes, type_name: str) -> None:
    """Those of rosbags, but for what fills gaps before larger numbers and at the end."""
    store = type_store()

    def write(content: bytes) -> bytes:
        return bytes(store.serialize_cdr(store.deserialize_cdr(content, type_name), type_name))

    wanted = write(data)
    assert len(data) == len(wanted) + -len(wanted) % 4
    for place in (k for k in range(len(wanted)) if wanted[k] != data[k]):
        changed = bytearray(wanted)
        changed[place] ^= 255
        assert write(bytes(changed)) == wanted


def test_another_distribution_reads_the_clouds(played_bag: PlayedBag, tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        own, peer = Ros2Listener(world, ("/rgb_cloud",)), PeerListener(world, ("/rgb_cloud",))
        world.node("data_fusion", *played_bag.sensors, "_node.queue:=1000")
        world.play(played_bag.path, "--rate", "1")
        own.settle()
        clouds = [each for each in own.contents() if each[0] == "/rgb_cloud"]
        wait_until(lambda: peer.count() >= len(clouds), "all clouds at the other distribution")
        assert [each for each in peer.contents() if each[0] == "/rgb_cloud"] == clouds
    assert len(clouds) == played_bag.scans


def test_a_node_takes_the_sensors_of_another_distribution(tmp_path: Path) -> None:
    with Ros2World(tmp_path) as world:
        listener = world.listen(
            "/rgb_cloud", "/velodyne_points", "/camera/rgb/image_raw", "/camera/rgb/camera_info"
        )
        # A publisher that a busy machine holds up is silent, after which scans wait no longer.
        frames = ("_online.robot_frame:=camera", "_fusion.frame:=scan", "_node.idle:=1000.0")
        world.node("data_fusion", *frames)
        process = world.peer("publisher", PUBLISHER, "2000", "5", "2")
        assert process.wait(timeout=300) == 0, world.log("publisher")
        wait_until(lambda: listener.count() >= 40, "all messages and clouds")
        found = listener.messages()
    assert len(found["/velodyne_points"]) == len(found["/rgb_cloud"]) == 10


def test_another_vendor_reads_a_cloud(played_bag: PlayedBag, tmp_path: Path) -> None:
    path = tmp_path / "cloud.pickle"
    with Ros2World(tmp_path) as world:
        listener = world.listen("/rgb_cloud")
        world.node("data_fusion", *played_bag.sensors)
        reader = world.peer("cyclone", CYCLONE, "/rgb_cloud", str(path))
        wait_until(lambda: "ready" in world.log("cyclone") or reader.poll() is not None, "Cyclone")
        world.play(played_bag.path, "--rate", "2")
        assert reader.wait(timeout=300) == 0, world.log("cyclone")
        listener.settle()
        clouds = {
            scan.stamp_ns: scan
            for each in listener.heard()
            if isinstance(scan := value_of(each.message, each.type_name, each.topic), Scan)
        }
    stamp_ns, frame, width, data = pickle.loads(path.read_bytes())
    cloud = clouds[stamp_ns]
    assert cloud.frame_id == frame and len(cloud.points) == width
    rows = np.frombuffer(data, np.float32).reshape(width, -1)
    np.testing.assert_array_equal(rows[:, :3], cloud.points)
