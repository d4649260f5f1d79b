# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Check that a running robot, or a bag being played, has what the nodes need."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fusionslam.doctor import Finding
from fusionslam.errors import ConfigError
from fusionslam.pipelines.overview import Overview
from fusionslam.ros.check.evidence import Evidence
from fusionslam.ros.check.findings import list_findings
from fusionslam.ros.check.master import read_graph, silent_nodes
from fusionslam.ros.ros1.environment import need_ros
from fusionslam.ros.topic_choice import INPUTS, LAUNCH_ARGUMENTS, needed_roles, roles_of

if TYPE_CHECKING:
    from fusionslam.ros.check.listener import Progress

_NAME = "fusionslam_check"
_NODES = {
    "data_fusion": {"clouds"},
    "lv_builder": {"clouds"},
    "lv_matching": {"clouds"},
    "loop_closure": {"clouds"},
    "lv_analyzer": {"clouds", "truth"},
    "lv_dataset_creator": {"clouds", "truth"},
    "mapper": {"clouds", "odometry"},
    "ratslam": {"views", "odometry"},
    "lv_matching with _source:=visual_templates": {"images alone"},
}
_FILES = {
    "visual": {"left", "odometry"},
    "loops": {"clouds"},
    "first_stage": {"clouds"},
    "two_stages": {"clouds"},
    "mapper": {"clouds", "odometry"},
    "ratslam": {"clouds", "odometry"},
}
"""Needs of nodes and launch files; the launch file that does most is the last."""
_LACKS = {
    "clouds": "there are no coloured clouds",
    "odometry": "ratslam and mapper lack odometry",
    "truth": "lv_analyzer and lv_dataset_creator lack true poses",
}
_OF_IMAGES = ("left", "odometry", "truth")


@dataclass(frozen=True)
class Check:
    """The result of checking a robot.

    Attributes:
        overview: what arrived, as ``fusionslam info`` summarises a bag.
        findings: one for each aspect checked.
        again: the arguments given, with the remappings that the nodes need to find their topics;
            empty if they need none.
        nodes: the nodes that can work.
        files: the launch files that can work.
        lacking: what some nodes lack: "clouds", "odometry" or "truth".
        launch: name and arguments of the launch file that uses most of the robot; empty if none.
        works: whether data_fusion can work as requested.
    """

    overview: Overview
    findings: Sequence[Finding]
    again: Sequence[str]
    nodes: Sequence[str]
    files: Sequence[str]
    lacking: Sequence[str]
    launch: Sequence[str]
    works: bool

    @property
    def verdict(self) -> str:
        """Which nodes and launch files can work, and what the others lack."""
        start = "With these remappings, this" if self.again else "This"
        launch = f" (launch files {', '.join(self.files)})" if self.files else ""
        suffices = f"{start} suffices for {', '.join(self.nodes) or 'none of the nodes'}{launch}"
        return "; ".join([suffices, *(_LACKS[what] for what in self.lacking)]) + "."


def check_robot(arguments: Sequence[str], seconds: float, progress: "Progress") -> Check:
    """Listen to a robot and judge it. Only once per process: rospy allows no more.

    Args:
        arguments: remappings and parameters (_fusion/source:=stereo) as data_fusion takes them,
            or topics as launch files do (scan:=/points).
        seconds: how long to wait for a sensor, and then to listen.
        progress: called with the name of the step, seconds done and total seconds.

    Raises:
        FusionSlamError: ROS is missing, or no master answers.
        ConfigError: a malformed argument, or a parameter that data_fusion does not know.
    """
    if wrong := [argument for argument in arguments if ":=" not in argument]:
        raise ConfigError(
            f"{wrong[0]!r} is no remapping, expected NAME:=TOPIC", code="no-remapping"
        )
    need_ros()
    read_graph()  # fails without a master; rospy would wait for ever
    import rospy

    # Keep topic remappings from rospy: guessed topics must not be remapped.
    own = [argument for argument in arguments if argument.startswith("_")]
    try:
        rospy.init_node(_NAME, argv=[_NAME, *own], anonymous=True, disable_signals=True)
        return judge(_listen(_expand_launch_arguments(arguments), seconds, progress))
    except rospy.ROSInitException as error:
        raise ConfigError(f"{' '.join(own)}: {error}") from error
    finally:
        _clean_up()


