# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Plays a bag to the nodes of a launch file, from when all listen until all is worked off."""

import re
import subprocess
import time
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any
from xmlrpc.client import ServerProxy

import rosgraph
import rospy

from fusionslam.config import Section, option
from fusionslam.datasets.bags import open_bag
from fusionslam.errors import DataError
from fusionslam.ros.messages.types import DIAGNOSTICS, message_class
from fusionslam.ros.nodes import NODES
from fusionslam.ros.runtime.config import from_parameters

_POLL_S = 0.1
_SAME_REPORTS = 3
"""A node that says so often that nothing happened has worked off everything."""
_OWN_TIME = ("processor time", "latency")
"""What changes in a report though nothing happened."""


class BagPlayerConfig(Section):
    """What is played."""

    bag: str = option("", "the bag")
    rate: float = option(1.0, "how much faster than it was recorded", gt=0)


class _Reports:
    """What nodes say of themselves, and how often they said the same."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[Any, int]] = {}
        rospy.Subscriber("/diagnostics", message_class(DIAGNOSTICS), self._heard)

    def have(self, nodes: Collection[str]) -> bool:
        """Whether all nodes reported."""
        return all(node in self._last for node in nodes)

    def are_quiet(self, nodes: Collection[str]) -> bool:
        """Whether nothing happens in any node."""
        return all(self._last[node][1] >= _SAME_REPORTS for node in nodes)

    def forget(self) -> None:
        """Count anew."""
        self._last = {node: (None, 0) for node in self._last}

    def _heard(self, message: Any) -> None:
        for status in message.status:
            values = [(e.key, e.value) for e in status.values if not e.key.startswith(_OWN_TIME)]
            before, count = self._last.get(status.hardware_id, (None, 0))
            self._last[status.hardware_id] = values, count + 1 if values == before else 0


def play_bag() -> None:
    """Play the bag of the private parameters, and wait until its messages are worked off.

    Raises:
        ConfigError: a wrong parameter.
        DataError: no bag, one without a topic that the nodes wait for, or a node that ended.
    """
    config = from_parameters(BagPlayerConfig(), rospy.get_param("~", {}))
    bag = Path(config.bag).expanduser()
    with open_bag(bag) as opened:
        if opened.kind != "rosbag1":
            raise DataError(f"{bag} is of kind {opened.kind}, but ROS 1 plays only its own bags")
        held = set(opened.topics)
    reports = _Reports()
    _wait(lambda nodes: reports.have(nodes))
    played = _played(held)
    # Who listens has to be connected: static transforms may come once, and at once.
    options = ["--quiet", "--clock", "--wait-for-subscribers", "--delay", "1"]
    options += ["--rate", str(config.rate)]
    player = subprocess.Popen(["rosbag", "play", *options, str(bag), "--topics", *played])
    _wait(lambda nodes: player.poll() is not None)
    if player.wait() and not rospy.is_shutdown():
        raise DataError(f"{bag}: rosbag play ended with code {player.returncode}")
    reports.forget()
    _wait(reports.are_quiet)


def _wait(condition: Any) -> None:
    while not rospy.is_shutdown() and not condition(_nodes()):
        time.sleep(_POLL_S)


def _nodes() -> set[str]:
    """Our nodes that roslaunch has started. Raises DataError if one of them ended."""
    alive: set[str] = set()
    dead: set[str] = set()
    for uri in rospy.get_param("/roslaunch/uris", {}).values():
        launcher: Any = ServerProxy(uri)
        # Those that ended long ago stay on the list.
        with suppress(OSError):
            _, _, (active, ended) = launcher.list_processes()
            alive |= _ours(process for process, _ in active)
            dead |= _ours(process for process, _ in ended)
    if dead:
        raise DataError(f"{min(dead)} has ended, see above")
    return alive


def _ours(processes: Iterable[str]) -> set[str]:
    """Names of our nodes; roslaunch numbers its processes."""
    names = {"/" + re.sub(r"-\d+$", "", process).lstrip("/") for process in processes}
    return {name for name in names if name.rpartition("/")[2] in NODES}


def _played(held: Collection[str]) -> list[str]:
    """Topics of the bag that somebody listens to and no node publishes.

    Raises:
        DataError: there are none.
    """
    publishers, subscribers, _ = rosgraph.Master(rospy.get_name()).getSystemState()
    # What a recording has of our own nodes is not played to them; of transforms each has a part.
    own = {topic for topic, _ in publishers} - {"/tf", "/tf_static"}
    wanted = {topic for topic, _ in subscribers} - own - {"/clock"}
    lacking = sorted(wanted - set(held))
    if lacking:
        missed = ", ".join(_with_guess(each, held) for each in lacking)
        rospy.logwarn("not in the bag: %s; it has %s", missed, ", ".join(sorted(held)))
    if not wanted & set(held):
        raise DataError("the bag has no topic that a node listens to: say which are which")
    return sorted(wanted & set(held))


def _with_guess(topic: str, held: Collection[str]) -> str:
    """A topic that the bag lacks, and what it may be called there."""
    near = [each for each in sorted(held) if each.startswith(f"{topic}/")]
    return f"{topic} (is it {near[0]}?)" if near else topic
