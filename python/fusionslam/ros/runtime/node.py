# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Base class of all nodes, independent of the middleware."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

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
