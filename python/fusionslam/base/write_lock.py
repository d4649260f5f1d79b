# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Lets one process at a time change a file or a folder."""

import fcntl
import os
from pathlib import Path

from fusionslam.base.files import cannot_write, why_not
from fusionslam.errors import DataError


class WriteLock:
    """Holds a lock until it is released or the process ends, in whatever way.

    Args:
        file: the lock itself, on a local disk; made if missing.
        guarded: the file or folder that it guards, as errors name it.

    Raises:
        DataError: another process holds it (code "locked"), or it cannot be written.
    """

    def __init__(self, file: Path, guarded: Path) -> None:
        self._file = file
        self._descriptor = -1
        try:
            while not self._is_in_place():  # its last owner may have deleted it meanwhile
                self.release()
                self._take(guarded)
        except BaseException:
            self.release()
            raise

    def __del__(self) -> None:
        self.release()

    def note(self, text: str) -> None:
        """Write into the lock what stays in it if the process is killed, over what was there.

        Raises:
            OSError: it cannot be written.
        """
        os.pwrite(self._descriptor, text.encode(), 0)

    def release(self, *, delete: bool = False) -> None:
        """Let others change what it guards, and ``delete`` the lock if it is held."""
        descriptor, self._descriptor = getattr(self, "_descriptor", -1), -1
        if descriptor >= 0:
            if delete:
                self._file.unlink(missing_ok=True)
            os.close(descriptor)

    def _take(self, guarded: Path) -> None:
        # Not through a link: it would make a file wherever that leads.
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        try:
            self._descriptor = os.open(self._file, flags, 0o666)
        except OSError as error:
            raise cannot_write(guarded, why_not(self._file, error)) from error
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise locked_by_another(guarded) from error

    def _is_in_place(self) -> bool:
        try:
            return self._descriptor >= 0 and os.path.samestat(
                os.fstat(self._descriptor), os.stat(self._file, follow_symlinks=False)
            )
        except FileNotFoundError:
            return False


def lock_folder(folder: Path) -> WriteLock:
    """Lock a folder that exists by a file ``.lock``, which stays in it."""
    return WriteLock(folder / ".lock", folder)


def locked_by_another(guarded: Path) -> DataError:
    """Make the error of what another process is changing."""
    return DataError(
        f"{guarded} is being changed by another process: wait for it, or open it read-only",
        code="locked",
        fields=(str(guarded),),
    )
