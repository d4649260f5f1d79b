# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Run a node on a middleware: subscribe, publish, report diagnostics and end cleanly."""

import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from fusionslam.errors import FusionSlamError
from fusionslam.ros.messages.types import DIAGNOSTICS
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.ros.runtime.diagnostics import REPORTS, diagnostics
from fusionslam.ros.runtime.node import Node, Timer, Transport
from fusionslam.ros.runtime.problem_log import ProblemLog
from fusionslam.ros.runtime.worker import Worker

_WRONG, _INTERRUPTED = 2, 130
_POLL_S = 0.1
_CLOSING_S = 5.0
_REPORTS_QUEUE = 10


@contextmanager
def exit_on_errors(name: str, words: Callable[[str], str] = str) -> Iterator[None]:
    """Turn known errors of a node that starts into one line and an exit status.

    Args:
        name: of the node.
        words: translates the line of an error to the names of a middleware.

    Raises:
        SystemExit: 2 if the node cannot start, 130 if it is interrupted.
    """
    try:
        yield
    except FusionSlamError as error:
        print(words(f"error: {name}: {error}"), file=sys.stderr)
        raise SystemExit(_WRONG) from error
    except KeyboardInterrupt as error:
        print(f"{name}: interrupted", file=sys.stderr)
        raise SystemExit(_INTERRUPTED) from error


class NodeRunner:
    """Runs one node until its middleware shuts down.

    Args:
        kind: the node's class.
        transport: its node of the middleware.

    Raises:
        ConfigError: a parameter that the node does not know, or a wrong value.
        DataError: the node's saved state cannot be read.
    """

    def __init__(self, kind: type[Node[Any]], transport: Transport) -> None:
        self._transport = transport
        self.config = from_parameters(kind.defaults, transport.parameters)
        # Advertise before making the node, which may take long, so that subscribers find the
        # topics at once.
        queue = self.config.node.queue
        self._publishers = {
            topic: transport.advertise(topic, name, queue=queue, latched=topic in kind.latched)
            for topic, name in kind.outputs_of(self.config).items()
        }
        self._reports = transport.advertise(
            REPORTS, DIAGNOSTICS, queue=_REPORTS_QUEUE, latched=False
        )
        self._sent = 0
        node = kind(self.config, self)
        self._worker = Worker(
            node,
            transport.full_name,
            transport.now_ns,
            transport.has_publisher,
            lambda: self._sent,
        )
        limit_of = self._worker.queue.limit_of
        for topic, entry in self._worker.inputs.items():
            take = partial(self._worker.enqueue, topic=topic)
            transport.subscribe(entry, take, queue=limit_of(is_many=entry.small or entry.shared))
        for service in node.services:
            transport.offer(service, self._worker.call)
        self._started = self._last_report = time.monotonic()
        self._silence_s = 0.0
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
        self._publishers[topic].publish(message)
        self._sent += 1

    def is_wanted(self, topic: str) -> bool:
        """As ``Outlet``."""
        return self._publishers[topic].subscriptions() > 0

    def run(self) -> None:
        """Process messages until the middleware shuts down, then let the node save its state."""
        has_ended = threading.Event()
        beats = [
            threading.Thread(
                target=self._beat, args=[timer, has_ended], name=timer.name, daemon=True
            )
            for timer in self._worker.node.timers
        ]
        for each in beats:
            each.start()
        try:
            while not self._transport.is_shut_down():
                # By what this process waited: a machine that holds it up is no silence.
                is_silent = not self._worker.work(_POLL_S)
                self._silence_s = self._silence_s + _POLL_S if is_silent else 0.0
                self._look_at_clock(time.monotonic())
        finally:
            has_ended.set()
            for each in beats:  # which publish, and the middleware's publishers go soon
                each.join(_CLOSING_S)
            self._worker.cancel_calls()
            for _ in range(self._worker.queue.waiting):  # what came before the end, and no more
                self._worker.work(0.0)
            self._worker.run_guarded("closing", self._worker.node.close)

    def _look_at_clock(self, now: float) -> None:
        common = self.config.node
        if not self._worker.is_idle and self._silence_s > common.idle:
            self._worker.idle()
        self._worker.keep()
        if not self._looked_for_silence and now - self._started > common.patience:
            self._looked_for_silence = True
            self._worker.log_silent()
        if now - self._last_report >= common.report:
            self._last_report = now
            self._worker.run_guarded(REPORTS, self._report)

    def _report(self) -> None:
        reached = {
            self._transport.full_name(topic): each.subscriptions()
            for topic, each in self._publishers.items()
        }
        transport = self._transport
        self._reports.publish(
            diagnostics(self._worker, transport.name, transport.now_ns(), reached)
        )

    def _beat(self, timer: Timer, has_ended: threading.Event) -> None:
        while not has_ended.wait(timer.period) and not self._transport.is_shut_down():
            self._worker.run_guarded(timer.name, lambda: timer.fire(self._transport.now_ns()))
