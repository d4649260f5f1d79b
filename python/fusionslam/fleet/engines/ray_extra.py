# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ray, of the extra ``fleet``: workers of this machine or of a cluster."""

import os
from collections.abc import Iterator, Sequence
from typing import Any

from fusionslam.errors import DataError, FusionSlamError
from fusionslam.fleet.chunk import Chunk
from fusionslam.fleet.engines import Work, WorkerDiedError

_STORE_BYTES = 200_000_000
"""Of objects between workers: only names of chunks pass, clouds stay in files."""


def load() -> Any:
    """Ray's module.

    Raises:
        FusionSlamError: it is not installed (code "missing-extra").
    """
    # No statistics are sent anywhere.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise FusionSlamError(
            f"--engine ray needs Ray, which is not installed ({error}): "
            "pip install 'fusionslam[fleet]'",
            code="missing-extra",
            fields=("fleet",),
        ) from error
    return ray


class RayEngine:
    """Workers that Ray starts again when they die, elsewhere if their machine is lost.

    All machines need fusionslam, and recordings and results under the same paths.

    Args:
        jobs: number of workers, one core each.
        address: of a cluster, "ray://HOST:PORT"; None for that which RAY_ADDRESS names, else for
            one of this machine that ends with the engine.
    """

    def __init__(self, jobs: int, address: str | None = None) -> None:
        self._ray = load()
        _connect(self._ray, jobs, address)
        # Tries are counted by the caller, so Ray makes none of its own.
        worker = self._ray.remote(num_cpus=1, max_restarts=-1, max_task_retries=0)(_Worker)
        self._workers = [worker.remote() for _ in range(max(jobs, 1))]

    def run(
        self, chunks: Sequence[Chunk], work: Work, *, alone: bool = False
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        """Yield each chunk when it is done; as of ``Engine``."""
        waiting = list(reversed(chunks))
        free = self._workers[:1] if alone else [*self._workers]
        running: dict[Any, tuple[Chunk, Any]] = {}
        while waiting or running:
            while waiting and free:
                worker, chunk = free.pop(), waiting.pop()
                running[worker.run.remote(work, chunk)] = chunk, worker
            (done,), _ = self._ray.wait([*running], num_returns=1)
            chunk, worker = running.pop(done)
            free.append(worker)
            yield chunk, self._error_of(done)

    def _error_of(self, done: Any) -> BaseException | None:
        errors = self._ray.exceptions
        try:
            return self._ray.get(done)  # type: ignore[no-any-return]
        except errors.RayActorError as error:
            return WorkerDiedError(f"a worker died: {str(error).splitlines()[0]}")
        except errors.RayTaskError as error:
            cause: BaseException = error.cause
            return cause

    def close(self) -> None:
        """End the workers, and Ray if it was started for them."""
        for worker in self._workers:
            self._ray.kill(worker)
        self._ray.shutdown()


class _Worker:
    """Keeps recordings open from one chunk to the next."""

    def run(self, work: Work, chunk: Chunk) -> None:
        work(chunk)


def _connect(ray: Any, jobs: int, address: str | None) -> None:
    """Connect to a cluster, or start one of this machine."""
    how: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    if address is None and "RAY_ADDRESS" not in os.environ:
        how |= {
            "num_cpus": max(jobs, 1),
            "include_dashboard": False,
            "object_store_memory": _STORE_BYTES,
        }
    try:
        ray.init(address=address, **how)
    except (ConnectionError, RuntimeError, ValueError) as error:
        where = address or os.environ.get("RAY_ADDRESS", "this machine")
        raise DataError(
            f"no Ray cluster at {where}: {error}; expected one that ray start --head began",
            code="no-cluster",
            fields=(where,),
        ) from error
