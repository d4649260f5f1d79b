# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Launch files and pictures of RViz fit the nodes, and a bag runs through them to its end."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from fusionslam.ratslam import OnlineRatSlam
from fusionslam.ros.nodes import NODES, node_class
from fusionslam.ros.nodes.mapper import MapFileConfig
from fusionslam.ros.ros1.files import launch_environment, package_folder
from project import PROJECT
from ros_master import PlayedBag, RosWorld, needs_ros, wait_until

pytestmark = needs_ros

LAUNCH = PROJECT / "ros" / "launch"
CLOUDS = {"data_fusion", "lv_builder", "lv_matching"}
EXPERIMENTS = {
    "first_stage": CLOUDS | {"lv_analyzer"},
    "two_stages": CLOUDS | {"lv_analyzer"},
    "ratslam": CLOUDS | {"lv_analyzer", "ratslam"},
    "visual": {"lv_matching", "lv_analyzer", "ratslam"},
    "loops": {"data_fusion", "loop_closure"},
    "mapper": {"mapper"},
}


def parse_launch(path: Path, *options: str) -> tuple[set[str], dict[str, Any]]:
    """The nodes that roslaunch would start, and the parameters it would set."""
    from roslaunch.config import ROSLaunchConfig
    from roslaunch.xmlloader import XmlLoader

    config = ROSLaunchConfig()
    XmlLoader().load(str(path), config, argv=list(options), verbose=False)
    return (
        {each.name for each in config.nodes},
        {key: parameter.value for key, parameter in config.params.items()},
    )


def read_arguments(path: Path) -> dict[str, str]:
    """Arguments that can be given, with their defaults."""
    found = ElementTree.parse(path).getroot().findall("arg")
    return {each.attrib["name"]: each.get("default", "") for each in found if not each.get("value")}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_takes_every_argument_it_declares(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(package_folder()))
    monkeypatch.setenv("PWD", "/here")
    path, parameters = LAUNCH / f"{name}.launch", tmp_path / "parameters.yaml"
    parameters.write_text("data_fusion: {fusion: {ground: plane}}")
    wanted = EXPERIMENTS[name]
    assert parse_launch(path)[0] == wanted - {"lv_analyzer"}
    given = {key: "any" for key, default in read_arguments(path).items() if not default}
    every = {**read_arguments(path), **given, "parameters": str(parameters)}
    every |= {"rviz": "true", "live": "true"}
    options = [f"{key}:={value}" for key, value in every.items()]
    assert parse_launch(path, *options)[0] == wanted | {"rviz", "live_view"}
    through = "bag:=any.bag", f"experiment:={name}"
    nodes, values = parse_launch(LAUNCH / "bag.launch", *through, *options)
    assert nodes == wanted | {"rviz", "live_view", "bag_player"}
    assert values["/data_fusion/fusion/ground"] == "plane" and values["/use_sim_time"] is True
    assert values["/bag_player/bag"] == "/here/any.bag"
    files = [value for key, value in values.items() if key.endswith("memory/file")]
    assert files == ["/here/any"] * {"ratslam": 2, "visual": 2, "mapper": 0}.get(name, 1)


def test_bags_take_every_argument_of_every_experiment() -> None:
    of_bags = read_arguments(LAUNCH / "bag.launch")
    for name in EXPERIMENTS:
        own = read_arguments(LAUNCH / f"{name}.launch")
        assert own.items() <= of_bags.items()


class Anybody:
    """An outlet for nodes that publish nothing."""


def topics(name: str, **values: Any) -> set[str]:
    kind = node_class(name)
    node = kind(kind.defaults.model_copy(update=values), Anybody())
    return {each.topic for each in node.inputs} | set(kind.outputs)


def list_nodes() -> Iterator[ElementTree.Element]:
    for path in LAUNCH.rglob("*.launch"):
        yield from ElementTree.parse(path).getroot().findall("node")


def _needed(name: str, folder: Path) -> dict[str, Any]:
    """Values of parameters without which a node cannot be made."""
    return {"map": MapFileConfig(file=str(folder / "site.fsmap"))} if name == "mapper" else {}


def test_remappings_and_parameters_are_those_of_the_nodes(tmp_path: Path) -> None:
    ours = [each for each in list_nodes() if each.attrib["type"] in NODES]
    assert {each.attrib["type"] for each in ours} == set(NODES) - {"lv_dataset_creator"}
    for each in ours:
        name = each.attrib["type"]
        defaults = node_class(name).defaults.model_dump()
        for parameter in each.findall("param"):
            value: Any = defaults
            for part in parameter.attrib["name"].split("/"):
                value = value[part]
        if name == "live_view":
            assert not each.findall("remap")  # it is not made here: that opens its port
            continue
        known = topics(name, **_needed(name, tmp_path))
        if name == "lv_matching":
            known |= topics(name, source="visual_templates")
        if name == "lv_analyzer":
            known |= topics(name, output="somewhere")
        assert {remap.attrib["from"] for remap in each.findall("remap")} <= known


