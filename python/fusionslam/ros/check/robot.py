# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Check that a running robot, or a bag being played, has what the nodes need."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fusionslam.doctor import Finding
from fusionslam.errors import ConfigError
from fusionslam.ros.check import topics
from fusionslam.ros.check.master import CLOCK, Graph, read_graph, silent_nodes
from fusionslam.ros.check.observed_topics import (
    INPUTS,
    LAUNCH_ARGUMENTS,
    Choice,
    ObservedTopic,
    needed_roles,
    roles_of,
)
from fusionslam.ros.check.transforms import cloud_finding, frame_findings
from fusionslam.ros.check.trial_fusion import TrialFusion
from fusionslam.ros.environment import need_ros
from fusionslam.sensors.messages import CameraInfo, Odometry, Picture, Scan

if TYPE_CHECKING:
    from fusionslam.ros.check.listener import Progress

_NAME = "fusionslam_check"
_ON_CLOUDS = ("data_fusion", "lv_builder", "lv_matching", "loop_closure")
_ON_TRUTH = ("lv_analyzer", "lv_dataset_creator")
_OF_IMAGES = ("left", "odometry", "truth")
_NOTHING = "This suffices for none of the nodes"


@dataclass(frozen=True)
class Evidence:
    """The evidence gathered by listening.

    Attributes:
        graph: state of the master.
        choices: chosen topics by role.
        heard: observed topics by role.
        trial: the trial fusion of the messages.
        seconds: how long it waited for messages, and then listened.
        unreachable: publishers that cannot be reached, with their addresses.
        clock: whether ROS time runs.
        arguments: remappings and parameters of the nodes.
    """

    graph: Graph
    choices: Mapping[str, Choice]
    heard: Mapping[str, ObservedTopic]
    trial: TrialFusion
    seconds: float
    unreachable: Mapping[str, str]
    clock: bool
    arguments: Sequence[str] = ()

    def value(self, role: str) -> object:
        """Return the last readable message of a role, or None."""
        return self.heard[role].value if role in self.heard else None


@dataclass(frozen=True)
class Check:
    """The result of checking a robot.

    Attributes:
        findings: one for each aspect checked.
        remappings: remappings that the nodes need to find their topics.
        again: the arguments given, together with these remappings.
        verdict: which nodes can work, in a sentence.
        launch: name and arguments of the launch file that uses most of the robot; empty if none.
        works: whether data_fusion can work as requested.
    """

    findings: Sequence[Finding]
    remappings: Sequence[str]
    again: Sequence[str]
    verdict: str
    launch: Sequence[str]
    works: bool


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
        raise ConfigError(f"{wrong[0]!r} is no remapping, expected NAME:=TOPIC")
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

    from fusionslam.ros.check.listener import TRANSFORMS, TopicListener
    from fusionslam.ros.nodes.data_fusion import DataFusion
    from fusionslam.ros.runtime.config import from_parameters

    trial = TrialFusion(from_parameters(DataFusion.defaults, rospy.get_param("~", {})))
    inputs = {role: INPUTS[role] for role in roles_of(trial.config.fusion.source)}
    listener = TopicListener(
        _resolve_topics(arguments, inputs | {name: name for name in TRANSFORMS}), trial
    )
    listener.listen(seconds, progress)
    silent = [
        listener.choices[role].topic for role, heard in listener.heard.items() if not heard.count
    ]
    nodes = {node for topic in silent for node in listener.graph.publishers.get(topic, ())}
    clock = not rospy.Time.now().is_zero()
    unreachable = silent_nodes(sorted(nodes))
    return Evidence(
        listener.graph,
        listener.choices,
        listener.heard,
        trial,
        seconds,
        unreachable,
        clock,
        arguments,
    )


def judge(evidence: Evidence) -> Check:
    """Judge the evidence."""
    config = evidence.trial.config
    needed = needed_roles(config.fusion.source)
    findings = [*_clock_findings(evidence)]
    for role in evidence.choices:
        findings += _sensor_findings(evidence, role, role in needed)
    findings += _joint_findings(evidence)
    findings += frame_findings(evidence.trial, *_sensor_frames(evidence))
    findings.append(cloud_finding(evidence.trial, _describe_missing(evidence, needed)))
    remappings = [each.remapping for each in evidence.choices.values() if each.is_guess]
    found = all(not evidence.choices[role].is_guess for role in needed)
    works = found and evidence.trial.first is not None
    files = _launch_files(evidence)
    verdict = _verdict(evidence, files, bool(remappings))
    # The last launch file does most.
    launch = [files[-1], *_launch_arguments(evidence, files[-1])] if files else []
    again = _merge_remappings(evidence.arguments, remappings) if remappings else []
    return Check(findings, remappings, again, verdict, launch, works)


def _merge_remappings(arguments: Sequence[str], remappings: Sequence[str]) -> Sequence[str]:
    """Return the arguments with these remappings in place of older ones."""
    names = {each.partition(":=")[0] for each in remappings}
    return [*(each for each in arguments if each.partition(":=")[0] not in names), *remappings]


def _clock_findings(evidence: Evidence) -> Iterator[Finding]:
    graph = evidence.graph
    has_clock = CLOCK in graph.topics
    time = "sim time" if graph.sim_time else "wall time"
    yield Finding("master", True, f"{graph.uri}, {len(graph.topics)} topics, {time}")
    if graph.sim_time and not evidence.clock:
        detail = (
            f"use_sim_time is set, but {CLOCK} {'stands at 0' if has_clock else 'is missing'}: "
            "start the simulator or rosbag play --clock; on a real robot rosparam set "
            "use_sim_time false, and start all nodes anew"
        )
        yield Finding("clock", False, detail)
    if found := topics.clock_finding(evidence.heard, graph.sim_time):
        yield found


