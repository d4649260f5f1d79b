# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Listen to a robot as the nodes would, without publishing anything."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

from fusionslam.datasets.bags.reader import Bag, OnError, RawMessage, Topic
from fusionslam.datasets.bags.topics import ROLES, TRANSFORM_TYPES
from fusionslam.errors import DataError
from fusionslam.ros.check.graph import Robot
from fusionslam.ros.messages.types import CLOUD, IMAGES
from fusionslam.ros.runtime.message_queue import Arrival, MessageQueue
from fusionslam.ros.runtime.node import Delivery, Input
from fusionslam.ros.topic_choice import INPUTS, TF_TOPICS, choose
from fusionslam.sensors.messages import Message

Progress = Callable[[str, int, int], None]

_LIMIT_BYTES = 1 << 29
_QUEUE = 1000
_LOOK_S = 0.2
_POLL_S = 0.05


@dataclass(frozen=True)
class _HeaderOnly(RawMessage):
    """A message of which only the header is kept."""

    reason: str

    def value(self) -> Message:
        raise DataError(f"{self.topic}: {self.reason}")


class ObservedBag(Bag):
    """Messages of a running robot, in memory, read like those of a bag.

    Only the headers are kept of scans and images beyond 512 MiB, and of unreadable messages.
    """

    def __init__(self) -> None:
        self.path, self.kind, self.is_cut = Path("robot"), "live", False
        self.topics: dict[str, Topic] = {}
        self.start_ns = self.stop_ns = 0
        self._received: list[RawMessage] = []
        self._bytes = 0

    def add(self, arrival: Arrival) -> None:
        """Add a message."""
        topic, delivery, time_ns = arrival.topic, arrival.message, arrival.stamp_ns
        type_name = delivery.type
        count = self.topics[topic].count if topic in self.topics else 0
        self.topics[topic] = Topic(topic, type_name, count + 1)
        self.start_ns, self.stop_ns = self.start_ns or time_ns, time_ns
        large_bytes = delivery.size if type_name in (CLOUD, *IMAGES) else 0
        self._bytes += large_bytes
        try:
            if large_bytes and self._bytes > _LIMIT_BYTES:
                raise DataError("not kept, there is too much data: listen for a shorter time")
            self._received.append(RawMessage(topic, type_name, time_ns, delivery.read()))
        except DataError as error:
            header = None if topic in TF_TOPICS else delivery.read("std_msgs/Header")
            rest = SimpleNamespace(header=header)
            self._received.append(_HeaderOnly(topic, type_name, time_ns, rest, str(error)))

    def raw(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: int | None = None,
        stop: int | None = None,
        on_error: OnError | None = None,
    ) -> Iterator[RawMessage]:
        """As ``Bag.raw``; unreadable messages keep their header, so ``on_error`` is not called."""
        names = self.known_topics(topics)
        for raw in self._received:
            is_early = start is not None and raw.time_ns < start
            is_late = stop is not None and raw.time_ns >= stop
            if raw.topic in names and not (is_early or is_late):
                yield raw

    def message(self, topic: str, time_ns: int, occurrence: int = 0) -> Message:
        """As ``Bag.message``."""
        found = self.raw([topic], start=time_ns, stop=time_ns + 1)
        return next(islice(found, occurrence, None)).value()


class TopicListener:
    """Listens to the topics of the nodes, or to the best guess for a missing topic.

    Args:
        robot: what it listens to.
        roles: which the nodes need, of ``INPUTS``.
        only_one_s: as ``MessageQueue``.

    Attributes:
        bag: the messages that arrived.
        graph: the latest one of the robot.
        choices: chosen topics by role.
        roles: topics that were listened to, by role.

    Raises:
        FusionSlamError: nobody knows the topics.
    """

    def __init__(self, robot: Robot, roles: Sequence[str], only_one_s: float) -> None:
        self.bag, self.roles = ObservedBag(), dict[str, str]()
        self._robot = robot
        self._asked = {role: robot.topics[INPUTS[role]] for role in roles}
        self._waiting = MessageQueue(_QUEUE, only_one_s)
        self._subscribed: set[str] = set()
        # Subscribe before anyone publishes: a bag sends its static transforms once, at its start.
        for name in TF_TOPICS:
            self._subscribe(name, robot.topics[name], TRANSFORM_TYPES)
        self._subscribe_new()

    def listen(self, seconds: float, progress: Progress) -> None:
        """Wait up to ``seconds`` for the first sensor, then listen for ``seconds``.

        Raises as the constructor.
        """
        self._poll_until("waiting", seconds, progress, self._has_messages)
        if self._has_messages():
            self._poll_until("listening", seconds, progress, self._robot.transport.is_shut_down)
        self._subscribe_new()

    def _has_messages(self) -> bool:
        return any(topic in self.bag.topics for topic in self.roles.values())

    def _poll_until(
        self, what: str, seconds: float, progress: Progress, done: Callable[[], bool]
    ) -> None:
        begin = looked = time.monotonic()
        while (since := time.monotonic() - begin) < seconds and not done():
            progress(what, int(since), round(seconds))
            arrival = self._waiting.get(_POLL_S)
            if arrival is not None:
                self.bag.add(arrival)
            if time.monotonic() - looked > _LOOK_S:
                self._subscribe_new()
                looked = time.monotonic()
        progress(what, round(seconds), round(seconds))

    def _subscribe_new(self) -> None:
        """Subscribe to topics that have appeared since."""
        self.graph = self._robot.read_graph()
        self.choices = choose(self.graph.topics, self.graph.publishers, self._asked)
        for role, choice in self.choices.items():
            # Keep topics that have ended meanwhile.
            if choice.topic:
                self.roles = {**self.roles, role: choice.topic}  # another thread looks into it
                self._subscribe(choice.topic, choice.topic, ROLES[role])

    def _subscribe(self, name: str, topic: str, types: Sequence[str]) -> None:
        """Subscribe to a topic once.

        Args:
            name: of a transform topic, which tells whether it is static even if it was remapped.
            topic: full name.
            types: messages of other types are ignored.
        """
        if topic in self._subscribed:
            return
        self._subscribed.add(topic)

        def take(delivery: Delivery) -> None:
            is_transform = name in TF_TOPICS
            # A topic that was guessed at first may have given way to the one asked for.
            if delivery.type in types and (is_transform or name in self.roles.values()):
                now_ns = self._robot.transport.now_ns()
                arrival = Arrival(name, delivery, time.monotonic(), now_ns)
                # Like the nodes, listen only to the first of two publishers.
                publisher = delivery.publisher(entry)
                self._waiting.put(arrival, publisher, is_many=is_transform)

        entry = Input(topic, types, take, shared=name in TF_TOPICS)
        self._robot.transport.subscribe(entry, take, queue=_QUEUE)
