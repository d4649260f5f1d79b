# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ask a ROS master for topics, their publishers and the clock in use."""

import os
import socket
from collections.abc import Sequence
from http.client import HTTPException
from urllib.parse import urlparse
from xml.parsers.expat import ExpatError
from xmlrpc import client

from fusionslam.datasets.bags.reader import Topic
from fusionslam.errors import FusionSlamError
from fusionslam.ros.check.graph import Graph

# Errors raised if no ROS master answers at the address.
_NO_MASTER = (OSError, ValueError, client.Error, HTTPException, ExpatError)
_OWN = "/fusionslam_check"
_PATIENCE_S = 3.0


def read_graph() -> Graph:
    """Ask the master at ROS_MASTER_URI.

    Raises:
        FusionSlamError: the master does not answer; the message says what to do.
    """
    import rosgraph

    uri = rosgraph.get_master_uri()
    reason = _check_address(uri)
    try:
        if reason:
            raise OSError(reason)
        master = rosgraph.Master(_OWN)
        published, _, _ = master.getSystemState()
        types = dict(master.getTopicTypes())
        sim_time = master.hasParam("/use_sim_time") and bool(master.getParam("/use_sim_time"))
    except (*_NO_MASTER, rosgraph.MasterException) as error:
        raise FusionSlamError(
            f"no ROS master at {uri} ({error}): start roscore or the robot, or set ROS_MASTER_URI "
            "to where it runs, as http://robot:11311, and ROS_IP to the address of this machine"
        ) from error
    return Graph(
        uri,
        {name: Topic(name, types.get(name, "*"), 1) for name, nodes in published if nodes},
        {name: sorted(nodes) for name, nodes in published if nodes},
        sim_time,
    )


def silent_nodes(nodes: Sequence[str]) -> dict[str, str]:
    """Return the nodes that cannot be reached from here, with the addresses that they gave."""
    import rosgraph

    master, found = rosgraph.Master(_OWN), {}
    for node in nodes:
        try:
            uri = master.lookupNode(node)
        except (OSError, rosgraph.MasterException):
            continue
        if _check_address(uri):
            found[node] = str(uri)
    return found


def _check_address(uri: str) -> str:
    """Say why nothing answers there; empty if something does. A ROS call could wait for minutes."""
    place = urlparse(uri)
    try:
        if not place.hostname or not place.port:
            return "expected an address such as http://robot:11311"
        socket.create_connection((place.hostname, place.port), _PATIENCE_S).close()
    except ValueError as error:
        return str(error)
    except OSError as error:
        return os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
    return ""
