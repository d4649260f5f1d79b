# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a node of ROS 2 knows of the topics of others."""

from collections.abc import Sequence

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible

from fusionslam.datasets.bags.reader import Topic
from fusionslam.datasets.bags.topics import ROLES
from fusionslam.ros.check.graph import Graph
from fusionslam.ros.messages.library import own_type
from fusionslam.ros.ros2.transport import Endpoint, offers_reliable, sender_of

_UNKNOWN = "INVALID"
"""Text of an unknown TypeHash. Humble has none of any type."""

_SENSOR_TYPES = {each for types in ROLES.values() for each in types}


def read_graph(node: Node) -> Graph:
    """Return the topics that other nodes publish."""
    own, offers = node.get_fully_qualified_name(), dict[str, Sequence[Endpoint]]()
    for topic, _ in node.get_topic_names_and_types():
        found = [e for e in node.get_publishers_info_by_topic(topic) if sender_of(e) != own]
        if found:
            offers[topic] = sorted(found, key=sender_of)
    domain, middleware = node.context.get_domain_id(), rclpy.get_rmw_implementation_identifier()
    return Graph(
        where=f"domain {domain}, {middleware}",
        topics={name: Topic(name, _type_of(found), 1) for name, found in offers.items()},
        publishers={name: [*map(sender_of, found)] for name, found in offers.items()},
        sim_time=bool(node.get_parameter("use_sim_time").value),
        reliable={name: all(map(offers_reliable, found)) for name, found in offers.items()},
        foreign={name: _foreign(node, name, found) for name, found in offers.items()},
    )


def _type_of(publishers: Sequence[Endpoint]) -> str:
    """Return the type of a topic: the first that nodes listen to, as only they would."""
    types = [own_type(each.topic_type) for each in publishers]
    return next((each for each in types if each in _SENSOR_TYPES), types[0])


def _foreign(node: Node, topic: str, publishers: Sequence[Endpoint]) -> list[str]:
    """Return publishers whose type has another definition than that of our own subscription."""
    own = node.get_fully_qualified_name()
    subscriptions = node.get_subscriptions_info_by_topic(topic)
    known = {_type_hash(each) for each in subscriptions if sender_of(each) == own} - {_UNKNOWN}
    fitting = {*known, _UNKNOWN}
    return [sender_of(each) for each in publishers if known and _type_hash(each) not in fitting]


def _type_hash(endpoint: Endpoint) -> str:
    return str(getattr(endpoint, "topic_type_hash", _UNKNOWN))


def subscribers_of(node: Node, topic: str) -> set[str]:
    """Full names of the nodes that have subscribed to a topic."""
    return {sender_of(each) for each in node.get_subscriptions_info_by_topic(topic)}


def count_reachable(node: Node, publisher: str, topic: str) -> int:
    """Number of subscriptions that take what a node with this full name publishes on a topic."""
    takers = node.get_subscriptions_info_by_topic(topic)
    return sum(
        _fits(offer, taker)
        for offer in node.get_publishers_info_by_topic(topic)
        if sender_of(offer) == publisher
        for taker in takers
    )


def _fits(offer: Endpoint, taker: Endpoint) -> bool:
    compatible, _ = qos_check_compatible(offer.qos_profile, taker.qos_profile)
    return bool(taker.topic_type == offer.topic_type and compatible != QoSCompatibility.ERROR)
