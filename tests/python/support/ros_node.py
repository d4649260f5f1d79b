# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A node without a master: messages reach it as bytes, as they do over a line."""

from io import BytesIO
from typing import Any

import numpy as np
import pytest

from fusionslam.ros.nodes import node_class
from fusionslam.ros.ros1.environment import need_ros
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.ros.runtime.worker import Worker

SOMEBODY = "/somebody"
CLOUDS, VIEWS, IDS = "rgb_cloud", "current_scene_description", "LocalView/Template"


class Kept:
    """An outlet that keeps what is published."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, Any]] = []
        self.wanted: set[str] = set()

    def publish(self, topic: str, message: Any) -> None:
        self.messages.append((topic, message))

    def is_wanted(self, topic: str) -> bool:
        return topic in self.wanted

    def of(self, topic: str) -> list[Any]:
        return [message for name, message in self.messages if name == topic]


class Desk:
    """A node, what it published, and a clock that tests set."""

    def __init__(self, name: str, **parameters: Any) -> None:
        need_ros()
        self.outlet, self.now_ns, self.gone = Kept(), 0, set[str]()
        if name == "lv_matching":  # else views wait for odometry
            parameters.setdefault("odometry", False)
        kind = node_class(name)
        self.node = kind(from_parameters(kind.defaults, parameters), self.outlet)
        self.worker = Worker(
            self.node,
            lambda topic: "/" + topic.lstrip("/"),
            lambda: self.now_ns,
            lambda topic, publisher: publisher not in self.gone,
        )

    def put(self, topic: str, message: Any, lost: int = 0, **header: Any) -> None:
        """A message arrives, but for its last bytes, and waits; ``header`` is of its publisher."""
        from rospy import AnyMsg

        from fusionslam.ros.ros1.messages import delivery_of

        line, stream = AnyMsg(), BytesIO()
        message.serialize(stream)
        line._buff = stream.getvalue()[: stream.tell() - lost]
        line._connection_header = {
            "type": message._type,
            "md5sum": message._md5sum,
            "callerid": SOMEBODY,
            **header,
        }
        self.worker.enqueue(delivery_of(line), topic)

    def give(self, topic: str, *values: Any, **header: Any) -> None:
        """Messages, or values of ``fusionslam.sensors.messages``, arrive and are worked off."""
        from fusionslam.ros.messages.library import build

        for value in values:
            message = value if hasattr(value, "_md5sum") else build(value)
            self.put(topic, message, **header)
        self.work()

    def work(self) -> None:
        """Work off all that waits."""
        while self.worker.work(0.0):
            pass

    def problems(self) -> dict[str, int]:
        """Counts by "topic: cause"."""
        counts = self.worker.problems.counts
        return {f"{topic}: {cause}": count for (topic, cause), count in counts.items()}


class Chain:
    """Nodes, each of which hears what the others publish."""

    def __init__(self, *desks: Desk) -> None:
        self.desks = desks
        self._passed = [0] * len(desks)

    def give(self, topic: str, *values: Any) -> None:
        """Messages arrive, and all that they lead to is worked off."""
        for desk in self.desks:
            if topic in desk.worker.inputs:
                desk.give(topic, *values)
        for number, desk in enumerate(self.desks):
            first, self._passed[number] = self._passed[number], len(desk.outlet.messages)
            for name, message in desk.outlet.messages[first:]:
                self.give(name, message)

    def fall_silent(self) -> None:
        """All nodes notice that nothing comes any more, the last one of the chain first."""
        for desk in reversed(self.desks):
            desk.worker.idle()
            self.give("")

    def of(self, topic: str) -> list[Any]:
        """What the nodes published on a topic."""
        return [message for desk in self.desks for message in desk.outlet.of(topic)]


def ids(matcher: Desk) -> list[int]:
    """The views that lv_matching recognised."""
    return [message.current_id for message in matcher.outlet.of(IDS)]


def causes(caplog: pytest.LogCaptureFixture) -> list[str]:
    """Codes of the problems that were logged, in order."""
    return [record.cause[0] for record in caplog.records if hasattr(record, "cause")]


def colored_cloud(count: int = 600, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Points of two boxes before the robot, one red and one blue."""
    rng = np.random.default_rng(seed)
    corners = np.repeat([[3.0, -1.0, 0.3], [4.0, 1.5, 0.3]], count // 2, axis=0)
    points = (corners + rng.uniform(0, 0.8, (len(corners), 3))).astype(np.float32)
    colors = np.repeat([[200, 30, 20], [10, 40, 220]], count // 2, axis=0).astype(np.uint8)
    return points, colors
