# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Launch files and pictures of RViz 2 are those of ROS 1 over again.

``ros2 launch`` itself does not run here, as no wheels have it: a stand-in records what is started.
"""

import os
import re
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from fusionslam.ros.nodes import NODES, node_class
from launch_stand_in import (
    DeclareLaunchArgument,
    Node,
    Shutdown,
    describe,
    launch,
    use_stand_in,
)
from project import PROJECT
from rows import rows

ROS1 = PROJECT / "ros"
ROS2 = PROJECT / "ros2" / "fusionslam_ros2"
NAMES = sorted(path.stem for path in (ROS1 / "launch").glob("*.launch"))
EXPERIMENTS = [name for name in NAMES if name != "bag"]
MANY = {
    **{"scan": "/points", "image": "/cam/image", "camera_info": "/cam/info", "odom": "/wheels"},
    **{"truth": "/truth", "rviz": "true", "views_file": "/kept/views.npz"},
    **{"map_file": "/kept/map.npz", "loops_folder": "/kept/loops", "read_only": "true"},
    **{"site": "/kept/site.fsmap", "session": "monday"},
}
GIVEN = [{}, MANY, {**MANY, "views": "cm2dp"}, {"views": "cm2dp", "parameters": "of a file"}]
GROUND = {"fusion": {"ground": "plane"}}

Started = dict[str, tuple[str, dict[str, Any], dict[str, str]]]
"""Of each node its executable, parameters and remappings."""


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    use_stand_in(monkeypatch, ROS2)
    monkeypatch.chdir("/")


def file_of(name: str) -> Path:
    return ROS2 / "launch" / f"{name}.launch.py"


class Ros1Launch:
    """Reads a launch file of ROS 1 as roslaunch does."""

    def __init__(self, path: Path, given: Mapping[str, str]) -> None:
        self.args = dict(given)
        self.nodes: dict[str, ElementTree.Element] = {}
        self.parameters: dict[str, Any] = {}
        self.started: Started = {}
        self._read(path)

    def _read(self, path: Path) -> None:
        for each in ElementTree.parse(path).getroot():
            if not self._applies(each):
                continue
            if each.tag == "arg" and "value" in each.attrib:
                self.args[each.attrib["name"]] = self._text(each.attrib["value"])
            elif each.tag == "arg":
                self.args.setdefault(each.attrib["name"], each.get("default", ""))
            elif each.tag == "param":
                self.parameters[each.attrib["name"]] = self._value(each)
            elif each.tag == "rosparam":
                content = yaml.safe_load(Path(self._text(each.attrib["file"])).read_text())
                for node, values in content.items():
                    self.parameters |= {f"{node}/{key}": v for key, v in flat(values, "/")}
            elif each.tag == "include":
                file = each.attrib["file"].replace("$(dirname)", str(path.parent))
                self._read(Path(self._text(file)))
            else:
                self.nodes[each.attrib["name"]] = each

    def start(self) -> Started:
        """The nodes, once all is read."""
        for name, node in self.nodes.items():
            own = [each for each in node.findall("param") if self._applies(each)]
            prefix = f"{name}/"
            common = {
                key.removeprefix(prefix): value
                for key, value in self.parameters.items()
                if key.startswith(prefix) or key == "use_sim_time"
            }
            parameters = common | {each.attrib["name"]: self._value(each) for each in own}
            renamed = {
                each.attrib["from"]: self._text(each.attrib["to"]) for each in node.findall("remap")
            }
            dotted = {key.replace("/", "."): value for key, value in parameters.items()}
            self.started[name] = node.attrib["type"], {"use_sim_time": False} | dotted, renamed
        return self.started

    def _applies(self, element: ElementTree.Element) -> bool:
        wanted = self._text(element.get("if", "true")) in ("true", "True")
        return wanted and self._text(element.get("unless", "false")) in ("false", "False")

    def _value(self, parameter: ElementTree.Element) -> Any:
        text = self._text(parameter.attrib["value"])
        return text if parameter.get("type") == "str" else yaml.safe_load(text)

    def _text(self, text: str) -> str:
        if found := re.fullmatch(r"\$\(eval (.*)\)", text, re.DOTALL):
            switches = {"true": True, "false": False}
            names = {key: switches.get(value, value) for key, value in self.args.items()}
            return str(eval(found[1], {"env": {"PWD": ""}.__getitem__}, names))
        text = text.replace("$(find fusionslam_ros)", "/share/fusionslam_ros2")
        return re.sub(r"\$\(arg (\w+)\)", lambda found: self.args[found[1]], text)


def flat(values: Mapping[str, Any], separator: str) -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from ((f"{key}{separator}{inner}", v) for inner, v in flat(value, separator))
        else:
            yield key, value


def read_ros2(nodes: list[Node]) -> Started:
    """The same of ROS 2; of two values of a parameter the later one holds."""
    started: Started = {}
    for node in nodes:
        parameters: dict[str, Any] = {}
        for each in node.parameters:
            if isinstance(each, str):
                content = yaml.safe_load(Path(each).read_text()).get(node.name, {})
                parameters |= flat(content.get("ros__parameters", {}), ".")
            else:
                parameters |= each
        for key in ("map.file", "memory.file"):
            if key in parameters:
                parameters[key] = os.path.abspath(parameters[key])
        started[node.name] = node.executable, parameters, dict(node.remappings)
    return started


def read_both(name: str, folder: Path, given: Mapping[str, str]) -> tuple[Started, Started]:
    """What ROS 1 and ROS 2 start, with the same parameters from a file."""
    files = [folder / "ros1.yaml", folder / "ros2.yaml"]
    files[0].write_text(yaml.safe_dump({"data_fusion": GROUND}))
    files[1].write_text(yaml.safe_dump({"data_fusion": {"ros__parameters": GROUND}}))
    paths = [str(each) if "parameters" in given else "" for each in files]
    old = Ros1Launch(ROS1 / "launch" / f"{name}.launch", {**given, "parameters": paths[0]}).start()
    return old, read_ros2(launch(file_of(name), {**given, "parameters": paths[1]}))


def test_each_launch_file_of_ros_1_has_one_in_ros_2() -> None:
    assert sorted(p.name.split(".")[0] for p in (ROS2 / "launch").iterdir()) == NAMES


@rows("name", NAMES)
def test_launch_files_take_the_arguments_of_ros_1_and_the_clock(name: str) -> None:
    file = ElementTree.parse(ROS1 / "launch" / f"{name}.launch").getroot()
    old = {e.attrib["name"]: e.get("default") for e in file.findall("arg") if not e.get("value")}
    declared = [e for e in describe(file_of(name)).entities if isinstance(e, DeclareLaunchArgument)]
    found = {each.name: each.default_value for each in declared}
    assert found == old | {"use_sim_time": "true" if name == "bag" else "false"}
    assert all(each.description for each in declared)


@rows("name, given", product(EXPERIMENTS, GIVEN))
def test_launch_files_start_the_nodes_of_ros_1(
    name: str, given: dict[str, str], tmp_path: Path
) -> None:
    old, new = read_both(name, tmp_path, given)
    if "rviz" in old:
        assert (old["rviz"][0], new["rviz"][0]) == ("rviz", "rviz2")
        old["rviz"] = "rviz2", *old["rviz"][1:]
    assert new == old


@rows("name", EXPERIMENTS)
def test_a_bag_is_played_through_each_experiment(name: str, tmp_path: Path) -> None:
    given = {"bag": "/a.bag", "experiment": name, "rate": "2"}
    old, new = read_both("bag", tmp_path, given)
    parameters = old.pop("bag_player")[1]
    assert new.pop("bag_player")[0] == "bag_player" and new == old
    player = launch(file_of("bag"), given)[-1]
    rate = ("--rate", str(parameters["rate"]))
    assert player.arguments == [parameters["bag"], *rate, "--until-idle"]
    assert [type(each) for each in player.on_exit] == [Shutdown]
    assert not launch(file_of("bag"), {**given, "stay": "true"})[-1].on_exit


def test_nodes_are_in_the_package_and_report_on_the_console() -> None:
    for name in EXPERIMENTS:
        for node in launch(file_of(name), MANY):
            if node.name == "rviz":
                old = Ros1Launch(ROS1 / "launch" / f"{name}.launch", MANY)
                words = old._text(old.nodes["rviz"].attrib["args"]).split()
                assert node.package == "rviz2" and node.arguments == words
                assert (ROS2 / Path(words[-1]).relative_to("/share/fusionslam_ros2")).is_file()
            else:
                assert (node.package, node.output) == ("fusionslam_ros2", "screen")


def read_displays(path: Path) -> dict[str, dict[str, Any]]:
    picture = yaml.safe_load(path.read_text())["Visualization Manager"]
    return {each["Name"]: each for each in picture["Displays"]}


@rows("path", sorted((ROS1 / "rviz").iterdir()))
def test_pictures_show_what_those_of_ros_1_show_as_it_is_published(path: Path) -> None:
    kept = {
        "/" + topic.replace("~", f"{name}/") for name in NODES for topic in node_class(name).latched
    }
    old, new = read_displays(path), read_displays(ROS2 / "rviz" / path.name)
    assert list(new) == list(old)
    for name, display in new.items():
        before = {
            "Topic" if key.endswith(" Topic") else key: value for key, value in old[name].items()
        }
        before["Class"] = before["Class"].replace("rviz/", "rviz_default_plugins/")
        quality = display.pop("Topic", None)
        topic = before.pop("Topic", None)
        assert display == before
        if topic:
            assert quality["Value"] == topic
            assert (quality["Durability Policy"] == "Transient Local") == (topic in kept)
            of_the_robot = topic.startswith("/camera/")
            assert (quality["Reliability Policy"] == "Best Effort") == of_the_robot
