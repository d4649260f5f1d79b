# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pass delivered messages to a node, which keeps running whatever is wrong with one of them."""

import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from fusionslam.base.timer import Stopwatch
from fusionslam.datasets.bags.messages import is_known, stamp_of, value_of
from fusionslam.errors import DataError, FusionSlamError, ShapeError, cause_of
from fusionslam.ros.messages.library import ros_time, shown_type
from fusionslam.ros.runtime.message_queue import SECOND_PUBLISHER, TOO_MANY, Arrival, MessageQueue
from fusionslam.ros.runtime.node import Delivery, Input, Node
from fusionslam.sensors.messages import CameraInfo, FrameTransforms, Message

logger = logging.getLogger(__name__)

T = TypeVar("T")


class Worker:
    """Queues messages as they arrive and passes them to a node one after another.

    Args:
        node: processes the messages.
        full_name: returns the full name of a topic, after remapping.
        now_ns: returns the time by the clock of the stamps, which may be simulated; 0 if unknown.
        is_there: tells whether a topic's publisher still exists.
        sent: returns the number of messages that the node has published.

    Attributes:
        inputs: the node's inputs by topic.
        topics: full names of these topics, after remapping.
        queue: the waiting messages.
        problems: the node's problem log.
        watch: latencies, from the arrival of messages until what they led to is published.
        is_idle: whether nothing arrived since ``idle``.
    """

    def __init__(
        self,
        node: Node[Any],
        full_name: Callable[[str], str],
        now_ns: Callable[[], int],
        is_there: Callable[[str, str], bool] = lambda topic, publisher: True,
        sent: Callable[[], int] = lambda: 0,
    ) -> None:
        self.node, self._now_ns = node, now_ns
        self._common = node.config.node
        self.inputs = {each.topic: each for each in node.inputs}
        self.topics = {topic: full_name(topic) for topic in self.inputs}
        self.queue = MessageQueue(self._common.queue, self._common.only_one, is_there)
        self.problems, self.watch, self._sent = node.problems, Stopwatch(), sent
        self.is_idle = True
        self._calls: SimpleQueue[tuple[Future[Any], Callable[[], Any]]] = SimpleQueue()

    def call(self, action: Callable[[], T]) -> T:
        """Return what an action returns, or raise what it raises; called in any other thread.

        ``work`` runs it, before the messages that wait. Raises CancelledError if the node ends
        before.
        """
        future: Future[T] = Future()
        self._calls.put((future, action))
        return future.result()

    def cancel_calls(self) -> None:
        """Release the threads whose actions ``work`` did not run."""
        for future, _ in self._waiting_calls():
            future.cancel()

    def enqueue(self, delivery: Delivery, topic: str) -> None:
        """Queue a message as it was delivered; called in any thread."""
        sender = delivery.sender
        arrival = Arrival(topic, delivery, time.monotonic(), self._now_ns())
        entry = self.inputs[topic]
        is_many = entry.small or entry.shared
        lost = self.queue.put(arrival, delivery.publisher(entry), is_many=is_many)
        if lost == SECOND_PUBLISHER:
            first = self.queue.publisher_of(topic)
            self.problems.add(
                topic,
                f"two publishers, {first} and {sender}: messages of {sender} are dropped while the "
                "other one publishes; stop one of them, or remap its topic",
                SECOND_PUBLISHER,
            )
        elif lost == TOO_MANY:
            self.problems.add(
                topic,
                "messages arrive faster than they are processed: the oldest are dropped; publish "
                "fewer, let the node do less (docs/guides/ros.md), or raise ~node/queue",
                TOO_MANY,
            )

    def work(self, timeout_s: float) -> bool:
        """Process the message that waited longest; return False if none comes within the time."""
        for future, action in self._waiting_calls():
            try:
                future.set_result(action())
            except BaseException as error:  # for the thread that waits
                future.set_exception(error)
        arrival = self.queue.get(timeout_s)
        if arrival is None:
            return False
        self.is_idle = False
        before = self._sent()
        self.run_guarded(arrival.topic, lambda: self._take(arrival))
        if self._sent() > before:
            self.watch.add("latency", time.monotonic() - arrival.seconds)
        return True

    def keep(self) -> None:
        """Write changed state if due; called periodically, even if no messages arrive."""
        if self.node.saver is not None:
            self.run_guarded("keeping", self.node.saver.write_if_due)

    def idle(self) -> None:
        """Tell the node that nothing has arrived for a while."""
        self.is_idle = True
        self.run_guarded("silence", self.node.idle)

    @property
    def silent(self) -> list[Input]:
        """Required inputs that have not received anything."""
        taken = self.queue.taken
        return [each for each in self.inputs.values() if not (each.optional or taken[each.topic])]

    def log_silent(self) -> None:
        """Log the silent topics, and what to do."""
        for entry in self.silent:
            logger.warning(
                "nothing has arrived on %s: is it published, as %s, or must it be remapped "
                "(%s:=/its/name)?",
                self.topics[entry.topic],
                " or ".join(map(shown_type, entry.types)),
                entry.topic,
                extra={"cause": ("silent", entry.topic)},
            )

    def run_guarded(self, topic: str, action: Callable[[], None]) -> None:
        """Run an action; report any exception as a problem."""
        try:
            action()
        except (DataError, ShapeError) as error:
            self._report(topic, str(error), error)
        except FusionSlamError as error:
            self._report(topic, f"{type(error).__name__}: {error}", error)
        except Exception as error:
            if self._report(topic, f"a defect of fusionslam, please report it: {error!r}", error):
                logger.exception("%s", topic)

    def _waiting_calls(self) -> Iterator[tuple[Future[Any], Callable[[], Any]]]:
        with suppress(Empty):
            while True:
                yield self._calls.get_nowait()

    def _report(self, topic: str, problem: str, error: Exception) -> bool:
        # Errors from reading a message already begin with its topic.
        return self.problems.add(topic, problem.removeprefix(topic).lstrip(": "), *cause_of(error))

    def _take(self, arrival: Arrival) -> None:
        entry = self.inputs[arrival.topic]
        delivery = arrival.message
        if delivery.type not in entry.types:
            raise DataError(
                f"its type is {shown_type(delivery.type)}, expected "
                f"{' or '.join(map(shown_type, entry.types))}: remap {entry.topic} to the right "
                "topic",
                code="wrong-type",
                fields=(delivery.type,),
            )
        message = delivery.read()
        if not is_known(delivery.type):
            if self._common.stamps == "arrival":
                message.header.stamp = ros_time(self._arrival_ns(arrival))
            _need_stamp(stamp_of(message.header.stamp))
            entry.take(message)
            return
        try:
            read = value_of(message, delivery.type, entry.topic)
        except DataError as error:
            raise DataError(f"{error}; check its publisher, {delivery.sender}") from error
        value = self._stamp_value(read, arrival)
        if value is not None:
            entry.take(value)

    def _stamp_value(self, value: Message, arrival: Arrival) -> Message | None:
        """Return the value with the stamp in force; None for transforms if none has a stamp."""
        if isinstance(value, CameraInfo):  # its stamp is not used
            return value
        if isinstance(value, FrameTransforms):
            return self._stamp_transforms(value, arrival)
        if self._common.stamps == "arrival":
            return replace(value, stamp_ns=self._arrival_ns(arrival))
        _need_stamp(value.stamp_ns)
        return value

    def _stamp_transforms(self, value: FrameTransforms, arrival: Arrival) -> FrameTransforms | None:
        each = value.transforms
        if self._common.stamps == "arrival" and not all(one.static for one in each):
            now = self._arrival_ns(arrival)
            each = tuple(one if one.static else replace(one, stamp_ns=now) for one in each)
        kept = tuple(one for one in each if one.static or one.stamp_ns)
        if len(kept) < len(each):
            lost = next(one for one in each if not (one.static or one.stamp_ns))
            self.problems.add(
                arrival.topic,
                f"the transform of '{lost.child}' has the stamp zero and is left out: its "
                "publisher has to stamp it",
                "no-stamp",
                lost.child,
            )
        return FrameTransforms(transforms=kept) if kept else None

    def _arrival_ns(self, arrival: Arrival) -> int:
        if not arrival.stamp_ns:
            raise DataError(
                "~node/stamps is arrival, but there is no time: /use_sim_time is true and nothing "
                "publishes /clock; play the bag with --clock, or set /use_sim_time to false",
                code="no-clock",
            )
        return arrival.stamp_ns


def _need_stamp(stamp_ns: int) -> None:
    if not stamp_ns:
        raise DataError(
            "the stamp is zero: its publisher has to stamp it, or set the parameter ~node/stamps "
            "to arrival",
            code="no-stamp",
        )
