# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Play bags of ROS 1 and ROS 2 in ROS 2."""

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusionslam.datasets.bags import open_bag
from fusionslam.datasets.bags.messages import is_static
from fusionslam.datasets.bags.reader import Bag, RawMessage
from fusionslam.errors import DataError
from fusionslam.ros.messages.types import DIAGNOSTICS
from fusionslam.ros.nodes import NODES
from fusionslam.ros.ros2.environment import need_ros2
from fusionslam.ros.ros2.start import ros2_node
from fusionslam.ros.runtime.diagnostics import REPORTS, NodeReports
from fusionslam.sensors.messages import NANOSECONDS

logger = logging.getLogger(__name__)

_CLOCK_S = 0.01
_POLL_S = 0.1
_QUEUE = 1000
_CLOSING_S = 60.0
_PATIENCE_S = 60.0
"""For nodes of ours that have not subscribed; a topic may be of a type that they do not take."""


@dataclass(frozen=True)
class Playing:
    """How a bag is played.

    Attributes:
        topics: those to play; None for all whose types are known.
        rate: speed, relative to the recording.
        start, stop: seconds since the bag's beginning; None for its end.
        clock: whether the time of the recording is published on /clock.
        wait: whether subscriptions are waited for before the first message, those of all nodes of
            fusionslam among them; once there is one, it begins this many seconds after the last
            one came. 0 waits for none.
        arguments: for ROS, as ``--ros-args -r /points:=/velodyne_points``.
        until_idle: whether it ends only once all nodes of fusionslam have processed everything.
    """

    topics: Sequence[str] | None = None
    rate: float = 1.0
    start: float = 0.0
    stop: float | None = None
    clock: bool = True
    wait: float = 2.0
    arguments: Sequence[str] = ()
    until_idle: bool = False


def play_bag(path: Path, how: Playing, progress: Callable[[str, int, int], None]) -> int:
    """Play a bag until its end or an interrupt, and wait until all messages are received.

    Args:
        path: a bag of ROS 1 or ROS 2, or an MCAP file.
        how: how it is played.
        progress: called with what is done, how much of it, and of how much.

    Returns:
        The number of messages that were sent.

    Raises:
        FusionSlamError: ROS 2 is not installed.
        DataError: the bag cannot be read, lacks a topic, or has no message in that part.
    """
    need_ros2()
    is_ending = threading.Event()
    with open_bag(path) as bag, ros2_node("bag_player", how.arguments, is_ending) as node:
        return _Player(bag, node, how, is_ending).play(progress)


