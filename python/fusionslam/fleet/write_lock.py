# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Lets one process at a time change a folder."""

import fcntl
import os
from pathlib import Path

from fusionslam.errors import DataError
from fusionslam.storage.files import cannot_write, why_not

NAME = ".lock"


class WriteLock:
    """Holds a folder's lock until it is released or the process ends, in whatever way.

    Args:
        folder: that exists; a file ``.lock`` stays in it.

    Raises:
        DataError: another process holds it (code "locked"), or the folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / NAME
        try:
            # Not through a link: it would make a file wherever that leads.
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        except OSError as error:
            raise cannot_write(folder, why_not(path, error)) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self.release()
            raise DataError(
                f"{folder} is being changed by another process: wait for it, or open it read-only",
                code="locked",
                fields=(str(folder),),
            ) from error

    def __del__(self) -> None:
        self.release()

    def release(self) -> None:
        """Let others change the folder."""
        file, self._file = getattr(self, "_file", -1), -1
        if file >= 0:
            os.close(file)
