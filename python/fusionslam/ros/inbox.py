# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that wait for a node: bounded, with all that is dropped counted."""

import threading
from collections import Counter, deque
from dataclasses import dataclass
from typing import Any

TOO_MANY = "too many wait"
SECOND_PUBLISHER = "second publisher"


@dataclass(frozen=True)
class Arrival:
    """A message as it arrived.

    Attributes:
        topic: as the node names it.
        message: what the middleware delivered.
        seconds: when, by a clock that only rises.
    """

    topic: str
    message: Any
    seconds: float


class Inbox:
    """Takes messages from any thread and gives them out in the order in which they came.

    Args:
        limit: messages of a topic that wait at most; the oldest of the topic make room.
        only_one_s: a second publisher of a topic is heard once the first was silent for so long;
            messages of two at a time contradict each other.

    Attributes:
        taken: messages by topic, dropped ones included.
        dropped: by (topic, reason).
    """

    def __init__(self, limit: int, only_one_s: float) -> None:
        self.taken: Counter[str] = Counter()
        self.dropped: Counter[tuple[str, str]] = Counter()
        self._limit, self._only_one = limit, only_one_s
        self._waiting: dict[str, deque[tuple[int, Arrival]]] = {}
        self._heard: dict[str, tuple[str, float]] = {}
        self._changed = threading.Condition()
        self._number = 0

    def put(self, arrival: Arrival, publisher: str | None) -> bool:
        """Take a message; whether it was not dropped at once.

        Args:
            arrival: the message.
            publisher: who sent it, where the topic must have only one; else None.
        """
        with self._changed:
            self.taken[arrival.topic] += 1
            if publisher is not None and not self._is_heard(arrival, publisher):
                self.dropped[arrival.topic, SECOND_PUBLISHER] += 1
                return False
            queue = self._waiting.setdefault(arrival.topic, deque())
            if len(queue) == self._limit:
                queue.popleft()
                self.dropped[arrival.topic, TOO_MANY] += 1
            queue.append((self._number, arrival))
            self._number += 1
            self._changed.notify()
            return True

    def get(self, timeout_s: float) -> Arrival | None:
        """The message that waited longest; None if none comes within the time."""
        with self._changed:
            self._changed.wait_for(self._any, timeout_s)
            queues = [queue for queue in self._waiting.values() if queue]
            return min(queues, key=lambda queue: queue[0][0]).popleft()[1] if queues else None

    def publisher_of(self, topic: str) -> str | None:
        """Whom a topic is heard from."""
        return self._heard.get(topic, (None, 0.0))[0]

    def _any(self) -> bool:
        return any(self._waiting.values())

    def _is_heard(self, arrival: Arrival, publisher: str) -> bool:
        heard, last = self._heard.get(arrival.topic, (publisher, arrival.seconds))
        if heard != publisher and arrival.seconds - last <= self._only_one:
            return False
        self._heard[arrival.topic] = publisher, arrival.seconds
        return True
