# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Play a bag to the nodes of a launch file, once all listen, until all have processed it."""

import re
import subprocess
import time
from collections.abc import Collection, Iterable
from contextlib import suppress
from http.client import HTTPException
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy

import rosgraph
import rospy

from fusionslam.config import Section, option
from fusionslam.datasets.bags import open_bag
from fusionslam.errors import DataError
from fusionslam.ros.messages.library import message_class
from fusionslam.ros.messages.types import DIAGNOSTICS
from fusionslam.ros.nodes import NODES
from fusionslam.ros.ros1.master_watch import ros_proxy
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.ros.runtime.diagnostics import REPORTS, NodeReports

_POLL_S = 0.1
_FILES = ("memory/file", "map/file", "export", "output")
"""Parameters of nodes that name what they write."""


class BagPlayerConfig(Section):
    """Configuration of the bag player."""

    bag: str = option("", "the bag")
    rate: float = option(1.0, "playback speed, relative to the recording", gt=0)


def play_bag() -> None:
    """Play the bag named by the private parameters, and wait until the nodes have processed it.

    Raises:
        ConfigError: a wrong parameter.
        DataError: there is no bag, it has no topic that the nodes listen to, or a node ended.
    """
    config = from_parameters(BagPlayerConfig(), rospy.get_param("~", {}))
    bag = Path(config.bag).expanduser()
    with open_bag(bag) as opened:
        if opened.kind != "rosbag1":
            raise DataError(f"{bag} is of kind {opened.kind}, but ROS 1 plays only ROS 1 bags")
        held = set(opened.topics)
    reports = NodeReports()
    rospy.Subscriber(REPORTS, message_class(DIAGNOSTICS), reports.take)
    _wait(reports.have)
    played = _choose_topics(held)
    # Wait until every subscriber is connected: static transforms may come only once, at the start.
    options = ["--quiet", "--clock", "--wait-for-subscribers", "--delay", "1"]
    options += ["--rate", str(config.rate)]
    player = subprocess.Popen(["rosbag", "play", *options, str(bag), "--topics", *played])
    _wait(lambda nodes: player.poll() is not None)
    if player.wait() and not rospy.is_shutdown():
        raise DataError(f"{bag}: rosbag play ended with code {player.returncode}")
    reports.forget()
    _wait(reports.are_quiet)
    if not rospy.is_shutdown():
        lines = [f"{bag} is played to its end:"]
        for node, counts in reports.results().items():
            files = [rospy.get_param(f"{node}/{name}", "") for name in _FILES]
            lines.append(f"  {', '.join([f'{node}: ' + ', '.join(counts), *filter(None, files)])}")
        lines.append("This is a regular end: bag_player, which roslaunch requires, has finished.")
        print("\n".join(lines), flush=True)


def _wait(condition: Any) -> None:
    while not rospy.is_shutdown() and not condition(_nodes()):
        time.sleep(_POLL_S)


def _nodes() -> set[str]:
    """Return our nodes started by roslaunch. Raises DataError if one of them ended."""
    alive: set[str] = set()
    dead: set[str] = set()
    for uri in rospy.get_param("/roslaunch/uris", {}).values():
        launcher: Any = ServerProxy(uri)
        # Launch processes that ended long ago stay on the list.
        with suppress(OSError):
            _, _, (active, ended) = launcher.list_processes()
            alive |= _ours(process for process, _ in active)
            dead |= _ours(process for process, _ in ended)
    if dead:
        raise DataError(f"{min(dead)} has ended, see above")
    return alive


def _ours(processes: Iterable[str]) -> set[str]:
    """Return the names of our nodes; roslaunch numbers its processes."""
    names = {"/" + re.sub(r"-\d+$", "", process).lstrip("/") for process in processes}
    return {name for name in names if name.rpartition("/")[2] in NODES}


def _choose_topics(held: Collection[str]) -> list[str]:
    """Return the topics of the bag that nodes subscribe to and none that runs publishes.

    Raises:
        DataError: there are none.
    """
    publishers, subscribers, _ = rosgraph.Master(rospy.get_name()).getSystemState()
    # Two streams on one topic would mix; only transforms come from several nodes.
    listed = {
        topic: set(names) for topic, names in publishers if topic not in ("/tf", "/tf_static")
    }
    own = _nodes() | {rospy.get_name()}
    others = {name for name in set().union(*listed.values()) - own if _is_running(name)}
    heard = {topic for topic, _ in subscribers} - {"/clock"}
    wanted = heard - {topic for topic, names in listed.items() if names & (own | others)}
    for topic in sorted(heard & set(held) - wanted):
        if not listed[topic] & own:
            publisher = min(listed[topic] & others)
            rospy.logwarn("%s of the bag is not played: %s publishes it", topic, publisher)
    lacking = sorted(wanted - set(held))
    if lacking:
        near = {topic: [e for e in sorted(held) if e.startswith(f"{topic}/")] for topic in lacking}
        missed = ", ".join(
            f"{topic} (is it {near[topic][0]}?)" if near[topic] else topic for topic in lacking
        )
        rospy.logwarn("not in the bag: %s; it has %s", missed, ", ".join(sorted(held)))
    if not wanted & set(held):
        raise DataError(
            "the bag has no topic that a node listens to and no other node publishes: name its "
            "topics (scan:=...), or end the other publishers"
        )
    return sorted(wanted & set(held))


def _is_running(node: str) -> bool:
    """Tell whether a node answers. The master also lists those that were killed."""
    try:
        ros_proxy(rosgraph.Master(rospy.get_name()).lookupNode(node)).getPid(rospy.get_name())
    except (OSError, HTTPException, Error, ExpatError, rosgraph.MasterException):
        return False
    return True
