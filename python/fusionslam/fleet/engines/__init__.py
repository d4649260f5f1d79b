# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What runs the work: processes of this machine, or Ray on one machine or many."""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet.chunk import Chunk

Work = Callable[[Chunk], None]
ENGINES = ("local", "ray", "ray://HOST:PORT")


class WorkerDiedError(DataError):
    """The process that worked on a chunk ended, as by a crash or a kill."""

    code = "worker-died"


class Engine(Protocol):
    """Runs work on chunks, in any order."""

    def run(
        self, chunks: Sequence[Chunk], work: Work, *, alone: bool = False
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        """Yield each chunk once when it is done, with the error that it ended with, if any.

        A worker that dies takes no other with it; its chunk has a ``WorkerDiedError``, and so may
        have chunks that were worked on at the same time.

        Args:
            chunks: to work on.
            work: called with each in a worker; can be pickled.
            alone: one at a time, so that it is certain which one a worker died of.
        """

    def close(self) -> None:
        """End the workers."""


def check_engine(name: str) -> None:
    """Raise ConfigError unless an engine has this name (code "choice")."""
    if name not in ("local", "ray") and not name.startswith("ray://"):
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