def read_topics(path: Path) -> set[str]:
    """Topics of a picture of RViz."""
    displays = yaml.safe_load(path.read_text())["Visualization Manager"]["Displays"]
    return {str(value) for each in displays for key, value in each.items() if key.endswith("Topic")}


def test_pictures_show_what_the_nodes_of_their_experiment_publish() -> None:
    pictures = {path.stem: read_topics(path) for path in (LAUNCH.parent / "rviz").glob("*.rviz")}
    assert set(pictures) == {"clouds", "map", "visual", "loops", "mapper"}
    for name, wanted in EXPERIMENTS.items():
        (picture,) = (
            each.attrib["value"]
            for each in ElementTree.parse(LAUNCH / f"{name}.launch").getroot().findall("arg")
            if each.attrib["name"] == "picture"
        )
        published = {
            f"/{topic.replace('~', f'{node}/')}"
            for node in wanted
            for topic in node_class(node).outputs
        }
        assert pictures[picture] <= published | {"/camera/rgb/image_raw"}


def play(world: RosWorld, *arguments: str) -> int:
    """Exit code of ``fusionslam ros launch bag``."""
    code = "from fusionslam.__main__ import main; main()"
    command = [sys.executable, "-c", code, "ros", "launch", "bag", *arguments]
    return world.run("launch", command).wait(timeout=1800)


def test_a_bag_runs_through_all_nodes_to_its_end(played_bag: PlayedBag, tmp_path: Path) -> None:
    # However slow the machine is, nothing is dropped.
    patient: dict[str, Any] = {name: {"node": {"queue": 1000}} for name in EXPERIMENTS["ratslam"]}
    patient["data_fusion"]["online"] = {"wait": 60.0}
    for name in ("lv_matching", "ratslam"):
        patient[name]["order"] = {"wait": 60.0}
    (tmp_path / "patient.yaml").write_text(yaml.safe_dump(patient))
    with RosWorld(tmp_path) as world:
        # As an earlier roslaunch leaves it.
        left = ["rosparam", "set", "/roslaunch/uris/earlier", "http://127.0.0.1:9/"]
        assert world.run("rosparam", left).wait() == 0
        # As a player that was killed leaves it.
        import rosgraph

        master = rosgraph.Master("/killed", world.environment["ROS_MASTER_URI"])
        for topic in ("/velodyne_points", "/odom", played_bag.image, played_bag.camera_info):
            master.registerPublisher(topic, "*", "http://127.0.0.1:9/")
        listener = world.listen("/LocalView/Template", "/ExperienceMap/Map")
        files = ("map_file:=map.npz", "views_file:=views.npz", "parameters:=patient.yaml")
        assert play(world, f"bag:={played_bag.path}", "rate:=10", *files) == 0, world.log("launch")
        found = listener.messages()
    assert f"guessed by type: image:={played_bag.image}" in world.log("launch")
    log = world.log("launch")
    assert "REQUIRED process [bag_player-5] has died!\nprocess has finished cleanly" in log
    (made,) = (line for line in log.splitlines() if line.startswith("  /ratslam: "))
    assert f"{len(found['/ExperienceMap/Map'][-1].node)} nodes" in made
    assert str(tmp_path / "map.npz") in made
    assert log.index(made) < log.index("regular end") < log.index("REQUIRED process")
    views = found["/LocalView/Template"]
    assert len(views) == played_bag.scans
    # Where a scan shows no known place, odometry may still have the robot at one.
    assert sum(each.current_id >= 0 for each in views) >= 0.9 * played_bag.scans
    assert {each.current_id for each in views if "odometry has" in each.reason} <= {-1}
    kept = OnlineRatSlam.load(tmp_path / "map.npz").slam
    assert len(kept.map.nodes) > 3 and (tmp_path / "views.npz").is_file()
    assert len(found["/ExperienceMap/Map"][-1].node) == len(kept.map.nodes)


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


@pytest.mark.parametrize(
    ("wrong", "named"),
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


def test_roslaunch_finds_the_nodes_without_a_workspace(tmp_path: Path) -> None:
    with RosWorld(tmp_path) as world:
        world.environment |= {"ROS_PACKAGE_PATH": str(package_folder())}
        world.environment["PATH"] = launch_environment()["PATH"]
        node = world.run("node", ["rosrun", "fusionslam_ros", "lv_builder"])
        wait_until(lambda: "is ready" in world.log("node") or node.poll() is not None, "a node")
        assert world.end(node) == 0, world.log("node")
        assert "lv_builder is ready" in world.log("node")
