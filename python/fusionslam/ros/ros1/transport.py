# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A node of ROS 1, by rospy."""

from collections.abc import Callable
from concurrent.futures import CancelledError
from typing import Any

import rospy
from rospy.core import is_shutdown_requested

from fusionslam.errors import FusionSlamError
from fusionslam.ros.messages.library import message_class, service_class
from fusionslam.ros.ros1.master_watch import Registration
from fusionslam.ros.ros1.messages import delivery_of
from fusionslam.ros.runtime.node import Delivery, Input, Service

BUFFER_BYTES = 1 << 24
"""Read buffer of a socket: rospy's default of 64 KiB delays clouds and images."""


class Ros1Transport:
    """As ``Transport``, of the node that this process has initialised."""

    def __init__(self) -> None:
        self.name: str = rospy.get_name()
        self.parameters = rospy.get_param("~", {})
        self._subscribers: dict[str, rospy.Subscriber] = {}
        Registration().start()

    def now_ns(self) -> int:
        """As ``Transport``."""
        return int(rospy.Time.now().to_nsec())

    def is_shut_down(self) -> bool:
        """As ``Transport``."""
        return bool(is_shutdown_requested())

    def full_name(self, topic: str) -> str:
        """As ``Transport``."""
        return str(rospy.resolve_name(topic))

    def advertise(self, topic: str, type_name: str, *, queue: int, latched: bool) -> "_Publisher":
        """As ``Transport``."""
        return _Publisher(
            rospy.Publisher(topic, message_class(type_name), queue_size=queue, latch=latched)
        )

    def subscribe(self, entry: Input, take: Callable[[Delivery], None], *, queue: int) -> None:
        """As ``Transport``; with any type: with a wrong one rospy just logs repeated failures."""
        del queue  # a thread of rospy takes each message as it comes

        def receive(message: Any) -> None:
            delivery = delivery_of(message)
            # What the node itself publishes on /tf is no news.
            if delivery.sender != self.name:
                take(delivery)

        self._subscribers[entry.topic] = rospy.Subscriber(
            entry.topic, rospy.AnyMsg, receive, buff_size=BUFFER_BYTES, tcp_nodelay=True
        )

    def offer(self, service: Service, call: Callable[[Callable[[], Any]], Any]) -> None:
        """As ``Transport``."""

        def answer(request: Any) -> Any:
            try:
                return call(lambda: service.answer(request))
            except CancelledError:
                raise rospy.ServiceException("the node ends") from None
            except FusionSlamError as error:
                raise rospy.ServiceException(str(error)) from error

        rospy.Service(service.name, service_class(service.type), answer)

    def has_publisher(self, topic: str, publisher: str) -> bool:
        """As ``Transport``."""
        subscriber = self._subscribers.get(topic)
        connections = subscriber.impl.connections if subscriber is not None else []
        return any(line.callerid_pub == publisher and not line.done for line in connections)


class _Publisher:
    def __init__(self, publisher: rospy.Publisher) -> None:
        self._publisher = publisher

    def publish(self, message: Any) -> None:
        try:
            self._publisher.publish(message)
        except rospy.ROSException:
            # Topics are closed before is_shutdown becomes true.
            if not is_shutdown_requested():
                raise

    def subscriptions(self) -> int:
        return int(self._publisher.get_num_connections())
