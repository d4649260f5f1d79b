# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Launch files and pictures of RViz fit the nodes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from fusionslam.ros.nodes import NODES, node_class
from fusionslam.ros.nodes.mapper import MapFileConfig
from fusionslam.ros.ros1.files import package_folder
from project import PROJECT
from ros_master import needs_ros
from rows import rows

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


@rows("name", EXPERIMENTS)
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
