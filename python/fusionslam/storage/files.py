# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Files are written whole or not at all."""

import os
import signal
import tempfile
import threading
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fusionslam.errors import DataError, FusionSlamError

PathLike = str | os.PathLike[str]

DAMAGED = (
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    EOFError,
    RuntimeError,
    MemoryError,
    zlib.error,
    zipfile.BadZipFile,
)
"""What numpy, zipfile and json raise, besides OSError, where a .npz is damaged or another's: single
wrong bits say that it is encrypted (RuntimeError), or of a newer kind (NotImplementedError)."""


@contextmanager
def reading(path: str | os.PathLike[str], what: str) -> Iterator[None]:
    """Whatever is wrong with a stored file that is read becomes a DataError that names the file.

    Args:
        path: of the file.
        what: it is none of, where it is damaged: "no stored views".
    """
    try:
        yield
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error
    except FusionSlamError as error:
        raise DataError(f"{path}: {error}") from error
    except DAMAGED as error:
        # numpy takes whatever it does not know for a pickle, and advises to trust it.
        why = "it is no .npz" if "pickle" in str(error) else error
        raise DataError(f"{path}: {what}, or cut short: {why}") from error


@contextmanager
def reading_file(path: PathLike, expected: str) -> Iterator[None]:
    """Turn whatever a reader raises on a bad file into a ``DataError`` that names the file.

    Args:
        path: the file that is read.
        expected: what the file should be.
    """
    try:
        yield
    except FusionSlamError:
        raise
    except FileNotFoundError as error:
        raise DataError(f"{path} is missing: expected {expected}") from error
    except Exception as error:  # readers of other people raise anything on a corrupt file
        raise DataError(f"{path} cannot be read: expected {expected} ({error})") from error


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; on success it replaces ``path``, else it vanishes.

    Raises:
        DataError: the folder cannot be made or written, or something is there that is no file, such
            as a device, which must not be replaced.
    """
    target = Path(path)
    if os.path.exists(target) and not (os.path.isfile(target) or os.path.isdir(target)):
        raise DataError(f"cannot write {target}: it is a device, expected a file")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        os.close(handle)
    except OSError as error:
        raise DataError(f"cannot write {target}: {why_not(target, error)}") from error
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(target)
    except OSError as error:
        raise DataError(f"cannot write {target}: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder before the work is done whose results go there; gone again if none came.

    Raises:
        DataError: it cannot be made, or nothing can be written there.
    """
    # Path.exists raises where a folder on the way must not be entered.
    new = [one for one in (folder, *folder.parents) if not os.path.exists(one)]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            raise DataError(f"cannot write {folder}: {why_not(folder / 'x', error)}") from error
        yield
    finally:
        with suppress(OSError):
            for one in new:
                one.rmdir()


def why_not(target: Path, error: OSError) -> str:
    """Why no file can be made at a path: what the system says, or that a folder is none."""
    folder = next((one for one in target.parents if os.path.exists(one)), None)
    if folder is None or folder.is_dir():
        return error.strerror or str(error)
    return f"{folder} is {'a file' if folder.is_file() else 'a device'}, expected a folder"


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back Ctrl-C and SIGTERM while a file that others wrote code for is half changed.

    They take effect at the end of the block. Threads other than the main one are never interrupted.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    before = {
        wanted: signal.signal(wanted, lambda number, _: held.append(number))
        for wanted in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for wanted, handler in before.items():
            signal.signal(wanted, handler)
        for number in held:
            signal.raise_signal(number)
