# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bounded queue of messages for a node, which counts dropped messages."""

import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

TOO_MANY = "too many wait"
SECOND_PUBLISHER = "second publisher"
# Factor for topics of small messages, such as odometry, or with many publishers, such as TF.
_MANY = 10


@dataclass(frozen=True)
class Arrival:
    """A message as it arrived.

    Attributes:
        topic: the node's name of the topic.
        message: as delivered by the middleware, a ``transport.Delivery``.
        seconds: arrival time by the monotonic clock.
        stamp_ns: arrival time by the clock of the stamps; 0 if unknown.
    """

    topic: str
    message: Any
    seconds: float
    stamp_ns: int = 0


class MessageQueue:
    """Takes messages from any thread and returns them in the order of arrival.

    Args:
        limit: maximum number of waiting messages per topic, ten times as many for topics with
            several publishers or small messages; the oldest of the topic are dropped first.
        only_one_s: silence in seconds of a topic's publisher after which another one is accepted;
            messages of two publishers at a time contradict each other.
        is_there: tells whether a topic's publisher still exists; if it is gone, as after a restart
            of its driver under another name, the next one is accepted at once.
    """

    def __init__(
        self,
        limit: int,
        only_one_s: float,
        is_there: Callable[[str, str], bool] = lambda topic, publisher: True,
    ) -> None:
        self._taken: Counter[str] = Counter()
        self._dropped: Counter[tuple[str, str]] = Counter()
        self._limit, self._only_one, self._is_there = limit, only_one_s, is_there
        self._waiting: dict[str, deque[tuple[int, Arrival]]] = {}
        self._heard: dict[str, tuple[str, float]] = {}
        self._changed = threading.Condition()
        self._number = 0

    @property
    def taken(self) -> Counter[str]:
        """Number of messages by topic so far, including dropped ones."""
        with self._changed:
            return self._taken.copy()

    @property
    def waiting(self) -> int:
        """Number of messages that wait."""
        with self._changed:
            return sum(len(queue) for queue in self._waiting.values())

    @property
    def dropped(self) -> Counter[tuple[str, str]]:
        """Number of dropped messages by (topic, reason)."""
        with self._changed:
            return self._dropped.copy()

    def put(self, arrival: Arrival, publisher: str | None, *, is_many: bool = False) -> str | None:
        """Add a message; return the reason if a message of the topic was dropped, else None.

        Args:
            arrival: the message.
            publisher: its sender, if the topic must have only one publisher; else None.
            is_many: whether the topic's messages are small and many, such as odometry, or of
                several publishers.
        """
        with self._changed:
            self._taken[arrival.topic] += 1
            if publisher is not None and not self._is_heard(arrival, publisher):
                self._dropped[arrival.topic, SECOND_PUBLISHER] += 1
                return SECOND_PUBLISHER
            queue = self._waiting.setdefault(arrival.topic, deque())
            is_full = len(queue) == self.limit_of(is_many=is_many)
            if is_full:
                queue.popleft()
                self._dropped[arrival.topic, TOO_MANY] += 1
            queue.append((self._number, arrival))
            self._number += 1
            self._changed.notify()
            return TOO_MANY if is_full else None

    def limit_of(self, *, is_many: bool) -> int:
        """Return the maximum number of waiting messages of a topic.

        Args:
            is_many: whether its messages are small and many, or of several publishers.
        """
        return self._limit * (_MANY if is_many else 1)

    def get(self, timeout_s: float) -> Arrival | None:
        """Return the message that waited longest; None if none comes within the time."""
        with self._changed:
            self._changed.wait_for(lambda: any(self._waiting.values()), timeout_s)
            queues = [queue for queue in self._waiting.values() if queue]
            return min(queues, key=lambda queue: queue[0][0]).popleft()[1] if queues else None

    def publisher_of(self, topic: str) -> str | None:
        """Return the publisher that a topic is accepted from, or None."""
        with self._changed:
            return self._heard.get(topic, (None, 0.0))[0]

    def _is_heard(self, arrival: Arrival, publisher: str) -> bool:
        heard, last = self._heard.get(arrival.topic, (publisher, arrival.seconds))
        is_recent = heard != publisher and arrival.seconds - last <= self._only_one
        if is_recent and self._is_there(arrival.topic, heard):
            return False
        self._heard[arrival.topic] = publisher, arrival.seconds
        return True
