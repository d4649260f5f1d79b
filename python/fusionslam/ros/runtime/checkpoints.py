# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a node keeps in a file, while it runs and when it ends."""

import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fusionslam.config import Section, option
from fusionslam.errors import ConfigError, DataError
from fusionslam.ros.runtime.problem_log import ProblemLog
from fusionslam.storage.files import made_folder

logger = logging.getLogger(__name__)

_NAME = "~memory/file"
_ADVICE = "nothing is kept until it can be written: make room, allow it, or give another file"


class SavingConfig(Section):
    """Where a node keeps what it knows."""

    file: str = option("", "the file, with which the node goes on at its next start; empty: none")
    every: float = option(
        10.0,
        "between two writings while something changes; a node that is killed loses no more",
        unit="s",
        gt=0,
    )


@contextmanager
def continued(path: Path) -> Iterator[None]:
    """Reads what a node goes on from. Raises DataError, which says what to do besides."""
    try:
        yield
    except DataError as error:
        raise DataError(
            f"cannot go on from {_NAME}: {error}; move {path} away, or give another one"
        ) from error


def other_settings(name: str, path: Path) -> ConfigError:
    """What to raise where a file was made with other parameters than the node has."""
    return ConfigError(
        f"~{name} differs from what {path} was made with: set it as it was, move the file away, "
        f"or give another {_NAME}"
    )


class Saver:
    """Writes a file now and then, and at the end; where that fails, it says so and tries again.

    Args:
        config: which file, how often.
        save: writes it, whole or not at all; raises DataError.
        problems: those of the node.
    """

    def __init__(
        self, config: SavingConfig, save: Callable[[Path], None], problems: ProblemLog
    ) -> None:
        self._config, self._save, self._problems = config, save, problems
        self._saved, self._is_changed = time.monotonic(), False
        if self.path is not None:
            self._try(self.path)

    @property
    def path(self) -> Path | None:
        """The file; None where nothing is kept."""
        return Path(self._config.file).expanduser() if self._config.file else None

    @property
    def kept(self) -> Path | None:
        """What there is to go on from; None where there is nothing, or an empty folder."""
        path = self.path
        # Path.exists raises where a folder on the way must not be entered.
        if path is None or not os.path.exists(path):
            return None
        return None if path.is_dir() and not any(path.iterdir()) else path

    def changed(self) -> None:
        """Something changed: write it if the last writing is long ago."""
        self._is_changed = True
        self.write_if_due()

    def write_if_due(self) -> None:
        """Write what changed since the last writing, if that is long ago."""
        if time.monotonic() - self._saved >= self._config.every:
            self.write()

    def close(self) -> None:
        """Write what changed since the last writing: nothing comes after it."""
        self.write()
        if self.path is not None and self._is_changed:
            logger.error("%s: what is new since the last writing is lost", self.path)

    def write(self) -> None:
        """Write what changed since the last writing."""
        if self.path is None or not self._is_changed:
            return
        # Before it is tried: a disk that is full is not asked again at once.
        self._saved = time.monotonic()
        try:
            self._save(self.path)
        except DataError as error:
            self._complain(self.path, error)
            return
        self._is_changed = False
        logger.debug("kept %s", self.path)

    def _try(self, path: Path) -> None:
        """Whether something can be written there is known before the robot drives off."""
        try:
            with made_folder(path.parent):
                pass
        except DataError as error:
            self._complain(path, error)

    def _complain(self, path: Path, error: Exception) -> None:
        # The cause stands on a line of its own: it may name files that are made on the way.
        self._problems.add(_NAME, f"cannot write {path}: {_ADVICE}\n{error}", "cannot-write")
