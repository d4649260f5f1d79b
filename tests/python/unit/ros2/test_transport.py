# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a node of ROS 2 subscribes to, with a stand-in for rclpy, which needs another Python."""

import enum
import logging
import sys
from collections.abc import Iterator
from importlib import import_module
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, patch

import pytest

from fusionslam.ros.runtime.node import Delivery, Input
from rows import rows

CLOUD = "sensor_msgs/msg/PointCloud2"
OURS = tuple(f"fusionslam.ros.ros2.{name}" for name in ("messages", "parameters", "transport"))
THEIRS = tuple(
    f"rclpy.{name}"
    for name in ("executors", "node", "parameter", "publisher", "qos", "serialization")
)


class ReliabilityPolicy(enum.Enum):
    RELIABLE = 1
    BEST_EFFORT = 2


class DurabilityPolicy(enum.Enum):
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


@pytest.fixture(scope="module")
def transport() -> Iterator[Any]:
    """The module, of a stand-in for rclpy."""
    others = ("rcl_interfaces", "rcl_interfaces.msg", "builtin_interfaces.msg")
    names = ("rclpy", *THEIRS, "rclpy.subscription", "builtin_interfaces", *others)
    modules: dict[str, Any] = {name: MagicMock() for name in names}
    modules["rclpy.qos"] = SimpleNamespace(
        QoSProfile=SimpleNamespace,
        ReliabilityPolicy=ReliabilityPolicy,
        DurabilityPolicy=DurabilityPolicy,
    )
    modules["rclpy.serialization"].serialize_message = str.encode
    with patch.dict(sys.modules, modules):
        found: Any = import_module(OURS[-1])
        with (
            patch.object(found, "own_type", lambda name: name.replace("/msg/", "/")),
            patch.object(found, "message_class", str),
            patch.object(found, "deserialize", lambda data, name: data.decode()),
        ):
            yield found
        for name in OURS:
            sys.modules.pop(name, None)


class Robot:
    """A node, the publishers of its topic, and what it subscribed to and was given."""

    def __init__(self, transport: Any) -> None:
        self.publishers: list[Any] = []
        self.subscriptions: list[Any] = []
        self.taken: list[Delivery] = []
        self.own = transport._OwnMessages()
        entry = Input("points", ["sensor_msgs/PointCloud2"], lambda message: None)
        self.source: Any = transport._Source(self, entry, self.taken.append, 5, self.own)

    def offer(self, name: str, reliable: bool = True, kept: bool = False, kind: str = CLOUD) -> Any:
        quality = SimpleNamespace(
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
        )
        self.publishers.append(
            SimpleNamespace(
                node_name=name, node_namespace="/", topic_type=kind, qos_profile=quality
            )
        )

    def look(self) -> list[tuple[bool, bool]]:
        """Whether each subscription so far asks for reliable, and for kept messages."""
        self.source.update()
        return [
            (
                each.reliability is ReliabilityPolicy.RELIABLE,
                each.durability is DurabilityPolicy.TRANSIENT_LOCAL,
            )
            for *_, each in self.subscriptions
        ]

    def resolve_topic_name(self, name: str) -> str:
        return f"/{name}"

    def get_fully_qualified_name(self) -> str:
        return "/node"

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        return self.publishers

    def create_subscription(self, *given: Any, raw: bool) -> Any:
        self.subscriptions.append(given)
        return given

    def destroy_subscription(self, subscription: Any) -> None:
        assert subscription is self.subscriptions[-1]


@rows(
    "offers, asked",
    [
        ([("one", True, True)], (True, True)),
        ([("one", False, True)], (False, True)),
        ([("one", True, False), ("two", True, True)], (True, False)),
        ([("one", True), ("two", False)], (False, False)),
        ([("one", True), ("node", False)], (True, False)),  # "node" is its own
    ],
)
def test_a_node_asks_for_what_all_others_offer(
    offers: list[tuple[Any, ...]], asked: tuple[bool, bool], transport: Any
) -> None:
    robot = Robot(transport)
    assert not robot.look()
    for offer in offers:
        robot.offer(*offer)
    assert robot.look() == [asked] == robot.look()


def test_a_node_asks_for_less_when_a_publisher_offers_less(transport: Any) -> None:
    robot = Robot(transport)
    for reliable, asked in ((True, [True]), (False, [True, False]), (True, [True, False])):
        robot.publishers.clear()
        robot.offer("driver", reliable)
        assert [each for each, _ in robot.look()] == asked
    assert transport.sender_of(robot.publishers[0]) == "/driver"


def test_several_publishers_and_those_of_another_type_are_named(
    transport: Any, caplog: pytest.LogCaptureFixture
) -> None:
    robot = Robot(transport)
    for name in ("wrong", "wrong"):
        robot.offer(name, kind="std_msgs/msg/String")
        assert not robot.look()
    assert [(each.type, each.sender) for each in robot.taken] == [("std_msgs/String", "/wrong")]
    robot.offer("one")
    robot.offer("two")
    robot.look()
    (warning,) = (each for each in caplog.records if each.levelno == logging.WARNING)
    assert "/one and /two" in warning.getMessage()


def test_a_publisher_whose_node_stays_unknown_is_taken_after_a_while(transport: Any) -> None:
    robot = Robot(transport)
    robot.offer("_NODE_NAME_UNKNOWN_")
    looks = 0
    while not robot.look():
        looks += 1
    assert looks == transport._LOOKS


def test_what_a_node_publishes_itself_is_no_news(transport: Any) -> None:
    robot = Robot(transport)
    robot.own.keep(2)
    robot.offer("other")
    robot.look()
    _, _, receive, _ = robot.subscriptions[0]
    for message in ("a", "b", "c"):
        robot.own.note(message)
    for data in (b"a", b"b", b"d"):
        receive(data)
    assert [each.read() for each in robot.taken] == ["a", "d"]
    assert not robot.taken[0].is_of_sender and robot.taken[0].sender == "/other"
