# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A node of ROS 2, by rclpy."""

import logging
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError
from functools import partial
from typing import Any

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription

from fusionslam.errors import FusionSlamError
from fusionslam.ros.messages.library import message_class, own_type, service_class
from fusionslam.ros.ros2.messages import deserialize
from fusionslam.ros.ros2.parameters import given_parameters
from fusionslam.ros.runtime.node import Delivery, Input, Service

logger = logging.getLogger(__name__)

Endpoint = Any
"""A publisher as the graph describes it: TopicEndpointInfo, of other modules in other versions."""

_LOOK_S = 0.1
_UNKNOWN = "an unknown node"
_LOOKS = 20
"""After so many looks a publisher without a known node is taken."""
_CLOSING_S = 5.0


class Ros2Transport:
    """As ``Transport``.

    It subscribes to a topic once that has a publisher, as only this one says of which type the
    topic is and how reliably it is sent: with the strictest quality of service that all publishers
    offer.

    Args:
        node: which this object spins in a thread of its own.
        is_ending: set when the process is to end.
    """

    def __init__(self, node: Node, is_ending: threading.Event) -> None:
        self.name = node.get_fully_qualified_name()
        self.parameters = given_parameters(node)
        self._node, self._is_ending = node, is_ending
        self._sources: dict[str, _Source] = {}
        self._owns: dict[str, _OwnMessages] = {}
        node.create_timer(_LOOK_S, self._look_for_publishers)
        self._failure: Exception | None = None
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._spinning = threading.Thread(target=self._spin, name="rclpy", daemon=True)
        self._spinning.start()

    def now_ns(self) -> int:
        """As ``Transport``."""
        return int(self._node.get_clock().now().nanoseconds)

    def is_shut_down(self) -> bool:
        """As ``Transport``."""
        return self._is_ending.is_set() or not self._node.context.ok()

    def full_name(self, topic: str) -> str:
        """As ``Transport``."""
        return str(self._node.resolve_topic_name(_as_ros2(topic)))

    def advertise(self, topic: str, type_name: str, *, queue: int, latched: bool) -> "_Publisher":
        """As ``Transport``; reliable, which subscribers of either kind take."""
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        quality = QoSProfile(depth=1 if latched else queue, durability=durability)
        kind = message_class(type_name)
        publisher = self._node.create_publisher(kind, _as_ros2(topic), quality)
        return _Publisher(publisher, self._own(topic))

    def subscribe(self, entry: Input, take: Callable[[Delivery], None], *, queue: int) -> None:
        """As ``Transport``."""
        own = self._own(entry.topic)
        own.keep(queue)
        self._sources[entry.topic] = _Source(self._node, entry, take, queue, own)

    def offer(self, service: Service, call: Callable[[Callable[[], Any]], Any]) -> None:
        """As ``Transport``; a response without success says why, as services of ROS 2 cannot."""

        def answer(request: Any, response: Any) -> Any:
            try:
                return call(partial(service.answer, request))
            except CancelledError:
                return _refuse(response, "shut-down", "the node ends")
            except FusionSlamError as error:
                logger.warning("%s: %s", service.name, error, extra={"cause": (error.code,)})
                return _refuse(response, error.code, str(error))

        self._node.create_service(
            service_class(service.type),
            _as_ros2(service.name),
            answer,
        )

    def has_publisher(self, topic: str, publisher: str) -> bool:
        """As ``Transport``."""
        source = self._sources.get(topic)
        return source is not None and publisher in map(sender_of, source.publishers())

    def close(self) -> None:
        """Stop spinning: a process that ends while rclpy runs aborts.

        Raises:
            FusionSlamError: rclpy had failed, which ended the node.
        """
        self._executor.shutdown(timeout_sec=_CLOSING_S)
        self._spinning.join(_CLOSING_S)
        if self._failure is not None:
            raise FusionSlamError(f"rclpy failed: {self._failure!r}") from self._failure

    def _own(self, topic: str) -> "_OwnMessages":
        return self._owns.setdefault(self.full_name(topic), _OwnMessages())

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            self._is_ending.set()
        except Exception as error:  # rclpy raises exceptions of many types
            self._failure = error
            self._is_ending.set()

    def _look_for_publishers(self) -> None:
        for source in tuple(self._sources.values()):
            source.update()


class _OwnMessages:
    """The last messages that this node published on a topic, if it listens to that as well.

    rclpy delivers them to it, too, and does not say who published a message.
    """

    def __init__(self) -> None:
        self._last: deque[bytes] = deque(maxlen=0)
        self._lock = threading.Lock()

    def keep(self, count: int) -> None:
        """Keep so many from now on: as many as may wait in the node's own subscription."""
        self._last = deque(maxlen=count)

    def note(self, message: Any) -> Any:
        """Return a message as it is to be published, after keeping it if need be."""
        if not self._last.maxlen:
            return message
        data = serialize_message(message)
        with self._lock:
            self._last.append(data)
        return data

    def __contains__(self, data: bytes) -> bool:
        with self._lock:
            return data in self._last


