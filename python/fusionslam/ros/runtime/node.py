# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Base class of all nodes, and what they need of a middleware."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, Literal, NamedTuple, Protocol, TypeVar

from fusionslam.ros.runtime.checkpoints import Saver, SavingConfig
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.problem_log import ProblemLog

C = TypeVar("C", bound=CommonConfig)


@dataclass(frozen=True)
class Input:
    """A topic that a node listens to.

    Attributes:
        topic: its name, which can be remapped.
        types: allowed ROS types.
        take: called with each message, converted to ``sensors.messages`` if it has a type there.
        shared: whether it usually has several publishers.
        small: whether its messages are small and many, so that more of them may wait.
        optional: whether the node can do without it.
    """

    topic: str
    types: Sequence[str]
    take: Callable[[Any], None]
    shared: bool = False
    small: bool = False
    optional: bool = False


@dataclass(frozen=True)
class Service:
    """A service that a node offers.

    Attributes:
        name: its name, which can be remapped.
        type: its ROS type.
        answer: returns the response to a request; called like ``Input.take``, between messages.
    """

    name: str
    type: str
    answer: Callable[[Any], Any]


@dataclass(frozen=True)
class Timer:
    """What a node does at a rate, whatever messages it processes meanwhile.

    Attributes:
        name: for the log.
        period: seconds of the wall clock from one end to the next start.
        fire: called in a thread of its own with the time by the clock of the stamps, nanoseconds;
            0 if unknown.
    """

    name: str
    period: float
    fire: Callable[[int], None]


class Health(NamedTuple):
    """How sure a node is of where its robot is.

    Attributes:
        level: "sure", "unsure" or "lost".
        text: why it is not sure; empty if it is.
    """

    level: Literal["sure", "unsure", "lost"] = "sure"
    text: str = ""


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


class Outlet(Protocol):
    """Receiver of a node's output messages."""

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message on one of the node's outputs."""

    def is_wanted(self, topic: str) -> bool:
        """Tell whether a topic has subscribers."""


class Node(ABC, Generic[C]):
    """A node: it processes messages one after another, in one thread, and publishes.

    Args:
        config: of its own type.
        outlet: receives the messages that it publishes.

    Attributes:
        counts: labelled counts of its work, for /diagnostics.
        problems: problems with its input, logged once for each cause.
        saver: writes the state from which the node resumes at its next start; None without state.
    """

    name: ClassVar[str]
    """Its name in ROS."""
    defaults: ClassVar[CommonConfig]
    """Its default configuration."""
    outputs: ClassVar[Mapping[str, str]]
    """Types of its outputs by topic."""
    latched: ClassVar[Sequence[str]] = ()
    """Outputs whose last message a new subscriber gets at once."""

    def __init__(self, config: C, outlet: Outlet) -> None:
        self.config, self.outlet = config, outlet
        self.counts: Counter[str] = Counter()
        self.problems = ProblemLog()
        self.saver: Saver | None = None

    @classmethod
    def outputs_of(cls, config: CommonConfig) -> Mapping[str, str]:
        """Types by topic of the outputs that it has with a configuration."""
        return cls.outputs

    def make_saver(self, config: SavingConfig, save: Callable[[Path], None]) -> Saver:
        """Make the ``saver`` from the function that writes the file."""
        self.saver = Saver(config, save, self.problems)
        return self.saver

    @property
    @abstractmethod
    def inputs(self) -> Sequence[Input]:
        """Its input topics."""

    @property
    def services(self) -> Sequence[Service]:
        """Its services."""
        return ()

    @property
    def timers(self) -> Sequence[Timer]:
        """What it does at a rate."""
        return ()

    def idle(self) -> None:
        """Called once after a silence of all inputs; here: write the state."""
        if self.saver is not None:
            self.saver.write()

    def close(self) -> None:
        """Called when the node ends; here: write the state."""
        if self.saver is not None:
            self.saver.close()

    def report(self) -> Mapping[str, int | str]:
        """Return counts, and states in words, for /diagnostics."""
        return self.counts

    def health(self) -> Health:
        """Return how sure the node is of where its robot is, for the level on /diagnostics."""
        return Health()


class Publisher(Protocol):
    """A topic that a node publishes."""

    def publish(self, message: Any) -> None:
        """Send a message; called in any thread."""

    def subscriptions(self) -> int:
        """Number of subscriptions that messages reach."""


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