class _Player:
    def __init__(self, bag: Bag, node: Any, how: Playing, is_ending: threading.Event) -> None:
        self._bag, self._node, self._how, self._is_ending = bag, node, how, is_ending
        self._topics = bag.known_topics(how.topics)
        others = sorted(set(bag.topics) - set(self._topics))
        if others and how.topics is None:
            logger.warning("not played, as their types are not known: %s", ", ".join(others))
        if not self._topics:
            raise DataError(f"{bag.path} has no topic of a known type", code="no-topic")
        self._publishers = {name: self._publisher(name) for name in self._topics}
        self._clock = None
        if how.clock:
            from rosgraph_msgs.msg import Clock

            self._clock = node.create_publisher(Clock, "/clock", 10)

    def play(self, progress: Callable[[str, int, int], None]) -> int:
        self._wait_for_subscribers(progress)
        count, (first, last) = 0, self._span_ns()
        for raw, message in self._in_time():
            self._publishers[raw.topic].publish(message)
            count += 1
            done, total = (raw.time_ns - first) // NANOSECONDS, max(last - first, 0) // NANOSECONDS
            progress("playing", done, total + 1)  # whole seconds of the bag
        if not count and not self._is_ending.is_set():
            raise DataError(
                f"{self._bag.path}: none of the topics has a message from {self._how.start:g} s on"
                f"{'' if self._how.stop is None else f' until {self._how.stop:g} s'}",
                code="no-message",
            )
        self._wait_for_receipt()
        if self._how.until_idle:
            with self._taking_reports() as reports:
                while not self._is_ending.is_set() and not reports.are_quiet(self._nodes()):
                    progress("waiting for nodes", 0, 1)
                    self._spin()
        return count

    def _in_time(self) -> Iterator[tuple[RawMessage, Any]]:
        """Yield messages when they are due, with the clock running meanwhile."""
        from fusionslam.ros.ros2.messages import convert

        began, first, last = time.monotonic(), *self._span_ns()
        for raw in self._bag.raw(self._topics, start=first, stop=last, on_error=_skip):
            message = convert(raw.content, raw.type)
            due = began + (raw.time_ns - first) / NANOSECONDS / self._how.rate
            while (left := due - time.monotonic()) > 0 and not self._is_ending.is_set():
                self._send_clock(raw.time_ns - round(left * self._how.rate * NANOSECONDS))
                time.sleep(min(left, _CLOCK_S))
            if self._is_ending.is_set():
                return
            self._send_clock(raw.time_ns)
            yield raw, message

    def _span_ns(self) -> tuple[int, int]:
        """Arrival of the first message that is played, and of the first that is not any more."""
        how, begin = self._how, self._bag.start_ns
        end = self._bag.stop_ns + 1
        stop = end if how.stop is None else min(begin + round(how.stop * NANOSECONDS), end)
        return begin + round(how.start * NANOSECONDS), stop

    def _wait_for_subscribers(self, progress: Callable[[str, int, int], None]) -> None:
        """Wait until the set of subscriptions has been the same for a while."""
        found, since, wait = -1, time.monotonic(), self._how.wait
        with self._taking_reports() as reports:
            while wait and not self._is_ending.is_set():
                count = sum(each.get_subscription_count() for each in self._publishers.values())
                waited = time.monotonic() - since
                if count != found:
                    found, since = count, time.monotonic()
                elif count and waited > wait and self._are_heard(reports):
                    return
                elif count and waited > wait + _PATIENCE_S:
                    logger.warning(
                        "some nodes of fusionslam have not subscribed to what they take, or do not "
                        "reach who subscribed to what they publish"
                    )
                    return
                progress("waiting for subscribers", min(count, 1), 1)
                self._spin()

    def _are_heard(self, reports: NodeReports) -> bool:
        """Tell whether each node of ours takes what it wants of the bag, and reaches all it can.

        A publisher knows of a subscription later than the graph; what it sends meanwhile is lost.
        """
        from fusionslam.ros.ros2.graph import count_reachable, subscribers_of

        played = {each.topic_name for each in self._publishers.values()}
        for name in self._nodes():
            topics = reports.topics(name)
            if topics is None:
                return False
            if not all(name in subscribers_of(self._node, topic) for topic in topics & played):
                return False
            reached = reports.reached(name).items()
            if any(count < count_reachable(self._node, name, topic) for topic, count in reached):
                return False
        return True

    def _spin(self) -> None:
        import rclpy

        rclpy.spin_once(self._node, timeout_sec=_POLL_S)

    def _wait_for_receipt(self) -> None:
        from rclpy.duration import Duration

        until = time.monotonic() + _CLOSING_S
        for topic, publisher in self._publishers.items():
            while not publisher.wait_for_all_acked(Duration(seconds=_POLL_S)):
                if self._is_ending.is_set():
                    return
                if time.monotonic() > until:
                    logger.warning("%s: a subscriber has not received all messages", topic)
                    break

    @contextmanager
    def _taking_reports(self) -> Iterator[NodeReports]:
        """Yield the reports that nodes make during the block."""
        from fusionslam.ros.messages.library import message_class

        reports, kind = NodeReports(), message_class(DIAGNOSTICS)
        subscription = self._node.create_subscription(kind, REPORTS, reports.take, _QUEUE)
        try:
            yield reports
        finally:
            self._node.destroy_subscription(subscription)

    def _nodes(self) -> set[str]:
        found = self._node.get_node_names_and_namespaces()
        return {f"{space.rstrip('/')}/{name}" for name, space in found if name in NODES}

    def _publisher(self, topic: str) -> Any:
        from rclpy.qos import DurabilityPolicy, QoSProfile

        from fusionslam.ros.messages.library import message_class

        kept = DurabilityPolicy.TRANSIENT_LOCAL
        quality = QoSProfile(
            depth=_QUEUE, durability=kept if is_static(topic) else DurabilityPolicy.VOLATILE
        )
        kind = message_class(self._bag.topics[topic].type)
        return self._node.create_publisher(kind, topic, quality)

    def _send_clock(self, time_ns: int) -> None:
        if self._clock is None:
            return
        from rosgraph_msgs.msg import Clock

        from fusionslam.ros.messages.library import ros_time

        self._clock.publish(Clock(clock=ros_time(max(time_ns, 0))))


def _skip(topic: str, time_ns: int, error: DataError) -> None:
    logger.warning("left out: %s", error, extra={"cause": ("undecodable", topic)})
