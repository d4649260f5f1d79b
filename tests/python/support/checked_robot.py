# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot's messages are to ``fusionslam ros check``, without a ROS."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from fusionslam.datasets.bags.messages import plain_type, ros_type
from fusionslam.datasets.bags.reader import Topic
from fusionslam.ros.check.master import Graph
from fusionslam.ros.check.observed_topics import Heard, choose, roles_of
from fusionslam.ros.check.robot import Check, Evidence, judge
from fusionslam.ros.check.trial_fusion import Trial
from fusionslam.ros.nodes.data_fusion import DataFusionConfig
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.sensors.messages import Event, FrameTransforms

TOPICS = {
    "points": "/points",
    "left": "/camera/image",
    "camera_info": "/camera/camera_info",
    "right": "/camera/right",
    "right_camera_info": "/camera/right_info",
    "odometry": "/odom",
    "truth": "/truth",
}
"""Those of ``bag_maker.drive``."""


def checked(
    events: Iterable[Event],
    *,
    asked: Mapping[str, str] = TOPICS,
    parameters: Mapping[str, Any] | None = None,
    publishers: Mapping[str, Sequence[str]] | None = None,
    also: Mapping[str, str] | None = None,
    unreachable: Mapping[str, str] | None = None,
    sim_time: bool = False,
    clock: bool = True,
) -> Check:
    """What is said of these messages; ``also`` has types of topics that are silent."""
    events = list(events)
    types = {e.topic: plain_type(ros_type(e.message, "raw")) for e in events} | {**(also or {})}
    nodes = {topic: ["/driver"] for topic in types} | {**(publishers or {})}
    graph = Graph(
        "http://robot:11311",
        {name: Topic(name, kind, 1) for name, kind in types.items()},
        nodes,
        sim_time,
    )
    trial = Trial(from_parameters(DataFusionConfig(), parameters or {}))
    roles = roles_of(trial.config.fusion.source)
    choices = choose(graph.topics, nodes, {role: asked[role] for role in roles})
    heard = {
        role: Heard(choice.topic, types[choice.topic])
        for role, choice in choices.items()
        if choice.topic
    }
    for event in events:
        _arrive(event, heard, trial)
    trial.end()
    return judge(Evidence(graph, choices, heard, trial, 5.0, unreachable or {}, clock))


def _arrive(event: Event, heard: Mapping[str, Heard], trial: Trial) -> None:
    if isinstance(event.message, FrameTransforms):
        trial.take(event.topic, event.message, event.time_ns)
        return
    for role, each in heard.items():
        if each.topic == event.topic:
            each.value = event.message
            each.series.headers.append(event.message.stamp_ns)
            each.series.times.append(event.time_ns)
            each.series.frame_id = event.message.frame_id
            trial.take(role, event.message, event.time_ns)


def said(check: Check, what: str) -> str:
    """All that is said of one thing, each with how bad it is."""
    words = {True: "ok", False: "fault"}
    found = [each for each in check.findings if each.what == what]
    assert found, [each.what for each in check.findings]
    return "; ".join(
        f"{words[each.fine] if each.fine or not each.optional else 'note'}: {each.detail}"
        for each in found
    )


def faults(check: Check) -> list[str]:
    """What is a fault."""
    return [each.what for each in check.findings if not each.fine and not each.optional]
