# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files and folders, reading with errors that name the file, and its limits."""

import errno
import functools
import hashlib
import os
import platform
import re
import secrets
import shutil
import signal
import stat
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.errors import DataError, FusionSlamError, naming, reason_of

if TYPE_CHECKING:
    from PIL import Image

PathLike = str | os.PathLike[str]

MOST_EXPANDED = 256 << 20
"""Bytes to which a file may expand in memory, or ``EXPANSION`` times its size if that is more."""
EXPANSION = 100
MOST_PIXELS = 90_000_000
"""Pixels of an image that is read."""

_MARK = "fusionslam"
_TEMPORARY = re.compile(rf"\..*\.{_MARK}-(?P<host>[0-9a-f]{{8}})-(?P<pid>\d+)-[0-9a-f]{{16}}")
_OLD_S = 7 * 24 * 3600
_cleaned: set[tuple[int, str]] = set()

_MAP_SUFFIX = ".fsmap"
_MAP_ID = slice(68, 72)
"""Where SQLite keeps the application id, ``map_database.APPLICATION_ID``, as bytes."""

_LONGEST_YAML = 256 << 10  # characters
_DEEPEST_YAML = 50
_MOST_YAML = 200_000  # values, each alias counted as what it stands for


def check_expansion(expanded: int, size: int) -> None:
    """Raise ValueError if ``size`` stored bytes claim to be more in memory than is allowed."""
    most = max(MOST_EXPANDED, EXPANSION * size)
    if expanded > most:
        raise ValueError(f"{size} bytes expand to {expanded}, expected at most {most}")


def check_pixels(image: "Image.Image") -> None:
    """Raise ValueError if an image that is not decoded yet has too many pixels."""
    width, height = image.size
    if width * height > MOST_PIXELS:
        raise ValueError(f"{width} x {height} pixels, expected at most {MOST_PIXELS}")


def read_yaml(path: PathLike) -> Any:
    """Read a YAML file of settings. Raises OSError, or ValueError as ``parse_yaml``."""
    with Path(path).open(encoding="utf-8") as file:
        return parse_yaml(file.read(_LONGEST_YAML + 1))


def parse_yaml(text: str) -> Any:
    """Parse YAML without tags of programs; numbers such as 2e-5, which YAML 1.1 lacks, are read.

    Raises:
        ValueError: it is no YAML, or too long, too deep, or an alias contains itself or expands
            to too many values; the message gives line and column.
    """
    import yaml

    if len(text) > _LONGEST_YAML:
        raise ValueError(f"more than {_LONGEST_YAML} characters")
    try:
        return yaml.load(text, _yaml_loader())
    except yaml.YAMLError as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
        if mark is None or problem is None:
            raise ValueError(str(error)) from error
        raise ValueError(f"line {mark.line + 1}, column {mark.column + 1}: {problem}") from error


@functools.cache
def _yaml_loader() -> type[Any]:
    import yaml

    class Loader(yaml.SafeLoader):
        """Counts the values that aliases expand to, and keeps the added resolver to itself."""

        def __init__(self, stream: Any) -> None:
            super().__init__(stream)
            self.depth = 0
            self.sizes: dict[int, int] = {}  # by id of a node

        def compose_node(self, parent: Any, index: Any) -> Any:
            event: Any = self.peek_event()  # type: ignore[no-untyped-call]
            is_alias, mark = isinstance(event, yaml.AliasEvent), event.start_mark
            self.depth += 1
            if self.depth > _DEEPEST_YAML:
                raise yaml.composer.ComposerError(None, None, "nested too deep", mark)
            node: Any = super().compose_node(parent, index)
            self.depth -= 1
            if is_alias and id(node) not in self.sizes:
                raise yaml.composer.ComposerError(None, None, "an alias inside its anchor", mark)
            if not is_alias:
                parts: list[Any] = [] if isinstance(node, yaml.ScalarNode) else node.value
                inner = [x for part in parts for x in (part if isinstance(part, tuple) else [part])]
                self.sizes[id(node)] = 1 + sum(self.sizes[id(x)] for x in inner)
            if self.sizes[id(node)] > _MOST_YAML:
                raise yaml.composer.ComposerError(None, None, "too many values", mark)
            return node

    power = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", power, list("-+.0123456789"))
    return Loader


@contextmanager
def reading(path: PathLike | None, expected: str) -> Iterator[None]:
    """Turn any error inside the block into a ``DataError`` that names the file.

    Args:
        path: of the file being read; None for bytes within a file, whose reader adds the name.
        expected: description of the file, such as "a stored view run".
    """
    if path is not None:
        check_regular(path, expected)
    try:
        with nullcontext() if path is None else naming(path):
            yield
    except FusionSlamError:
        raise
    except FileNotFoundError as error:
        message = f"{path} is missing: expected {expected}"
        raise DataError(message, code="missing-file", fields=(str(path),)) from error
    except Exception as error:  # damaged files make numpy, zipfile and others raise anything
        subject = "" if path is None else f"{path} cannot be read: "
        from pydantic import ValidationError  # takes long to import

        why = f"no {error}" if isinstance(error, KeyError) else error
        if isinstance(error, ValidationError):  # by other readers
            first = error.errors()[0]
            why = f"{'.'.join(map(str, first['loc']))}: {reason_of(first)}"
        why = getattr(error, "strerror", None) or why
        raise DataError(
            f"{subject}expected {expected} ({why})", code="damaged-file", fields=(str(path),)
        ) from error


