# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Survives a restart of the ROS master, which rospy alone does not."""

import logging
import time
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
from rospy.topics import get_topic_manager

logger = logging.getLogger(__name__)

_PERIOD_S = 2.0


class Registration:
    """Tells a master that was started anew what this node offers and wants."""

    def __init__(self) -> None:
        self._looked = time.monotonic()

    def renew(self) -> None:
        """Look, now and then, whether the master still knows this node; if not, register again."""
        if time.monotonic() - self._looked < _PERIOD_S:
            return
        self._looked = time.monotonic()
        master = rosgraph.Master(rospy.get_name())
        try:
            if not _is_known(master):
                _register(master)
                logger.warning("the ROS master was started anew: registered again")
        except (OSError, rosgraph.MasterException) as error:
            logger.debug("the ROS master does not answer: %s", error)


def _is_known(master: rosgraph.Master) -> bool:
    try:
        master.lookupNode(rospy.get_name())
    except rosgraph.MasterError:
        return False
    return True


def _register(master: rosgraph.Master) -> None:
    own, topics = rospy.get_node_uri(), get_topic_manager()
    for topic, type_name in topics.get_publications():
        master.registerPublisher(topic, type_name, own)
    for topic, type_name in topics.get_subscriptions():
        publishers = master.registerSubscriber(topic, type_name, own)
        # What the master tells nodes when publishers change, by the node's own slave API.
        ServerProxy(own).publisherUpdate("/master", topic, publishers)
