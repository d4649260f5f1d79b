# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""rospy around a node: messages in, values to the node, messages out, reports, and a clean end."""

import logging
import time
from dataclasses import replace
from typing import Any

import rospy

from fusionslam.datasets.bags.conversions import is_known, value_of
from fusionslam.errors import DataError, FusionSlamError, ShapeError
from fusionslam.messages import CameraInfo, FrameTransforms
from fusionslam.ros.complaints import Complaints
from fusionslam.ros.config import from_parameters
from fusionslam.ros.diagnostics import Stopwatch, diagnostics
from fusionslam.ros.inbox import Arrival, Inbox
from fusionslam.ros.message_types import DIAGNOSTICS, deserialized, message_class
from fusionslam.ros.node import Input, Node
from fusionslam.ros.registration import Registration

logger = logging.getLogger(__name__)

BUFFER_BYTES = 1 << 24
"""What a socket reads at a time: rospy's default of 64 KiB delays clouds and images."""
_POLL_S = 0.1
_REPORTS = "/diagnostics"


class Shell:
    """Runs one node until ROS shuts down.

    Args:
        kind: the node's class.

    Raises:
        ConfigError: a parameter that the node does not know, or a wrong value.
    """

    def __init__(self, kind: type[Node[Any]]) -> None:
        self.name = kind.name
        self.config = from_parameters(kind.defaults, _parameters())
        common = self.config.node
        self.inbox = Inbox(common.queue, common.only_one)
        self.complaints, self.watch = Complaints(), Stopwatch()
        self.published = False
        # Before the node is made, which may take a while: who listens finds the topics at once.
        self._publishers = {
            topic: rospy.Publisher(
                topic,
                message_class(type_name),
                queue_size=common.queue,
                latch=topic in kind.latched,
            )
            for topic, type_name in kind.outputs.items()
        }
        self._reports = rospy.Publisher(_REPORTS, message_class(DIAGNOSTICS), queue_size=10)
        self.node = kind(self.config, self)
        self.inputs = {each.topic: each for each in self.node.inputs}
        self._subscribers = [_subscribe(each, self._arrived) for each in self.inputs.values()]
        self._registration = Registration()
        self._last_arrival = self._last_report = time.monotonic()
        self._is_idle = True

    def _publisher(self, topic: str, kind: type[Node[Any]]) -> rospy.Publisher:
        return rospy.Publisher(
            topic,
            message_class(kind.outputs[topic]),
            queue_size=self.config.node.queue,
            latch=topic in kind.latched,
        )

    def publish(self, topic: str, message: Any) -> None:
        """As ``Outlet``."""
        _send(self._publishers[topic], message)
        self.published = True

    def is_wanted(self, topic: str) -> bool:
        """As ``Outlet``."""
        return bool(self._publishers[topic].get_num_connections())

    def run(self) -> None:
        """Work until ROS shuts down, then let the node keep what it has to."""
        try:
            while not rospy.is_shutdown():
                arrival = self.inbox.get(_POLL_S)
                if arrival is None:
                    self._quiet()
                else:
                    self._work_off(arrival)
                self._report()
        finally:
            self._guarded("closing", self.node.close)

    def _arrived(self, message: Any, topic: str) -> None:
        """In a thread of rospy."""
        sender = message._connection_header["callerid"]
        arrival = Arrival(topic, message, time.monotonic())
        if not self.inbox.put(arrival, None if self.inputs[topic].shared else sender):
            self.complaints.add(
                topic,
                f"two publishers, {self.inbox.publisher_of(topic)} and {sender}: the second one is "
                "not heard; stop it, or remap one of them",
            )

    def _work_off(self, arrival: Arrival) -> None:
        self._last_arrival, self._is_idle = time.monotonic(), False
        self.published = False
        self._guarded(arrival.topic, lambda: self._take(arrival))
        if self.published:
            self.watch.note(time.monotonic() - arrival.seconds)

    def _take(self, arrival: Arrival) -> None:
        entry = self.inputs[arrival.topic]
        message, type_name = _typed(arrival.message, entry)
        if not is_known(type_name):
            self._need_stamp(message.header.stamp.to_nsec())
            entry.take(message)
            return
        for value in self._stamped(value_of(message, type_name, rospy.resolve_name(entry.topic))):
            entry.take(value)

    def _stamped(self, value: Any) -> list[Any]:
        """The value with the stamp that counts; nothing of transforms without any."""
        if isinstance(value, FrameTransforms):
            kept = tuple(each for each in value.transforms if each.static or each.stamp_ns)
            if len(kept) < len(value.transforms):
                lost = next(e for e in value.transforms if not (e.static or e.stamp_ns))
                self.complaints.add(
                    "/tf",
                    f"the transform of '{lost.child}' has the stamp zero and is left out: its "
                    "publisher has to stamp it",
                )
            return [replace(value, transforms=kept)] if kept else []
        if self.config.node.stamps == "arrival":
            return [replace(value, stamp_ns=rospy.Time.now().to_nsec())]
        if not isinstance(value, CameraInfo):  # whose stamp nobody needs
            self._need_stamp(value.stamp_ns)
        return [value]

    def _need_stamp(self, stamp_ns: int) -> None:
        if not stamp_ns and self.config.node.stamps == "header":
            raise DataError(
                "the stamp is zero: its publisher has to stamp it, or set the parameter "
                "~node/stamps to arrival"
            )

    def _guarded(self, topic: str, action: Any) -> None:
        """Whatever is wrong with a message, the node goes on."""
        try:
            action()
        except (DataError, ShapeError) as error:
            self.complaints.add(topic, str(error))
        except FusionSlamError as error:
            self.complaints.add(topic, f"{type(error).__name__}: {error}")
        except Exception as error:
            self.complaints.add(topic, f"a defect of fusionslam, please report it: {error!r}")
            logger.exception("%s", topic)

    def _quiet(self) -> None:
        if not self._is_idle and time.monotonic() - self._last_arrival > self.config.node.idle:
            self._is_idle = True
            self._guarded("silence", self.node.idle)
        self._guarded("ROS master", self._registration.renew)

    def _report(self) -> None:
        now = time.monotonic()
        if now - self._last_report < self.config.node.report:
            return
        self._last_report = now
        _send(self._reports, diagnostics(self))


def _send(publisher: rospy.Publisher, message: Any) -> None:
    try:
        publisher.publish(message)
    except rospy.ROSException:
        # Raised, too, if the node is shut down at this very moment.
        if not rospy.is_shutdown():
            raise


def _parameters() -> Any:
    return rospy.get_param("~", {})


def _subscribe(entry: Input, arrived: Any) -> Any:
    several = len(entry.types) > 1
    return rospy.Subscriber(
        entry.topic,
        rospy.AnyMsg if several else message_class(entry.types[0]),
        arrived,
        callback_args=entry.topic,
        buff_size=BUFFER_BYTES,
        tcp_nodelay=True,
    )


def _typed(message: Any, entry: Input) -> tuple[Any, str]:
    """The message as what its publisher says it is. Raises DataError for a type not expected."""
    if len(entry.types) == 1:
        return message, entry.types[0]
    found = message._connection_header["type"]
    if found not in entry.types:
        raise DataError(f"its type is {found}, expected {' or '.join(entry.types)}")
    return deserialized(message, found), found
