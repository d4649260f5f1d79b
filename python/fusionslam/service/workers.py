# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Threads for what takes long, so that the event loop stays free."""

import asyncio
import os
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager
from typing import TypeVar

from fusionslam.base.parallel import available_cores
from fusionslam.service.problems import RequestError

T = TypeVar("T")


class Room:
    """Places that requests take for a time, so many of all and so many of each client.

    Args:
        most: of all.
        most_of_one: of one client.

    Attributes:
        taken: places that are taken now.
    """

    def __init__(self, most: int, most_of_one: int) -> None:
        self._most, self._most_of_one = most, most_of_one
        self.taken = 0
        self._clients: Counter[str] = Counter()

    def check(self, client: str) -> None:
        """Say at once whether there is a place now.

        Raises:
            RequestError: 503, all places are taken, or all of this client.
        """
        own = self._clients[client], self._most_of_one
        for taken, most in ((self.taken, self._most), own):
            if taken >= most:
                raise RequestError(
                    503,
                    f"{taken} requests wait already; try again later",
                    code="busy",
                    fields=(str(most),),
                    headers={"Retry-After": "1"},
                )

    @contextmanager
    def place(self, client: str) -> Iterator[None]:
        """Take a place for the block. Raises as ``check``."""
        self.check(client)
        self.taken += 1
        self._clients[client] += 1
        try:
            yield
        finally:
            self.taken -= 1
            self._clients[client] -= 1
            if not self._clients[client]:
                del self._clients[client]


class Workers:
    """A pool of threads, which clients get in turn, however many requests one of them has.

    Args:
        threads: number of them; 0 is one a core.
        niceness: by which all other threads go before them on busy cores, 0 to 19 (nice(7)).

    Attributes:
        threads: number of them.
    """

    def __init__(self, threads: int, niceness: int = 0) -> None:
        self.threads = threads or available_cores()
        self._pool = ThreadPoolExecutor(
            self.threads, "fusionslam-service", initializer=_be_nice, initargs=(niceness,)
        )
        self._free = self.threads
        self._turns: dict[str, deque[asyncio.Future[None]]] = {}

    async def run(self, work: Callable[[], T], client: str = "") -> T:
        """Call a function in a thread of the pool, when it is the client's turn."""
        async with self._turn(client):
            return await asyncio.get_running_loop().run_in_executor(self._pool, work)

    def close(self) -> None:
        """Finish what is worked on; what waits is dropped."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    @asynccontextmanager
    async def _turn(self, client: str) -> AsyncIterator[None]:
        if self._free:
            self._free -= 1
        else:
            turn = asyncio.get_running_loop().create_future()
            self._turns.setdefault(client, deque()).append(turn)
            try:
                await turn
            except asyncio.CancelledError:
                if turn.done() and not turn.cancelled():
                    self._pass_on()
                raise
        try:
            yield
        finally:
            self._pass_on()

    def _pass_on(self) -> None:
        """Give a thread that is free to the client that has waited longest since its last turn."""
        while self._turns:
            client = next(iter(self._turns))
            queue = self._turns.pop(client)
            turn = queue.popleft()
            if queue:
                self._turns[client] = queue
            if not turn.done():
                turn.set_result(None)
                return
        self._free += 1


def _be_nice(niceness: int) -> None:
    """Let other threads go before this one; Linux has a niceness of threads, not of processes."""
    if niceness:
        os.setpriority(os.PRIO_PROCESS, 0, os.getpriority(os.PRIO_PROCESS, 0) + niceness)
