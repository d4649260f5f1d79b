# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Save a node's state to a file, while it runs and when it ends."""

import logging
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from fusionslam.base.files import make_folder
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError, DataError
from fusionslam.ros.runtime.problem_log import ProblemLog

logger = logging.getLogger(__name__)

Settings = Mapping[str, object]
_NAME = "~memory/file"
_ADVICE = "nothing is stored until it can be written: free space, allow it, or give another file"


class SavingConfig(Section):
    """Where a node saves its state."""

    file: str = option("", "file from which the node resumes at its next start; empty: none")
    every: float = option(
        10.0,
        "time between two writes while the state changes; a killed node loses no more",
        unit="s",
        gt=0,
    )


class Saver:
    """Writes a file periodically and at the end; reports failures and tries again.

    Args:
        config: which file, how often.
        save: writes the file atomically; raises DataError.
        problems: the node's problem log.
    """

    def __init__(
        self, config: SavingConfig, save: Callable[[Path], None], problems: ProblemLog
    ) -> None:
        self._config, self._save, self._problems = config, save, problems
        self._saved, self._is_changed = time.monotonic(), False
        if self.path is not None:
            # Before the robot drives off.
            try:
                with make_folder(self.path.parent):
                    pass
            except DataError as error:
                self._report_failure(self.path, error)

    @property
    def path(self) -> Path | None:
        """The file; None if nothing is saved."""
        return Path(self._config.file).expanduser() if self._config.file else None

    def resume(self, load: Callable[[Path], Settings], wanted: Settings) -> None:
        """Load the saved state, if there is one.

        Args:
            load: loads a file, and returns the parameters that it was made with.
            wanted: the node's parameters.

        Raises:
            DataError: the file cannot be read.
            ConfigError: it was made with other parameters.
        """
        path = self.path
        # Path.exists raises if a parent folder is not accessible.
        if path is None or not os.path.exists(path) or (path.is_dir() and not any(path.iterdir())):
            return
        try:
            stored = load(path)
        except DataError as error:
            raise DataError(
                f"cannot resume from {_NAME}: {error}; move {path} away, or give another one",
                code="bad-state",
            ) from error
        for name, value in stored.items():
            if value != wanted[name]:
                raise ConfigError(
                    f"~{name} differs from what {path} was made with: set it as it was, move the "
                    f"file away, or give another {_NAME}",
                    code="other-settings",
                    fields=(f"~{name}",),
                )
        logger.info("resumed from %s", path)

    def note_change(self) -> None:
        """Note that the state changed; write it if a write is due."""
        self._is_changed = True
        self.write_if_due()

    def write_if_due(self) -> None:
        """Write changes if the last write is long enough ago."""
        if time.monotonic() - self._saved >= self._config.every:
            self.write()

    def close(self) -> None:
        """Write the last changes; log an error if they cannot be written."""
        self.write()
        if self.path is not None and self._is_changed:
            words = "%s: the changes since it was last written are lost"
            logger.error(words, self.path, extra={"cause": ("lost",)})

    def write(self) -> None:
        """Write changes since the last write, if there are any."""
        if self.path is None or not self._is_changed:
            return
        # Set before the attempt, so that a full disk is not tried again at once.
        self._saved = time.monotonic()
        try:
            self._save(self.path)
        except DataError as error:
            self._report_failure(self.path, error)
            return
        self._is_changed = False
        logger.debug("wrote %s", self.path)

    def _report_failure(self, path: Path, error: Exception) -> None:
        # The cause is on its own line, as it may name temporary files.
        self._problems.add(_NAME, f"cannot write {path}: {_ADVICE}\n{error}", "cannot-write")
