# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ray, of the extra ``fleet``: workers of this machine or of a cluster."""

import os
import shutil
import socket
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from fusionslam.errors import DataError, needing, one_line
from fusionslam.fleet.chunk import Chunk
from fusionslam.fleet.engines import Work, WorkerDiedError

_STORE_BYTES = 200_000_000
"""Of objects between workers: only names of chunks pass, clouds stay in files."""
_PATIENCE_S = 300.0
"""How long a cluster may take to give us a first worker, or another one after all were lost. On two
cores with ten busy processes a worker has taken more than one minute to start."""
_AUTH = "RAY_AUTH_MODE"
_CONSTANTS = "ray._private.ray_constants"
_FAILED_STARTS = 5
"""Workers in a row that cannot be started, after which no more are."""


def load(address: str | None = None) -> Any:
    """Ray's module, with what connecting to an address takes.

    Raises:
        FusionSlamError: it is not installed (code "missing-extra").
    """
    # No statistics are sent anywhere.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    with needing("fleet", f"--engine {address or 'ray'} needs Ray"):
        if address is not None and address.startswith("ray://"):
            import_module("grpc")  # of ray[client]
        import ray
    return ray


class RayEngine:
    """Workers of Ray; another one takes the place of one that dies, elsewhere if its node is lost.

    All machines need fusionslam, and recordings and results under the same paths.

    Args:
        jobs: number of workers, one core each.
        address: of a cluster, "ray://HOST:PORT"; None for that which RAY_ADDRESS names, else for
            one of this machine that ends with the engine.
    """

    def __init__(self, jobs: int, address: str | None = None) -> None:
        self._left = ExitStack()  # what is put back and deleted at the end
        with self._left:
            # ``ray get-auth-token`` puts a token there, or the user says where it is.
            names = ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH")
            is_home = (Path.home() / ".ray" / "auth_token").exists()
            has_token = is_home or any(name in os.environ for name in names)
            if address is not None and _AUTH not in os.environ and has_token:
                # Clusters ask for the token by default, its clients only then give it.
                os.environ[_AUTH] = "token"
                self._left.callback(os.environ.pop, _AUTH, None)
            self._ray = load(address)
            _connect(self._ray, jobs, address, self._left)
            self._left = self._left.pop_all()
        # Tries are counted by the caller, so Ray makes none of its own.
        self._class = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_Worker)
        self._free: list[Any] = []
        self._starting: dict[Any, Any] = {}
        self._failed_starts = 0
        for _ in range(max(jobs, 1)):
            self._start()

    def run(
        self, chunks: Iterable[Chunk], work: Work
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        """Yield each chunk when it is done; as of ``Engine``."""
        waiting = iter(chunks)
        chunk = next(waiting, None)
        running: dict[Any, tuple[Chunk, Any]] = {}
        while chunk is not None or running:
            while chunk is not None and self._free:
                worker = self._free.pop()
                running[worker.run.remote(work, chunk)] = chunk, worker
                chunk = next(waiting, None)
            done, _ = self._ray.wait([*running, *self._starting], timeout=_PATIENCE_S)
            if not done and not running:
                raise _no_workers("no node has had a free core for a worker")
            for each in done:
                if each in self._starting:
                    self._take_in(each)
                    continue
                finished, worker = running.pop(each)
                error = self._error_of(each)
                if isinstance(error, WorkerDiedError):
                    self._start()
                else:
                    self._free.append(worker)
                yield finished, error

    def _start(self) -> None:
        worker = self._class.remote()
        self._starting[worker.ready.remote()] = worker

    def _take_in(self, ready: Any) -> None:
        """Use a worker that has started, or start another one instead."""
        worker = self._starting.pop(ready)
        error = self._error_of(ready)
        if error is None:
            self._failed_starts = 0
            self._free.append(worker)
            return
        self._failed_starts += 1
        if self._failed_starts >= _FAILED_STARTS:
            raise _no_workers(f"workers cannot be started: {error}")
        self._start()

    def _error_of(self, done: Any) -> BaseException | None:
        errors = self._ray.exceptions
        try:
            return self._ray.get(done)  # type: ignore[no-any-return]
        except errors.RayTaskError as error:
            cause: BaseException = error.cause
            return cause
        except errors.RayError as error:  # its process, its node or its result was lost
            first = (str(error).splitlines() or [type(error).__name__])[0]
            return WorkerDiedError(f"a worker died: {first}")

    def close(self) -> None:
        """End the workers, and Ray if it was started for them."""
        for worker in [*self._free, *self._starting.values()]:
            with suppress(Exception):  # the cluster may be lost
                self._ray.kill(worker)
        self._free.clear()
        self._starting.clear()
        # Ends those that are at work, too: nothing outlives the driver that it belongs to.
        self._ray.shutdown()
        self._left.close()


class _Worker:
    """Keeps recordings open from one chunk to the next."""

    def ready(self) -> None:
        """Do nothing, successfully."""

    def run(self, work: Work, chunk: Chunk) -> None:
        work(chunk)


def _no_workers(why: str) -> DataError:
    return DataError(f"Ray has no workers for us: {why}", code="no-workers", fields=("ray",))


def _connect(ray: Any, jobs: int, address: str | None, left: ExitStack) -> None:
    """Connect to a cluster, or start one of this machine, whose files go with the stack."""
    how: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    where = address or os.environ.get("RAY_ADDRESS")
    if where is None:
        # Ray lets everybody write to its folder, so that is put in one for this user alone.
        # Names of its sockets have at most 107 bytes.
        folder = tempfile.mkdtemp(prefix="fsl-", dir=os.environ.get("RAY_TMPDIR"))
        left.callback(shutil.rmtree, folder, ignore_errors=True)
        how |= {
            "address": "local",  # never another cluster that happens to run here
            "_temp_dir": f"{folder}/r",
            "num_cpus": max(jobs, 1),
            "include_dashboard": False,
            "object_store_memory": _STORE_BYTES,
        }
    else:
        how["address"] = where
        _check_reachable(where)
    try:
        with nullcontext() if where else _on_loopback():
            ray.init(**how)
    except (OSError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        raise _no_cluster(where or "this machine", error) from error


@contextmanager
def _on_loopback() -> Iterator[None]:
    """Let a Ray that starts listen on 127.0.0.1, not to the network, as it does on macOS."""
    name = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
    constants: Any = import_module(_CONSTANTS)
    before, constants.ENABLE_RAY_CLUSTER = constants.ENABLE_RAY_CLUSTER, False
    os.environ[name] = "0"  # for the processes of it
    try:
        yield
    finally:
        constants.ENABLE_RAY_CLUSTER = before
        del os.environ[name]


def _check_reachable(address: str) -> None:
    """Find out in seconds that nothing listens; Ray itself takes minutes, or ends the process."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon or not port.isdecimal():  # as "auto"
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=10).close()
    except (OSError, OverflowError) as error:
        raise _no_cluster(address, error) from error


def _no_cluster(where: str, error: Exception) -> DataError:
    return DataError(
        f"no Ray cluster at {where}: {one_line(error)}; expected one that ray start --head began, "
        "and its token here if it has one (ray get-auth-token)",
        code="no-cluster",
        fields=(where,),
    )
