# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Survive a restart of the ROS master, which rospy alone does not."""

import logging
import threading
import time
from http.client import HTTPConnection, HTTPException
from typing import Any
from xmlrpc.client import Error, ServerProxy, Transport

import rosgraph
import rospy
from rospy.core import is_shutdown_requested
from rospy.impl.registration import get_service_manager
from rospy.topics import get_topic_manager

logger = logging.getLogger(__name__)

_PERIOD_S = 2.0
_TIMEOUT_S = 5.0
_SUCCESS = 1


class Registration(threading.Thread):
    """Registers this node's topics and services again after a restart of the master.

    It is a thread of its own, as asking the master takes long if the network is down.
    """

    def __init__(self) -> None:
        super().__init__(name="registration", daemon=True)
        self._is_complete = True

    def run(self) -> None:
        """Check periodically that the master still knows this node, until ROS shuts down."""
        while not rospy.is_shutdown():
            time.sleep(_PERIOD_S)
            try:
                self._renew()
            except (OSError, HTTPException, Error) as error:
                logger.debug("the ROS master does not answer: %s", error)

    def _renew(self) -> None:
        master, name = ros_proxy(rosgraph.get_master_uri()), rospy.get_name()
        code, _, _ = master.lookupNode(name, name)
        # A node that ends unregisters its topics before it counts as shut down.
        if (code == _SUCCESS and self._is_complete) or is_shutdown_requested():
            return
        # The master may stop half-way, knowing only some of the topics.
        self._is_complete = False
        _register(master, name)
        self._is_complete = True
        logger.warning("the ROS master has restarted: registered again")


def _register(master: Any, name: str) -> None:
    own, topics = rospy.get_node_uri(), get_topic_manager()
    for topic, type_name in topics.get_publications():
        master.registerPublisher(name, topic, type_name, own)
    for topic, type_name in topics.get_subscriptions():
        _, _, publishers = master.registerSubscriber(name, topic, type_name, own)
        # The call that the master makes to the node's slave API when publishers change.
        ros_proxy(own).publisherUpdate("/master", topic, publishers)
    for service, uri in get_service_manager().get_services():
        master.registerService(name, service, uri, own)


class _Impatient(Transport):
    """Transport with a time limit for servers that do not answer."""

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = _TIMEOUT_S
        return connection


def ros_proxy(uri: str) -> Any:
    """Return a proxy of a master's or node's API, with a time limit of each call."""
    return ServerProxy(uri, transport=_Impatient())
