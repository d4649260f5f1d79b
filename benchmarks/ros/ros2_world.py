# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS 2 of one's own, for tests and timings: a domain on this machine, our nodes, a listener.

Nodes run with the Python of .venv-ros2, which ``make ros2`` makes; tests with their own.
"""

import functools
import pickle
import random
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from benchmarks.ros.world import ROOT, Listener, RosWorld, wait_until

JAZZY = ROOT / ".venv-ros2"
PEERS = ROOT / ".venv-ros2-peers"
LISTENER = Path(__file__).with_name("ros2_listener.py")
PUBLISHER = Path(__file__).with_name("publisher.py")
_MESSAGES = JAZZY / "share" / "fusionslam_msgs"
_DOMAINS = range(1, 101)  # those that every system has the ports for

lacking = "" if (JAZZY / ".messages").exists() else "ROS 2 is not installed: make ros2 installs it"


class Ros2World(RosWorld):
    """Started by ``with``; everything that it started ends with it."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        # Those of this process are of another Python.
        self.environment.pop("PYTHONPATH", None)
        self._domain = own_domain()

    def __enter__(self) -> "Ros2World":
        self.environment["ROS_DOMAIN_ID"] = str(self._domain.__enter__())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        super().__exit__(kind, error, trace)
        self._domain.__exit__(kind, error, trace)

    def node(self, name: str, *arguments: str, ready: bool = True) -> "subprocess.Popen[Any]":
        """One of our nodes with remappings (a:=b) and parameters (_fusion.voxel:=0.1)."""
        given = []
        for each in arguments:
            given += ["-p", each[1:]] if each.startswith("_") else ["-r", each]
        command = [*fusionslam("ros2", "run"), name, "--ros-args", *given]
        return self.start_node(name, command, ready=ready)

    def connect(self, listener: "Ros2Listener | None" = None, **heard: str) -> None:
        """Wait until nodes have subscribed to topics of others, and a listener to all of theirs.

        Args:
            listener: what is to hear the same topics.
            heard: topic by node.
        """
        for node, topic in heard.items():
            wait_until(lambda n=node, t=topic: f" {t}: " in self.log(n), f"{node} to hear {topic}")
            if listener is not None:
                listener.wait_for(topic)

    def peer(self, name: str, script: Path, *arguments: str) -> "subprocess.Popen[Any]":
        """A program in the environment of others."""
        return self.run(name, [str(PEERS / "bin" / "python"), str(script), *arguments])

    def listen(self, *topics: str) -> "Ros2Listener":
        """Keep all messages of these topics from now on."""
        return Ros2Listener(self, topics)

    def start_player(self, bag: Path, *options: str) -> "subprocess.Popen[Any]":
        """Begin to play a bag once all that run have subscribed."""
        return self.run("rosbag", [*fusionslam("ros2", "play"), str(bag), *options])


class Ros2Listener(Listener):
    """A process of plain rclpy; its messages are read by rosbags."""

    command = (str(JAZZY / "bin" / "python"), str(LISTENER))

    @staticmethod
    def read(type_name: str, content: bytes) -> Any:
        """Deserialise a message by rosbags."""
        return type_store().deserialize_cdr(content, type_name)

    def contents(self) -> list[tuple[str, str, bytes]]:
        """Topic, type and CDR bytes of all messages in the order in which they came."""
        path = self._world.folder / f"{id(self)}.pickle"
        self._ask(f"keep {path}")
        return [(topic, kind, data) for topic, kind, data, _ in pickle.loads(path.read_bytes())]

    def wait_for(self, *topics: str) -> None:
        """Wait until topics that it listens to are subscribed to."""
        for topic in {*topics} & {*self._topics}:
            wait_until(lambda t=topic: self.type_hash(t), f"the listener to hear {topic}")

    def type_hash(self, topic: str) -> str:
        """The hash of the type that a topic's publisher gives; empty without one."""
        return self._ask(f"hash {topic}")


class PeerListener(Ros2Listener):
    """The same of another distribution, Kilted."""

    command = (str(PEERS / "bin" / "python"), str(LISTENER))


def fusionslam(*arguments: str) -> list[str]:
    """The command line in the environment of ROS 2."""
    return [str(JAZZY / "bin" / "python"), "-m", "fusionslam", *arguments]


@contextmanager
def own_domain() -> Iterator[int]:
    """The number of a domain that no process on this machine is in, nor takes by this meanwhile."""
    for number in random.sample(_DOMAINS, len(_DOMAINS)):
        with socket.socket(socket.AF_UNIX) as claim:
            try:
                claim.bind(f"\0fusionslam-ros2-domain-{number}")  # ends with the process
                _need_empty(number)
            except OSError:
                continue
            yield number
            return
    raise AssertionError("every domain of ROS 2 is in use")


def _need_empty(domain: int) -> None:
    """Raise OSError if a process is in a domain."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 7410 + 250 * domain))  # of the domain's first process


@functools.cache
def type_store() -> Any:
    """Message types of ROS 2 Jazzy and ours, from rosbags."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in _MESSAGES.glob("msg/*.msg"):
        types |= get_types_from_msg(path.read_text(), f"fusionslam_msgs/msg/{path.stem}")
    store.register(types)
    return store
