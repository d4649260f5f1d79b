# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Connections that clients cannot keep for nothing, beyond what uvicorn limits itself."""

import asyncio
import resource
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

from fusionslam.service.config import ServiceConfig

_OTHER_FILES = 1000
"""That the process may open beside its connections."""


class Connection(H11Protocol):
    """A connection that is closed if no whole head of a request comes in time.

    If there are more than ``max_connections``, that which has waited longest for a head makes
    room, first of those that have sent none yet.
    """

    def __init__(self, limits: ServiceConfig, **parts: Any) -> None:
        super().__init__(**parts)
        self._limits = limits
        self._since = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a head."""
        super().connection_made(transport)
        self._expect_head()
        if len(self.connections) > self._limits.max_connections:
            others = [each for each in self.connections if isinstance(each, Connection)]
            waiting = [each for each in others if each is not self and each._waits]
            first = min(
                waiting, key=lambda each: (each.cycle is not None, each._since), default=self
            )
            self.connections.discard(first)  # at once: more may come before it is lost
            first.transport.abort()

    def on_response_complete(self) -> None:
        """Begin to wait for the next head."""
        super().on_response_complete()
        self._expect_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """End the wait."""
        super().connection_lost(exc)
        if self._timer is not None:
            self._timer.cancel()

    @property
    def _waits(self) -> bool:
        """Whether no request is worked on."""
        return self.cycle is None or self.cycle.response_complete

    def _expect_head(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._since = self.loop.time()
        self._timer = self.loop.call_later(self._limits.head_timeout_s, self._close_if_waiting)

    def _close_if_waiting(self) -> None:
        if self._waits:
            self.transport.abort()


def allow_connections(count: int) -> None:
    """Raise the limit of open files so that this number of connections fits, if it may be."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = count + _OTHER_FILES
    if soft != resource.RLIM_INFINITY and soft < wanted:
        wanted = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
