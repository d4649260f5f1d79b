# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""On a live ROS, bags run through all nodes to their end, with the results of the commands."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from fusionslam.ratslam import OnlineRatSlam
from fusionslam.ros.ros1.files import launch_environment, package_folder
from live_results import OUTPUTS, PATIENT_PAIRING, Offline, assert_same_results
from ros_master import PlayedBag, RosWorld, needs_ros, wait_until
from rows import rows

pytestmark = needs_ros


def play(world: RosWorld, *arguments: str) -> int:
    """Exit code of ``fusionslam ros launch bag``."""
    code = "from fusionslam.__main__ import main; main()"
    command = [sys.executable, "-c", code, "ros", "launch", "bag", *arguments]
    return world.run("launch", command).wait(timeout=1800)


def patient_parameters() -> str:
    """Of nodes that drop nothing, and hold no pause for a silence, however slow the machine is."""
    common = {"queue": 1000, "idle": 3.0}
    names = ("data_fusion", "lv_builder", "lv_matching", "ratslam")
    nodes: dict[str, dict[str, object]] = {
        name: {"node": common, "order": {"wait": 600.0}} for name in names
    }
    nodes["data_fusion"] = {"node": common, "online": PATIENT_PAIRING}
    nodes["lv_builder"] = {"node": common}
    return yaml.safe_dump(nodes)


@pytest.mark.slow
def test_a_bag_runs_through_all_nodes_with_clouds_ids_and_map_of_the_commands(
    offline: Offline, tmp_path: Path
) -> None:
    import rosgraph

    bag = offline.bag
    (tmp_path / "patient.yaml").write_text(patient_parameters())
    with RosWorld(tmp_path) as world:
        # As an earlier roslaunch, and a player that was killed, leave it.
        left = ["rosparam", "set", "/roslaunch/uris/earlier", "http://127.0.0.1:9/"]
        assert world.run("rosparam", left).wait() == 0
        master = rosgraph.Master("/killed", world.environment["ROS_MASTER_URI"])
        for topic in ("/velodyne_points", "/odom", bag.image, bag.camera_info):
            master.registerPublisher(topic, "*", "http://127.0.0.1:9/")
        listener = world.listen(*OUTPUTS)
        files = ("map_file:=map.npz", "views_file:=views.npz", "parameters:=patient.yaml")
        assert play(world, f"bag:={bag.path}", "rate:=5", *files) == 0, world.log("launch")
        found, log = listener.messages(), world.log("launch")
    assert_same_results(found, offline)
    assert f"guessed by type: image:={bag.image}" in log
    (made,) = (line for line in log.splitlines() if line.startswith("  /ratslam: "))
    nodes = len(offline.run.nodes)
    assert f"{nodes} nodes" in made and str(tmp_path / "map.npz") in made
    assert log.index(made) < log.index("regular end") < log.index("REQUIRED process [bag_player-5]")
    assert "has died!\nprocess has finished cleanly" in log
    assert len(OnlineRatSlam.load(tmp_path / "map.npz").slam.map.nodes) == nodes
    assert (tmp_path / "views.npz").is_file()


@pytest.mark.nightly
@pytest.mark.parametrize("rate", [1, 5])
def test_nodes_that_are_started_one_by_one_give_the_same(
    rate: int, offline: Offline, tmp_path: Path
) -> None:
    with RosWorld(tmp_path) as world:
        listener = world.listen(*OUTPUTS)
        for name in ("ratslam", "lv_matching", "lv_builder"):
            world.node(name)
        world.node("data_fusion", *offline.bag.sensors)
        world.play(offline.bag.path, "-r", str(rate))
        listener.settle()
        assert_same_results(listener.messages(), offline)


_DRIVER = """
from fusionslam.ros.ros1.environment import need_ros
need_ros()
import rospy
from sensor_msgs.msg import PointCloud2
rospy.init_node("driver")
publisher = rospy.Publisher("/velodyne_points", PointCloud2, queue_size=1)
print("is ready", flush=True)
rospy.spin()
"""


@pytest.mark.nightly
def test_a_topic_that_another_node_publishes_is_not_played(
    played_bag: PlayedBag, tmp_path: Path
) -> None:
    with RosWorld(tmp_path) as world:
        world.run("driver", [sys.executable, "-uc", _DRIVER])
        wait_until(lambda: "is ready" in world.log("driver"), "a driver")
        listener = world.listen("/velodyne_points", "/odom")
        options = (f"bag:={played_bag.path}", "experiment:=first_stage", "rate:=20")
        assert play(world, *options) == 0, world.log("launch")
        found = listener.messages()
        log = world.log("launch")
    assert found["/odom"] and not found["/velodyne_points"]
    (warning,) = (line for line in log.splitlines() if "is not played" in line)
    assert "/velodyne_points" in warning and "/driver" in warning


@pytest.mark.nightly
@rows(
    "wrong, named",
    [
        (["experiment:=visual", "image:=/nope", "odom:=/no"], "bag_player: the bag"),
        (["parameters:=wrong.yaml"], "bag_player: /lv_matching"),
    ],
)
def test_a_wrong_topic_or_parameter_ends_all(
    wrong: list[str], named: str, played_bag: PlayedBag, tmp_path: Path
) -> None:
    (tmp_path / "wrong.yaml").write_text("lv_matching: {viewz: 1}")
    with RosWorld(tmp_path) as world:
        play(world, f"bag:={played_bag.path}", "experiment:=first_stage", *wrong)
        log = world.log("launch")
    assert f"error: {named}" in log
    assert "Initiating shutdown!" in log and "Traceback" not in log


def test_nodes_of_a_launch_file_run_with_this_python() -> None:
    environment = launch_environment()
    assert environment["ROS_PACKAGE_PATH"].split(os.pathsep)[0] == str(package_folder())
    command = ["python3", "-c", "import sys; print(sys.prefix)"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == sys.prefix


@pytest.mark.nightly
def test_roslaunch_finds_the_nodes_without_a_workspace(tmp_path: Path) -> None:
    with RosWorld(tmp_path) as world:
        world.environment |= {"ROS_PACKAGE_PATH": str(package_folder())}
        world.environment["PATH"] = launch_environment()["PATH"]
        node = world.run("node", ["rosrun", "fusionslam_ros", "lv_builder"])
        wait_until(lambda: "is ready" in world.log("node") or node.poll() is not None, "a node")
        assert world.end(node) == 0, world.log("node")
        assert "lv_builder is ready" in world.log("node")
