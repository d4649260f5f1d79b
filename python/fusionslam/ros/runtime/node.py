# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What all nodes have in common, whatever delivers and takes away their messages."""

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
        types: ROS types that it may have.
        take: called with each message, as a value of ``sensors.messages`` where there is one.
        shared: whether it usually has several publishers.
        small: whether its messages are small and many: more of them may wait.
        optional: whether the node can do without it.
    """

    topic: str
    types: Sequence[str]
    take: Callable[[Any], None]
    shared: bool = False
    small: bool = False
    optional: bool = False


class Outlet(Protocol):
    """Where a node's messages go."""

    def publish(self, topic: str, message: Any) -> None:
        """Send a message on one of the node's outputs."""

    def is_wanted(self, topic: str) -> bool:
        """Whether anybody listens to it."""


class Node(ABC, Generic[C]):
    """A node: it takes messages one after another, in one thread, and publishes.

    Args:
        config: of its own type.
        outlet: where messages go.

    Attributes:
        counts: what it did, in words, for /diagnostics.
        problems: what was wrong with what it got, said once for each cause.
        saver: writes what the node goes on from at its next start; None where there is nothing.
    """

    name: ClassVar[str]
    """As ROS knows it."""
    defaults: ClassVar[CommonConfig]
    """Its configuration, if no parameter says otherwise."""
    outputs: ClassVar[Mapping[str, str]]
    """Types by topic."""
    latched: ClassVar[Sequence[str]] = ()
    """Outputs whose last message a new listener gets at once."""

    def __init__(self, config: C, outlet: Outlet) -> None:
        self.config, self.outlet = config, outlet
        self.counts: Counter[str] = Counter()
        self.problems = ProblemLog()
        self.saver: Saver | None = None

    def saved(self, config: SavingConfig, save: Callable[[Path], None]) -> Saver:
        """The ``saver``, made of the function that writes the file."""
        self.saver = Saver(config, save, self.problems)
        return self.saver

    @property
    @abstractmethod
    def inputs(self) -> Sequence[Input]:
        """What it listens to."""

    def idle(self) -> None:
        """Called once after a silence of all inputs: work off what waits for more."""

    def close(self) -> None:
        """Called when the node ends: keep what has to be kept."""

    def report(self) -> Mapping[str, int]:
        """Counts for /diagnostics."""
        return self.counts
