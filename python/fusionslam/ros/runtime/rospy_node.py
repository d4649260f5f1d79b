# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Run a node with rospy: subscribe, publish, report diagnostics and end cleanly."""

import threading
import time
from collections.abc import Collection
from concurrent.futures import CancelledError
from typing import Any

import rospy
from rospy.core import is_shutdown_requested

from fusionslam.errors import FusionSlamError
from fusionslam.ros.messages.types import DIAGNOSTICS, message_class, service_class
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.ros.runtime.diagnostics import diagnostics
from fusionslam.ros.runtime.master_watch import Registration
from fusionslam.ros.runtime.node import Node, Service, Timer
from fusionslam.ros.runtime.problem_log import ProblemLog
from fusionslam.ros.runtime.worker import Worker

BUFFER_BYTES = 1 << 24
"""Read buffer of a socket: rospy's default of 64 KiB delays clouds and images."""
_POLL_S = 0.1
_REPORTS = "/diagnostics"


class RospyNode:
    """Runs one node until ROS shuts down.

    Args:
        kind: the node's class.

    Raises:
        ConfigError: a parameter that the node does not know, or a wrong value.
        DataError: the node's saved state cannot be read.
    """

    def __init__(self, kind: type[Node[Any]]) -> None:
        self.config = from_parameters(kind.defaults, rospy.get_param("~", {}))
        # Advertise before making the node, which may take long, so that subscribers find the
        # topics at once.
        self._publishers = {topic: self._publisher(topic, kind) for topic in kind.outputs}
        self._reports = rospy.Publisher(_REPORTS, message_class(DIAGNOSTICS), queue_size=10)
        self._sent = 0
        node = kind(self.config, self)
        self._worker = Worker(node, rospy.resolve_name, _now_ns, self._is_there, lambda: self._sent)
        self._subscribers: dict[str, rospy.Subscriber] = {}
        for topic in self._worker.inputs:
            self._subscribers[topic] = self._subscriber(topic)
        for service in node.services:
            self._offer(service)
        Registration().start()
        self._started = self._last_work = self._last_report = time.monotonic()
        self._looked_for_silence = False

    @property
    def inputs(self) -> Collection[str]:
        """The node's input topics."""
        return self._worker.inputs

    @property
    def problems(self) -> ProblemLog:
        """The node's problem log."""
        return self._worker.problems

    def publish(self, topic: str, message: Any) -> None:
        """As ``Outlet``."""
        _send(self._publishers[topic], message)
        self._sent += 1

    def is_wanted(self, topic: str) -> bool:
        """As ``Outlet``."""
        return bool(self._publishers[topic].get_num_connections())

    def run(self) -> None:
        """Process messages until ROS shuts down, then let the node save its state."""
        for timer in self._worker.node.timers:
            threading.Thread(target=self._beat, args=[timer], name=timer.name, daemon=True).start()
        try:
            while not is_shutdown_requested():
                if self._worker.work(_POLL_S):
                    self._last_work = time.monotonic()
                self._look_at_clock(time.monotonic())
        finally:
            self._worker.cancel_calls()
            self._worker.run_guarded("closing", self._worker.node.close)

    def _look_at_clock(self, now: float) -> None:
        common = self.config.node
        if not self._worker.is_idle and now - self._last_work > common.idle:
            self._worker.idle()
        self._worker.keep()
        if not self._looked_for_silence and now - self._started > common.patience:
            self._looked_for_silence = True
            self._worker.log_silent()
        if now - self._last_report >= common.report:
            self._last_report = now
            self._worker.run_guarded(_REPORTS, self._report)

    def _report(self) -> None:
        _send(self._reports, diagnostics(self._worker))

    def _beat(self, timer: Timer) -> None:
        while not is_shutdown_requested():
            time.sleep(timer.period)
            self._worker.run_guarded(timer.name, lambda: timer.fire(_now_ns()))

    def _offer(self, service: Service) -> None:
        """Answer requests in the node's thread, as messages are processed there."""

        def answer(request: Any) -> Any:
            try:
                return self._worker.call(lambda: service.answer(request))
            except CancelledError:
                raise rospy.ServiceException("the node ends") from None
            except FusionSlamError as error:
                raise rospy.ServiceException(str(error)) from error

        rospy.Service(service.name, service_class(service.type), answer)

    def _publisher(self, topic: str, kind: type[Node[Any]]) -> rospy.Publisher:
        return rospy.Publisher(
            topic,
            message_class(kind.outputs[topic]),
            queue_size=self.config.node.queue,
            latch=topic in kind.latched,
        )

    def _subscriber(self, topic: str) -> rospy.Subscriber:
        """Subscribe with any type: with a wrong type rospy would just log repeated failures."""
        return rospy.Subscriber(
            topic,
            rospy.AnyMsg,
            self._enqueue,
            callback_args=topic,
            buff_size=BUFFER_BYTES,
            tcp_nodelay=True,
        )

    def _enqueue(self, message: Any, topic: str) -> None:
        # What the node itself publishes on /tf is no news.
        if message._connection_header.get("callerid") != rospy.get_name():
            self._worker.enqueue(message, topic)

    def _is_there(self, topic: str, publisher: str) -> bool:
        subscriber = self._subscribers.get(topic)
        connections = subscriber.impl.connections if subscriber is not None else []
        return any(line.callerid_pub == publisher and not line.done for line in connections)


def _now_ns() -> int:
    return int(rospy.Time.now().to_nsec())


def _send(publisher: rospy.Publisher, message: Any) -> None:
    try:
        publisher.publish(message)
    except rospy.ROSException:
        # Topics are closed before is_shutdown becomes true.
        if not is_shutdown_requested():
            raise
