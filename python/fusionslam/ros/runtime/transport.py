# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a node needs of a middleware."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from fusionslam.ros.runtime.node import Input, Service


@dataclass(frozen=True)
class Delivery:
    """A message as a middleware delivers it.

    Attributes:
        type: its ROS type, as "nav_msgs/Odometry".
        sender: the full name of the node that published it; where the middleware does not tell
            the publishers of a topic apart, the names of all.
        is_of_sender: whether it tells them apart.
        size: bytes.
        read: deserialises it, as another type if one is given. Raises DataError.
    """

    type: str
    sender: str
    size: int
    read: Callable[..., Any]
    is_of_sender: bool = True

    def publisher(self, entry: Input) -> str | None:
        """Return the sender if no other one may publish the topic meanwhile; else None."""
        return self.sender if self.is_of_sender and not entry.shared else None


class Publisher(Protocol):
    """A topic that a node publishes."""

    def publish(self, message: Any) -> None:
        """Send a message; called in any thread."""

    def is_wanted(self) -> bool:
        """Tell whether the topic has subscribers."""


class Transport(Protocol):
    """A node of a middleware, which ends when the middleware shuts down.

    Attributes:
        name: full name of the node.
    """

    name: str

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Its own parameters, nested by name."""

    def now_ns(self) -> int:
        """Return the time by the clock of the stamps, which may be simulated; 0 if unknown."""

    def is_shut_down(self) -> bool:
        """Tell whether the node is to end."""

    def full_name(self, topic: str) -> str:
        """Return the full name of a topic, after remapping."""

    def advertise(self, topic: str, type_name: str, *, queue: int, latched: bool) -> Publisher:
        """Begin to publish a topic; of a latched one new subscribers get the last message."""

    def subscribe(self, entry: Input, take: Callable[[Delivery], None], *, queue: int) -> None:
        """Pass on the messages of a topic as they come, in any thread.

        Args:
            entry: the topic.
            take: gets each message; it is quick.
            queue: messages that the middleware may keep until they are taken.
        """

    def offer(self, service: Service, call: Callable[[Callable[[], Any]], Any]) -> None:
        """Offer a service; ``call`` runs its answer in the node's thread.

        It raises CancelledError if the node ends before, and what the answer raises.
        """

    def has_publisher(self, topic: str, publisher: str) -> bool:
        """Tell whether a node still publishes a topic."""