def _expand_launch_arguments(arguments: Sequence[str]) -> Sequence[str]:
    """Translate arguments of launch files to the remappings that these make of them."""
    names = {short: INPUTS[role] for role, short in LAUNCH_ARGUMENTS.items()}
    pairs = [argument.partition(":=") for argument in arguments]
    return [f"{names.get(name, name)}:={value}" for name, _, value in pairs]


def _clean_up() -> None:
    """Remove our parameters from the server and our node from the master."""
    import rospy

    with suppress(OSError, rospy.ROSException):  # the master is gone
        if rospy.has_param("~"):
            rospy.delete_param("~")
    rospy.signal_shutdown("checked")


def _resolve_topics(arguments: Sequence[str], names: Mapping[str, str]) -> dict[str, str]:
    """Return the full names of topics, as nodes with these arguments resolve them."""
    import rospy
    from rosgraph.names import load_mappings, resolve_name

    node = rospy.get_name()
    mappings = {
        resolve_name(name, node): resolve_name(topic, node)
        for name, topic in load_mappings(arguments).items()
    }
    return {key: resolve_name(name, node, mappings) for key, name in names.items()}


def _listen(arguments: Sequence[str], seconds: float, progress: "Progress") -> Evidence:
    import rospy

    from fusionslam.ros.check.listener import TF_TOPICS, TopicListener
    from fusionslam.ros.nodes.data_fusion import DataFusion
    from fusionslam.ros.runtime.config import from_parameters

    config = from_parameters(DataFusion.defaults, rospy.get_param("~", {}))
    inputs = {role: INPUTS[role] for role in roles_of(config.fusion.source)}
    asked = _resolve_topics(arguments, inputs | {name: name for name in TF_TOPICS})
    listener = TopicListener(asked, config.node.only_one)
    listener.listen(seconds, progress)
    silent = [topic for topic in listener.roles.values() if topic not in listener.bag.topics]
    nodes = {node for topic in silent for node in listener.graph.publishers.get(topic, ())}
    return Evidence(
        graph=listener.graph,
        choices=listener.choices,
        roles=listener.roles,
        bag=listener.bag,
        config=config,
        seconds=seconds,
        unreachable=silent_nodes(sorted(nodes)),
        clock=not rospy.Time.now().is_zero(),
        arguments=arguments,
    )


def judge(evidence: Evidence) -> Check:
    """Judge the evidence."""
    choices, source = evidence.choices, evidence.config.fusion.source
    remappings = [each.remapping for each in choices.values() if each.is_guess]
    names = {each.partition(":=")[0] for each in remappings}
    others = [each for each in evidence.arguments if each.partition(":=")[0] not in names]
    present = _list_present(evidence)
    # The launch files make clouds of scans.
    files = [name for name, needs in _FILES.items() if needs <= present and source == "lidar"]
    return Check(
        overview=evidence.overview,
        findings=[*list_findings(evidence)],
        again=[*others, *remappings] if remappings else [],
        nodes=[name for name, needs in _NODES.items() if needs <= present],
        files=files,
        lacking=[what for what in _LACKS if what not in present],
        launch=[files[-1], *_launch_arguments(evidence, files[-1])] if files else [],
        works="clouds" in present and not any(choices[r].is_guess for r in needed_roles(source)),
    )


def _list_present(evidence: Evidence) -> set[str]:
    """Return what there is of the needs of nodes and launch files."""
    present = {role for role in _OF_IMAGES if evidence.first(role) is not None}
    if evidence.has_clouds:
        return present | {"clouds", "views"}
    return present | ({"views", "images alone"} if "left" in present else set())


def _launch_arguments(evidence: Evidence, file: str) -> Iterator[str]:
    """Yield the arguments that a launch file needs: topics that differ from its defaults."""
    for role, argument in LAUNCH_ARGUMENTS.items():
        topic = evidence.choices[role].topic
        is_known = file != "visual" or role in _OF_IMAGES
        # Without this argument a launch file uses no ground truth.
        if topic and is_known and (role == "truth" or topic != f"/{INPUTS[role]}"):
            yield f"{argument}:={topic}"
