# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Processes of this machine."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for

from fusionslam.fleet.chunk import Chunk
from fusionslam.fleet.engines import Work, WorkerDiedError

Running = dict["Future[None]", Chunk]


class LocalEngine:
    """A pool of processes; a new one takes its place if one of them dies.

    Args:
        jobs: number of processes.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = max(jobs, 1)
        self._pool: ProcessPoolExecutor | None = None

    def run(
        self, chunks: Sequence[Chunk], work: Work, *, alone: bool = False
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        """Yield each chunk when it is done; as of ``Engine``."""
        waiting = list(reversed(chunks))
        running: Running = {}
        # One more than there are workers, so that none waits for the next.
        most = 1 if alone else self._jobs + 1
        while waiting or running:
            while waiting and len(running) < most and self._begin(waiting, running, work):
                pass
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), self._error_of(future)

    def _begin(self, waiting: list[Chunk], running: Running, work: Work) -> bool:
        """Submit the next chunk; false if the pool has just broken and others are to be heard."""
        if self._pool is None:
            self._pool = _new_pool(self._jobs)
        try:
            future = self._pool.submit(work, waiting[-1])
        except BrokenProcessPool:
            if not running:
                self.close()
            return not running
        running[future] = waiting.pop()
        return True

    def _error_of(self, future: "Future[None]") -> BaseException | None:
        error = future.exception()
        if isinstance(error, BrokenProcessPool):
            self.close()
            return WorkerDiedError("a worker died: it crashed or was killed")
        return error

    def close(self) -> None:
        """End the processes; what they work on is lost."""
        if self._pool is None:
            return
        pool, self._pool = self._pool, None
        processes = [*(pool._processes or {}).values()]
        for process in processes:
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


def _new_pool(jobs: int) -> ProcessPoolExecutor:
    # A fork of a process with threads, as NumPy's, may hang.
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin_worker)


def _begin_worker() -> None:
    """Leave Ctrl-C to the driver, and end with it however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    sentinel = parent.sentinel

    def follow() -> None:
        wait_for([sentinel])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
