# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Robots as ROS shows them: topics, transforms, and drives in bags."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from bags import SECOND, drive, write_bag
from fusionslam.datasets.bags import Topic, open_bag
from fusionslam.doctor import Finding
from fusionslam.ros.check.evidence import Evidence
from fusionslam.ros.check.graph import ROS1, Advice, Graph
from fusionslam.ros.check.robot import Check, judge
from fusionslam.ros.nodes.data_fusion import DataFusionConfig
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.ros.topic_choice import choose, roles_of
from fusionslam.sensors.messages import Event, FrameTransforms

TOPICS = {
    "points": "/points",
    "left": "/camera/image",
    "camera_info": "/camera/camera_info",
    "right": "/camera/right",
    "right_camera_info": "/camera/right_info",
    "odometry": "/odom",
    "truth": "/truth",
    "imu": "/imu",
}
"""The topics of ``bags.drive``."""


def check_events(
    events: Iterable[Event],
    *,
    asked: Mapping[str, str] = TOPICS,
    parameters: Mapping[str, Any] | None = None,
    publishers: Mapping[str, Sequence[str]] | None = None,
    also: Mapping[str, str] | None = None,
    unreachable: Mapping[str, str] | None = None,
    sim_time: bool = False,
    clock: bool = True,
    advice: Advice = ROS1,
    reliable: Mapping[str, bool] | None = None,
    foreign: Mapping[str, Sequence[str]] | None = None,
) -> Check:
    """What ``ros check`` finds in a bag of events; ``also`` has types of topics that are silent."""
    events = sorted(events, key=lambda event: event.time_ns)
    config = from_parameters(DataFusionConfig(), parameters or {})
    with TemporaryDirectory() as folder, open_bag(write_bag(Path(folder, "b.bag"), events)) as bag:
        silent = {name: Topic(name, kind, 1) for name, kind in (also or {}).items()}
        graph_topics = {**bag.topics, **silent}
        nodes = {topic: ["/driver"] for topic in graph_topics} | {**(publishers or {})}
        wanted = {role: asked[role] for role in roles_of(config.fusion.source)}
        choices = choose(graph_topics, nodes, wanted)
        return judge(
            Evidence(
                advice=advice,
                graph=Graph(
                    *("http://robot:11311", graph_topics, nodes, sim_time),
                    *(reliable or {}, foreign or {}),
                ),
                choices=choices,
                roles={role: each.topic for role, each in choices.items() if each.topic},
                bag=bag,
                config=config,
                seconds=5.0,
                unreachable=unreachable or {},
                clock=clock,
            )
        )


def problems(check: Check) -> dict[str, str]:
    """Code of each problem by what was checked."""
    return {each.what: each.code for each in check.findings if not each.fine}


def faults(check: Check) -> set[str]:
    """What has a problem that matters to data_fusion."""
    return {each.what for each in check.findings if not each.fine and not each.optional}


def finding(check: Check, what: str) -> Finding:
    """The finding about one thing."""
    found = [each for each in check.findings if each.what == what]
    assert len(found) == 1, [(each.what, each.code) for each in check.findings]
    return found[0]


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


def drive_messages(seconds: float = 4.0, later: float = 0.0) -> Sent:
    """A drive, ``later`` seconds after the usual one: a scan each half second."""
    return [(NODE_TOPICS[e.topic], shift(e.message, round(later * SECOND))) for e in drive(seconds)]


def shift(value: Any, by_ns: int) -> Any:
    """A value, that much later."""
    if isinstance(value, FrameTransforms):
        return value
    return dataclasses.replace(value, stamp_ns=value.stamp_ns + by_ns)


def spoil(messages: Sent, topic: str, how: Callable[[Any], Any]) -> Sent:
    """All messages of a topic changed."""
    return [(name, how(value) if name == topic else value) for name, value in messages]


def replace_values(messages: Sent, topic: str, **changes: Any) -> Sent:
    """All messages of a topic with other values."""
    return spoil(messages, topic, lambda value: dataclasses.replace(value, **changes))


def without(messages: Sent, *topics: str) -> Sent:
    """As if nobody published them."""
    return [(name, value) for name, value in messages if name not in topics]


def only(messages: Iterable[tuple[str, Any]], topic: str) -> list[Any]:
    """The values of one topic."""
    return [value for name, value in messages if name == topic]
