# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Check that a running robot, or a bag being played, has what the nodes need."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from fusionslam.doctor import Finding
from fusionslam.pipelines.overview import Overview
from fusionslam.ros.check.evidence import Evidence
from fusionslam.ros.check.findings import list_findings
from fusionslam.ros.check.graph import Robot
from fusionslam.ros.check.listener import Progress, TopicListener
from fusionslam.ros.nodes.data_fusion import DataFusion
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.ros.topic_choice import INPUTS, LAUNCH_ARGUMENTS, needed_roles, roles_of

Connect = Callable[[Sequence[str]], AbstractContextManager[Robot]]
"""Makes a node that listens, from the arguments of a command line."""

_NODES = {
    "data_fusion": {"clouds"},
    "lv_builder": {"clouds"},
    "lv_matching": {"clouds"},
    "loop_closure": {"clouds"},
    "lv_analyzer": {"clouds", "truth"},
    "lv_dataset_creator": {"clouds", "truth"},
    "mapper": {"clouds", "odometry"},
    "ratslam": {"views", "odometry"},
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
        launch: the command for the launch file that uses most of the robot; empty if none.
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


def check_robot(
    connect: Connect,
    arguments: Sequence[str],
    seconds: float,
    progress: Progress,
) -> Check:
    """Listen to a robot and judge it.

    Args:
        connect: that of ROS 1 or ROS 2, called with the arguments.
        arguments: of the command line.
        seconds: how long to wait for a sensor, and then to listen.
        progress: called with the name of the step, seconds done and total seconds.

    Raises:
        FusionSlamError: as ``connect``.
        ConfigError: as ``connect``, or a parameter that data_fusion does not know.
    """
    with connect(arguments) as robot:
        evidence = _listen(robot, seconds, progress)
    return judge(evidence)


def _listen(robot: Robot, seconds: float, progress: Progress) -> Evidence:
    config = from_parameters(DataFusion.defaults, robot.parameters)
    listener = TopicListener(robot, roles_of(config.fusion.source), config.node.only_one)
    listener.listen(seconds, progress)
    silent = [topic for topic in listener.roles.values() if topic not in listener.bag.topics]
    nodes = {node for topic in silent for node in listener.graph.publishers.get(topic, ())}
    return Evidence(
        advice=robot.advice,
        graph=listener.graph,
        choices=listener.choices,
        roles=listener.roles,
        bag=listener.bag,
        config=config,
        seconds=seconds,
        unreachable=robot.silent_nodes(sorted(nodes)),
        clock=robot.transport.now_ns() != 0,
        remappings=robot.remappings,
        options=robot.options,
    )


def judge(evidence: Evidence) -> Check:
    """Judge the evidence."""
    choices, source = evidence.choices, evidence.config.fusion.source
    guessed = [each.remapping for each in choices.values() if each.is_guess]
    names = {each.partition(":=")[0] for each in guessed}
    given = [each for each in evidence.remappings if each.partition(":=")[0] not in names]
    present = {role for role in _OF_IMAGES if evidence.first(role) is not None}
    present |= {"clouds", "views"} if evidence.has_clouds else set()
    present |= {"views"} if "left" in present else set()
    nodes = [name for name, needs in _NODES.items() if needs <= present]
    if "left" in present and "clouds" not in present:
        source_parameter = evidence.advice.parameter("source", "visual_templates")
        nodes.append(f"lv_matching with {source_parameter}")
    # The launch files make clouds of scans.
    files = [name for name, needs in _FILES.items() if needs <= present and source == "lidar"]
    start = evidence.advice.launch(files[-1]) if files else []
    return Check(
        overview=evidence.overview,
        findings=[*list_findings(evidence)],
        again=[*evidence.options, *given, *guessed] if guessed else [],
        nodes=nodes,
        files=files,
        lacking=[what for what in _LACKS if what not in present],
        launch=[*start, *_launch_arguments(evidence, files[-1])] if files else [],
        works="clouds" in present and not any(choices[r].is_guess for r in needed_roles(source)),
    )


def _launch_arguments(evidence: Evidence, file: str) -> Iterator[str]:
    """Yield the arguments that a launch file needs: topics that differ from its defaults."""
    for role, argument in LAUNCH_ARGUMENTS.items():
        choice = evidence.choices.get(role)
        topic = choice.topic if choice is not None else None
        is_known = file != "visual" or role in _OF_IMAGES
        # Without this argument a launch file uses no ground truth.
        if topic and is_known and (role == "truth" or topic != f"/{INPUTS[role]}"):
            yield f"{argument}:={topic}"
