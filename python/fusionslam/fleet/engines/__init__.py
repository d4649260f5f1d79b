# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What runs the work: processes of this machine, or Ray on one machine or many."""

import re
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol

from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet.chunk import Chunk

Work = Callable[[Chunk], None]
ENGINES = ("local", "ray", "ray://HOST:PORT")
_CLUSTER = re.compile(r"ray://[^/\s]+:\d{1,5}")


class WorkerDiedError(DataError):
    """The process that worked on a chunk ended, as by a crash or a kill."""

    code = "worker-died"


class Engine(Protocol):
    """Runs work on chunks, in any order."""

    def run(
        self, chunks: Iterable[Chunk], work: Work
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        """Yield each chunk once when it is done, with the error that it ended with, if any.

        Each worker has one chunk at a time: if it dies, that chunk alone has a
        ``WorkerDiedError``, and another worker takes its place.

        Args:
            chunks: to work on; the next one is taken when a worker is free.
            work: called with each in a worker; can be pickled.

        Raises:
            DataError: there are no workers any more (code "no-workers").
        """

    def close(self) -> None:
        """End the workers; what they work on is lost."""


def check_engine(name: str) -> None:
    """Raise ConfigError unless an engine has this name (code "choice")."""
    if name not in ("local", "ray") and not _CLUSTER.fullmatch(name):
        raise ConfigError(
            f"--engine is {name!r}: expected one of {', '.join(ENGINES)}",
            code="choice",
            fields=("--engine", name),
        )


def open_engine(name: str, jobs: int) -> Engine:
    """Return an engine.

    Args:
        name: "local", "ray" for this machine (or the cluster that RAY_ADDRESS names), or
            "ray://HOST:PORT" for a cluster.
        jobs: number of workers.

    Raises:
        ConfigError: an unknown engine.
        FusionSlamError: Ray is not installed (code "missing-extra").
        DataError: the cluster cannot be reached (code "no-cluster").
    """
    check_engine(name)
    if name == "local":
        from fusionslam.fleet.engines.local import LocalEngine

        return LocalEngine(jobs)
    from fusionslam.fleet.engines.ray_extra import RayEngine

    return RayEngine(jobs, None if name == "ray" else name)
