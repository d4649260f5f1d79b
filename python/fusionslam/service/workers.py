# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Threads for what takes long, so that the event loop stays free."""

import asyncio
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from fusionslam.service.problems import RequestError
from fusionslam.storage.parallel import available_cores

T = TypeVar("T")


class Workers:
    """A pool of threads, and a bound on the requests that wait for one.

    Args:
        threads: number of them; 0 is one a core.
        most: requests that are worked on or wait, their bodies on the way included.

    Attributes:
        threads: number of them.
        busy: requests that are worked on or wait now.
    """

    def __init__(self, threads: int, most: int) -> None:
        self.threads = threads or available_cores()
        self._pool = ThreadPoolExecutor(self.threads, "fusionslam-service")
        self._most = most
        self.busy = 0

    @contextmanager
    def place(self) -> Iterator[None]:
        """Take a place among the requests that are worked on, for the block.

        Raises:
            RequestError: 503, all places are taken.
        """
        if self.busy >= self._most:
            raise RequestError(
                503,
                f"{self.busy} requests wait already; try again later",
                code="busy",
                fields=(str(self._most),),
                headers={"Retry-After": "1"},
            )
        self.busy += 1
        try:
            yield
        finally:
            self.busy -= 1

    async def run(self, work: Callable[[], T]) -> T:
        """Call a function in a thread of the pool."""
        return await asyncio.get_running_loop().run_in_executor(self._pool, work)

    def close(self) -> None:
        """Finish what is worked on; what waits is dropped."""
        self._pool.shutdown(wait=True, cancel_futures=True)
