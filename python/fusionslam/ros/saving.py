# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a node keeps in a file, while it runs and when it ends."""

import logging
import time
from collections.abc import Callable
from pathlib import Path

from fusionslam.config import Section, option

logger = logging.getLogger(__name__)


class SavingConfig(Section):
    """Where a node keeps what it knows."""

    file: str = option("", "the file, with which the node goes on at its next start; empty: none")
    every: float = option(
        10.0,
        "between two writings while something changes; a node that is killed loses no more",
        unit="s",
        gt=0,
    )


class Saver:
    """Writes a file now and then, and at the end.

    Args:
        config: which file, how often.
        save: writes it, whole or not at all.
    """

    def __init__(self, config: SavingConfig, save: Callable[[Path], None]) -> None:
        self._config, self._save = config, save
        self._saved, self._changed = time.monotonic(), False

    @property
    def path(self) -> Path | None:
        """The file; None where nothing is kept."""
        return Path(self._config.file).expanduser() if self._config.file else None

    def changed(self) -> None:
        """Something changed: write it if the last writing is long ago. Raises DataError."""
        self._changed = True
        if time.monotonic() - self._saved >= self._config.every:
            self.close()

    def close(self) -> None:
        """Write what changed since the last writing. Raises DataError where that is impossible."""
        if self.path is None or not self._changed:
            return
        # Before it is tried: a disk that is full is not asked again at once.
        self._saved, self._changed = time.monotonic(), False
        try:
            self._save(self.path)
        except BaseException:
            self._changed = True
            raise
        logger.info("kept %s", self.path)