class _Source:
    """An input of a node, subscribed to as its publishers offer it."""

    def __init__(
        self,
        node: Node,
        entry: Input,
        take: Callable[[Delivery], None],
        queue: int,
        own: _OwnMessages,
    ) -> None:
        self._node, self._entry, self._take, self._queue = node, entry, take, queue
        self._own = own
        self._topic = node.resolve_topic_name(_as_ros2(entry.topic))
        self._subscription: Subscription | None = None
        self._offered: tuple[str, bool, bool] | None = None
        self._refused: set[tuple[str, str]] = set()
        self._senders, self._looks = "", 0

    def publishers(self) -> list[Endpoint]:
        """Publishers of the topic other than this node."""
        found = self._node.get_publishers_info_by_topic(self._topic)
        own = self._node.get_fully_qualified_name()
        return sorted((each for each in found if sender_of(each) != own), key=sender_of)

    def update(self) -> None:
        """Subscribe, or do so again if publishers offer less than is asked for."""
        usable = [each for each in self.publishers() if self._is_usable(each)]
        if not usable or not self._are_known(usable):
            return
        first = usable[0].topic_type
        same = [each for each in usable if each.topic_type == first]
        self._senders = " and ".join(map(sender_of, same))
        is_reliable = all(offers_reliable(each) for each in same)
        kept = DurabilityPolicy.TRANSIENT_LOCAL
        is_kept = all(each.qos_profile.durability == kept for each in same)
        if not self._entry.shared and len(same) > 1:
            logger.warning(
                "%s: several publishers, %s, whose messages contradict each other: stop one of "
                "them, or remap its topic",
                self._topic,
                self._senders,
                extra={"cause": ("second-publisher", self._topic)},
            )
        if self._offered is not None:
            kind, was_reliable, was_kept = self._offered
            if kind == first and was_reliable <= is_reliable and was_kept <= is_kept:
                return
        self._subscribe(first, is_reliable, is_kept)

    def _are_known(self, publishers: list[Endpoint]) -> bool:
        """Tell whether the nodes of publishers are known, which is a little later than these.

        Those of programs without ROS never are.
        """
        self._looks += any(sender_of(each) == _UNKNOWN for each in publishers)
        return self._looks > _LOOKS or all(sender_of(each) != _UNKNOWN for each in publishers)

    def _subscribe(self, type_name: str, is_reliable: bool, is_kept: bool) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        plain = own_type(type_name)
        reliability = ReliabilityPolicy.RELIABLE if is_reliable else ReliabilityPolicy.BEST_EFFORT
        durability = DurabilityPolicy.TRANSIENT_LOCAL if is_kept else DurabilityPolicy.VOLATILE
        self._offered = type_name, is_reliable, is_kept
        logger.info(
            "%s: %s, as %s publishes it",
            self._topic,
            "reliable" if is_reliable else "best effort",
            self._senders,
        )
        self._subscription = self._node.create_subscription(
            message_class(plain),
            self._topic,
            partial(self._receive, plain),
            QoSProfile(
                depth=self._queue,
                reliability=reliability,
                durability=durability,
            ),
            raw=True,
        )

    def _receive(self, plain: str, data: bytes) -> None:
        # What the node itself publishes on /tf is no news, and would never let it be idle.
        if data not in self._own:
            self._pass_on(data, plain, self._senders)

    def _pass_on(self, data: bytes, plain: str, senders: str) -> None:
        def read(type_name: str = plain) -> Any:
            return deserialize(data, type_name)

        self._take(Delivery(plain, senders, len(data), read, False))

    def _is_usable(self, publisher: Endpoint) -> bool:
        """Tell whether a publisher has a type of the input; one of another type is reported."""
        plain = own_type(publisher.topic_type)
        if plain not in self._entry.types:
            if (publisher.topic_type, sender_of(publisher)) not in self._refused:
                self._refused.add((publisher.topic_type, sender_of(publisher)))
                self._pass_on(b"", plain, sender_of(publisher))
            return False
        return True


class _Publisher:
    def __init__(self, publisher: Publisher, own: _OwnMessages) -> None:
        self._publisher, self._own = publisher, own

    def publish(self, message: Any) -> None:
        self._publisher.publish(self._own.note(message))

    def subscriptions(self) -> int:
        return int(self._publisher.get_subscription_count())


def _refuse(response: Any, code: str, text: str) -> Any:
    for name, value in (("code", code), ("reason", text), ("message", text)):
        if hasattr(response, name):
            setattr(response, name, value)
    return response


def sender_of(endpoint: Endpoint) -> str:
    """Return the full name of the node of a publisher or subscription."""
    if endpoint.node_name.startswith("_"):  # its node is not known yet, or it is of no ROS node
        return _UNKNOWN
    space = endpoint.node_namespace.rstrip("/")
    return f"{space}/{endpoint.node_name}"


def offers_reliable(publisher: Endpoint) -> bool:
    """Tell whether a publisher resends messages that were lost."""
    return bool(publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE)


def _as_ros2(name: str) -> str:
    """Return a topic or service with the sign that ROS 2 has before a node's own names."""
    return f"~/{name[1:]}" if name.startswith("~") else name
