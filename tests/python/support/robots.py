# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Robots as ROS shows them: topics, transforms, and drives in bags."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from bags import SECOND, drive
from fusionslam.datasets.bags.messages import plain_type, ros_type
from fusionslam.datasets.bags.reader import Topic
from fusionslam.ros.check.master import Graph
from fusionslam.ros.check.observed_topics import ObservedTopic, choose, roles_of
from fusionslam.ros.check.robot import Check, Evidence, judge
from fusionslam.ros.check.trial_fusion import TrialFusion
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
"""The topics of ``bags.drive``."""


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
    trial = TrialFusion(from_parameters(DataFusionConfig(), parameters or {}))
    roles = roles_of(trial.config.fusion.source)
    choices = choose(graph.topics, nodes, {role: asked[role] for role in roles})
    heard = {
        role: ObservedTopic(choice.topic, types[choice.topic])
        for role, choice in choices.items()
        if choice.topic
    }
    for event in events:
        _arrive(event, heard, trial)
    trial.end()
    return judge(Evidence(graph, choices, heard, trial, 5.0, unreachable or {}, clock))


def _arrive(event: Event, heard: Mapping[str, ObservedTopic], trial: TrialFusion) -> None:
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


NODE_TOPICS = {
    "/tf_static": "/tf_static",
    "/odom": "odom",
    "/points": "velodyne_points",
    "/camera/image": "camera/rgb/image_raw",
    "/camera/camera_info": "camera/rgb/camera_info",
}
SCANS, IMAGES = NODE_TOPICS["/points"], NODE_TOPICS["/camera/image"]
INFOS = NODE_TOPICS["/camera/camera_info"]
Sent = list[tuple[str, Any]]
"""Topics and values of ``fusionslam.sensors.messages``, or ROS messages, in order."""


def sent(seconds: float = 4.0, later: float = 0.0) -> Sent:
    """A drive, ``later`` seconds after the usual one: a scan each half second."""
    return [(NODE_TOPICS[e.topic], moved(e.message, round(later * SECOND))) for e in drive(seconds)]


def moved(value: Any, by_ns: int) -> Any:
    """A value, that much later."""
    if isinstance(value, FrameTransforms):
        return value
    return dataclasses.replace(value, stamp_ns=value.stamp_ns + by_ns)


def spoiled(messages: Sent, topic: str, how: Callable[[Any], Any]) -> Sent:
    """All messages of a topic changed."""
    return [(name, how(value) if name == topic else value) for name, value in messages]


def replaced(messages: Sent, topic: str, **changes: Any) -> Sent:
    """All messages of a topic with other values."""
    return spoiled(messages, topic, lambda value: dataclasses.replace(value, **changes))


def without(messages: Sent, *topics: str) -> Sent:
    """As if nobody published them."""
    return [(name, value) for name, value in messages if name not in topics]


def only(messages: Iterable[tuple[str, Any]], topic: str) -> list[Any]:
    """The values of one topic."""
    return [value for name, value in messages if name == topic]