def _sensor_findings(evidence: Evidence, role: str, needed: bool) -> Iterator[Finding]:
    graph, choice, heard = evidence.graph, evidence.choices[role], evidence.heard.get(role)
    yield topics.topic_finding(choice, graph.topics, graph.publishers, needed)
    if heard is None:
        return
    if not heard.count:
        yield topics.silence_finding(choice, evidence.seconds, evidence.unreachable, needed)
        return
    config = evidence.trial.config
    by_arrival = config.node.stamps == "arrival"
    yield topics.rate_finding(role, heard, by_arrival, config.online.sync.jump)
    if heard.unreadable:
        yield topics.unreadable_finding(role, heard)
    yield from _content_findings(evidence, role, heard)


def _content_findings(evidence: Evidence, role: str, heard: ObservedTopic) -> Iterator[Finding]:
    value = heard.value
    if isinstance(value, Scan):
        yield topics.scan_finding(value)
    elif isinstance(value, Picture):
        yield topics.image_finding(role, value, heard.type)
    elif isinstance(value, CameraInfo):
        picture = evidence.value("right" if role.startswith("right") else "left")
        seen = picture if isinstance(picture, Picture) else None
        yield topics.info_finding(role, value, seen, heard.topic)
    elif isinstance(value, Odometry):
        yield topics.odometry_finding(role, value, evidence.trial.config.online)


def _joint_findings(evidence: Evidence) -> Iterator[Finding]:
    """Check that the data of several sensors fit together."""
    heard, config = evidence.heard, evidence.trial.config
    by_arrival, sync = config.node.stamps == "arrival", config.online.sync
    if {"points", "left"} <= heard.keys():
        yield from topics.sync_findings(
            heard["points"],
            heard["left"],
            sync.max_difference,
            by_arrival,
            "scans have an image",
        )
    if {"left", "right"} <= heard.keys():
        yield from topics.sync_findings(
            heard["left"],
            heard["right"],
            sync.stereo_difference,
            by_arrival,
            "left images have a right one",
        )
    if {"points", "odometry"} <= heard.keys() and not by_arrival:
        found = topics.motion_finding(heard["points"], heard["odometry"])
        yield from [found] if found else []
    left, right = evidence.value("camera_info"), evidence.value("right_camera_info")
    if isinstance(left, CameraInfo) and isinstance(right, CameraInfo):
        names = {"left": heard["camera_info"].topic, "right": heard["right_camera_info"].topic}
        yield topics.pair_finding(left, right, names)


def _sensor_frames(evidence: Evidence) -> tuple[str, str]:
    """Return the frames of scanner and camera, as far as known."""
    scan, info, picture = (evidence.value(role) for role in ("points", "camera_info", "left"))
    frames = [each.frame_id for each in (info, picture) if isinstance(each, CameraInfo | Picture)]
    camera = next((frame for frame in frames if frame), "")
    return (scan.frame_id if isinstance(scan, Scan) else ""), camera


def _describe_missing(evidence: Evidence, needed: Sequence[str]) -> str:
    lacking = [topics.WORDS[role] for role in needed if evidence.value(role) is None]
    return f"no {' and no '.join(lacking)}" if lacking else ""


def _launch_files(evidence: Evidence) -> Sequence[str]:
    """Return the launch files that the robot has the data for; they need the source "lidar"."""
    if evidence.trial.config.fusion.source != "lidar":
        return []
    clouds, odometry = evidence.trial.first is not None, evidence.value("odometry") is not None
    files = ["visual"] if odometry and evidence.value("left") is not None else []
    files += ["loops", "first_stage", "two_stages"] if clouds else []
    return [*files, "ratslam"] if clouds and odometry else files


def _launch_arguments(evidence: Evidence, file: str) -> Iterator[str]:
    """Yield the arguments that a launch file needs: topics that differ from its defaults."""
    for role, argument in LAUNCH_ARGUMENTS.items():
        topic = evidence.choices[role].topic
        is_known = file != "visual" or role in _OF_IMAGES
        # Without this argument a launch file uses no ground truth.
        if topic and is_known and (role == "truth" or topic != f"/{INPUTS[role]}"):
            yield f"{argument}:={topic}"


def _verdict(evidence: Evidence, files: Sequence[str], remapped: bool) -> str:
    """Say which nodes and launch files can work with the robot, and what the others lack."""
    clouds = evidence.trial.first is not None
    images, odometry, truth = (
        evidence.value(role) is not None for role in ("left", "odometry", "truth")
    )
    nodes = [*(_ON_CLOUDS if clouds else ()), *(_ON_TRUTH if clouds and truth else ())]
    nodes += ["ratslam"] if odometry and (clouds or images) else []
    nodes += [] if clouds or not images else ["lv_matching with _source:=visual_templates"]
    lacks = [] if clouds else ["there are no coloured clouds"]
    lacks += [] if odometry else ["ratslam lacks odometry"]
    lacks += [] if truth or not clouds else [f"{_join_names(_ON_TRUTH)} lack true poses"]
    start = "With these remappings, this" if remapped else "This"
    launch = f" (launch files {_join_names(files)})" if files else ""
    suffices = f"{start} suffices for {_join_names(nodes)}{launch}" if nodes else _NOTHING
    return "; ".join([suffices, *lacks]) + "."


def _join_names(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
