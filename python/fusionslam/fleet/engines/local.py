# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Processes of this machine."""

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for

from fusionslam.fleet.chunk import Chunk
from fusionslam.fleet.engines import Work, WorkerDiedError

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class LocalEngine:
    """Processes, each with a chunk of its own; a new one takes the place of one that dies.

    Args:
        jobs: number of processes.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = max(jobs, 1)
        self._workers: list[_Worker] = []

    def run(
        self, chunks: Iterable[Chunk], work: Work
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        """Yield each chunk when it is done; as of ``Engine``."""
        waiting = iter(chunks)
        running: dict[Connection, tuple[_Worker, Chunk]] = {}
        free = [*self._workers]
        while True:
            while len(running) < self._jobs and (chunk := next(waiting, None)) is not None:
                worker = free.pop() if free else _Worker()
                if worker not in self._workers:
                    self._workers.append(worker)
                worker.begin(work, chunk)
                running[worker.connection] = worker, chunk
            if not running:
                return
            for ready in wait_for([*running]):
                assert isinstance(ready, Connection)
                worker, chunk = running.pop(ready)
                try:
                    error = ready.recv()
                except (EOFError, OSError):
                    self._workers.remove(worker)
                    error = WorkerDiedError(f"a worker died: {worker.end()}")
                else:
                    free.append(worker)
                yield chunk, error

    def close(self) -> None:
        """End the processes; what they work on is lost."""
        while self._workers:
            self._workers.pop().end()


class _Worker:
    """A process, and the way to it."""

    def __init__(self) -> None:
        # A fork of a process with threads, as NumPy's, may hang.
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with _one_thread():
            self._process.start()
        # Else the end of the process would not be seen.
        theirs.close()

    def begin(self, work: Work, chunk: Chunk) -> None:
        """Give it a chunk; its end is seen on the connection if it has died meanwhile."""
        with suppress(OSError):
            self.connection.send((work, chunk))

    def end(self) -> str:
        """Kill the process unless it has ended; return how it ended."""
        self._process.join(0.1)
        self._process.kill()
        self._process.join()
        status = self._process.exitcode or 0
        self._process.close()
        self.connection.close()
        return f"by signal {-status}" if status < 0 else f"with exit status {status}"


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes that are started compute with one thread each, as those of Ray do."""
    missing = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(missing, "1"))
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]


def _serve(connection: Connection) -> None:
    """Work on what comes until the driver ends."""
    _follow_driver()
    while True:
        try:
            work, chunk = connection.recv()
        except EOFError:
            return
        error: BaseException | None = None
        try:
            work(chunk)
        except Exception as problem:
            error = problem
        connection.send(_portable(error))


def _portable(error: BaseException | None) -> BaseException | None:
    """Return an error that can be sent to another process: not all can be pickled, and back."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _follow_driver() -> None:
    """Leave Ctrl-C to the driver, and end with it however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None
    sentinel = parent.sentinel

    def follow() -> None:
        wait_for([sentinel])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