def check_regular(path: PathLike, expected: str) -> None:
    """Raise DataError if a path is a pipe, a device or a socket, where reading may never end.

    A missing file is left to its reader.

    Args:
        path: of the file or folder.
        expected: description of the file, such as "a stored view run".
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        kind = "a pipe or socket" if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) else "a device"
        raise DataError(
            f"{path} is {kind}, expected a file: {expected}",
            code="not-a-file",
            fields=(str(path),),
        )


def is_map_file(path: PathLike) -> bool:
    """Whether a file is a map of ``map build``, whole or damaged, by its suffix or first bytes."""
    path = Path(path)
    if not os.path.isfile(path):
        return False
    if path.suffix.lower() == _MAP_SUFFIX:
        return True
    try:
        with path.open("rb") as file:
            start = file.read(_MAP_ID.stop)
    except OSError:
        return False
    return start.startswith(b"SQLite format 3\0") and start[_MAP_ID] == b"fsmp"


@contextmanager
def atomic_path(path: PathLike, *, durable: bool = True) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; it replaces ``path`` on success, else is deleted.

    A link is kept, and the file that it leads to replaced. The file keeps its mode; a new one gets
    that of the process (umask). What killed processes left in the folder is deleted.

    Args:
        path: of the file.
        durable: whether the file must survive a power cut from the end of the block on, which
            takes milliseconds; False for one of many files that can be made again.

    Raises:
        DataError: the folder cannot be made or written, or the path is neither a file nor a
            folder, such as a device, which must not be replaced (code "cannot-write").
    """
    target = Path(os.path.realpath(path)) if os.path.islink(path) else Path(path)
    if "\0" in str(target):
        raise cannot_write(target, "no file's name holds a NUL")
    if os.path.exists(target) and not (os.path.isfile(target) or os.path.isdir(target)):
        raise cannot_write(target, "it is a device, expected a file")
    if os.path.islink(target):
        raise cannot_write(target, "its links lead in a circle")
    mode = stat.S_IMODE(target.stat().st_mode) if os.path.isfile(target) else None
    try:
        temporary = _name_temporary(target)
        new = os.O_CREAT | os.O_EXCL | os.O_WRONLY
        os.close(os.open(temporary, new, 0o666 if mode is None else mode))
    except OSError as error:
        raise cannot_write(target, why_not(target, error)) from error
    try:
        yield temporary
        if mode is not None:
            temporary.chmod(mode)
        if durable:
            _flush_to_disk(temporary)
        temporary.replace(target)
        if durable:
            _flush_to_disk(target.parent)
    except OSError as error:
        raise cannot_write(target, error.strerror) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_file(path: PathLike, content: str | bytes, *, durable: bool = True) -> None:
    """Write a whole file, text as UTF-8. Arguments and errors as of ``atomic_path``."""
    with atomic_path(path, durable=durable) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def scratch_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder on the disk of ``target``; it is deleted at the end of the block.

    Raises:
        DataError: it cannot be made (code "cannot-write").
    """
    try:
        folder = _name_temporary(target)
        folder.mkdir(mode=0o700)
    except OSError as error:
        raise cannot_write(target, why_not(target, error)) from error
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _name_temporary(target: Path) -> Path:
    """Choose a name beside ``target`` that cannot be guessed, in a folder without left files."""
    target.parent.mkdir(parents=True, exist_ok=True)
    _delete_leftovers(target.parent)
    random = secrets.token_hex(8)
    # 255 bytes are the longest name; a character can take four.
    return target.parent / f".{target.name[:40]}.{_MARK}-{_host()}-{os.getpid()}-{random}"


def _delete_leftovers(folder: Path) -> None:
    """Delete temporary files and folders of processes that were killed; once per process."""
    key = os.getpid(), os.path.abspath(folder)
    if key in _cleaned:
        return
    _cleaned.add(key)
    with os.scandir(folder) as entries:
        left = [entry for entry in entries if _is_leftover(entry)]
    for entry in left:
        with suppress(OSError):
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path)
            else:
                os.unlink(entry.path)


def _is_leftover(entry: "os.DirEntry[str]") -> bool:
    """Whether the process that made an entry is dead; one of another machine may live."""
    found = _TEMPORARY.match(entry.name)
    if found is None:
        return False
    try:
        if time.time() - entry.stat(follow_symlinks=False).st_mtime > _OLD_S:
            return True
        if found["host"] != _host():
            return False
        os.kill(int(found["pid"]), 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False


@functools.cache
def _host() -> str:
    """Short name of this machine or container, in which process ids are unique."""
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def _flush_to_disk(path: Path) -> None:
    """Wait until a file's content or a folder's entries are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a file system that cannot
            raise
    finally:
        os.close(descriptor)


@contextmanager
def make_folder(folder: Path) -> Iterator[None]:
    """Make a folder for the results of the block; it is removed again if it stays empty.

    Raises:
        DataError: it cannot be made or written (code "cannot-write").
    """
    # Path.exists raises if a parent folder must not be entered.
    new = [one for one in (folder, *folder.parents) if not os.path.exists(one)]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            raise cannot_write(folder, why_not(folder / "x", error)) from error
        yield
    finally:
        with suppress(OSError):
            for one in new:
                one.rmdir()


def cannot_write(target: Path, why: object) -> DataError:
    """Make the error of a file or folder that cannot be written."""
    return DataError(f"cannot write {target}: {why}", code="cannot-write", fields=(str(target),))


def why_not(target: Path, error: OSError) -> str:
    """Explain why a file cannot be made: the system's reason, or what is wrong with its folder."""
    folder = next((one for one in target.parents if os.path.exists(one)), None)
    if folder is not None and not folder.is_dir():
        return f"{folder} is {'a file' if folder.is_file() else 'a device'}, expected a folder"
    reason = error.strerror or str(error)
    if folder == target.parent:
        return reason
    return f"the folder {target.parent} cannot be made ({reason})"


@contextmanager
def delay_interrupts() -> Iterator[None]:
    """Delay Ctrl-C and SIGTERM while third-party code changes a file.

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
