# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stores arrays in a ``.npz`` or plain values in JSON, with the name of their format.

An archive is a ``.npz`` that holds, beside its arrays, the text ``about``: JSON with the format's
name and version and metadata of the arrays. Files are written atomically.
"""

import json
import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.storage.files import PathLike, atomic_path, reading

ABOUT = "about"


def save_archive(
    target: PathLike | BinaryIO,
    format: str,
    about: Mapping[str, Any],
    arrays: Mapping[str, Any],
    *,
    compress: bool = False,
) -> None:
    """Write arrays and their metadata.

    Args:
        target: path of the file, or a binary stream.
        format: name and version, such as "fusionslam.view_run.1".
        about: metadata of the arrays; must be representable in JSON.
        arrays: by name; None for an array that is absent.
        compress: whether to compress the file, which takes longer.

    Raises:
        DataError: the file cannot be written.
    """
    text = np.array(json.dumps({"format": format, **about}))
    save_arrays(target, {ABOUT: text, **arrays}, compress=compress)


@contextmanager
def load_archive(
    source: PathLike | BinaryIO, format: str, expected: str
) -> Iterator[tuple[dict[str, Any], dict[str, NDArray[Any]]]]:
    """Read an archive of ``save_archive``; the block converts it into a value.

    Errors inside the block are reported as errors of the file, too.

    Args:
        source: path of the file, or a binary stream.
        format: the supported format.
        expected: description of the file for messages: "a stored view run".

    Yields:
        The metadata, and the arrays by name.

    Raises:
        DataError: the file is missing, truncated, damaged, of another format or not an archive;
            the message names it.
    """
    with load_arrays(source, expected) as arrays:
        about = json.loads(str(arrays.pop(ABOUT)))
        _check_format(about, format)
        yield about, arrays


def save_arrays(
    target: PathLike | BinaryIO, arrays: Mapping[str, Any], *, compress: bool = False
) -> None:
    """Write a ``.npz`` of arrays without metadata; otherwise like ``save_archive``."""
    save = np.savez_compressed if compress else np.savez
    present: dict[str, Any] = {name: rows for name, rows in arrays.items() if rows is not None}
    if not isinstance(target, str | os.PathLike):
        save(target, **present)
        return
    with atomic_path(target) as temporary, temporary.open("wb") as stream:
        save(stream, **present)


@contextmanager
def load_arrays(source: PathLike | BinaryIO, expected: str) -> Iterator[dict[str, NDArray[Any]]]:
    """Read a ``.npz`` of arrays without metadata; otherwise like ``load_archive``."""
    path = source if isinstance(source, str | os.PathLike) else None
    with reading(path, expected):
        with _open(source) as stream:
            if not zipfile.is_zipfile(stream):  # numpy would report a pickle
                raise ValueError("it is no .npz, or it is cut short")
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
        yield arrays


def format_of(path: PathLike) -> str | None:
    """Format named in an archive; None if the file is not a readable archive."""
    try:
        with reading(path, "an archive"), np.load(path, allow_pickle=False) as stored:
            return str(json.loads(str(stored[ABOUT]))["format"])
    except DataError:
        return None


def save_json(
    path: PathLike, format: str | None, content: Mapping[str, Any], *, indent: int | None = None
) -> None:
    """Write values as JSON, with the name of their format unless it is None.

    Raises:
        DataError: the file cannot be written.
        ValueError: a number is not finite.
    """
    named = content if format is None else {"format": format, **content}
    with atomic_path(path) as temporary:
        text = json.dumps(named, indent=indent, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")


@contextmanager
def load_json(path: PathLike, format: str | None, expected: str) -> Iterator[dict[str, Any]]:
    """Read a file of ``save_json``; the block converts it into a value.

    Args, raises: as for ``load_archive``.
    """
    with reading(path, expected):
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError(f"it holds a {type(content).__name__}")
        if format is not None:
            _check_format(content, format)
        yield content


def _open(source: PathLike | BinaryIO) -> AbstractContextManager[BinaryIO]:
    return Path(source).open("rb") if isinstance(source, str | os.PathLike) else nullcontext(source)


def _check_format(about: dict[str, Any], expected: str) -> None:
    """Remove the format from the metadata. Raises DataError unless it is the expected one."""
    found = about.pop("format", None)
    if found != expected:
        message = f"is of format {found}, expected {expected}"
        raise DataError(message, code="format", fields=(str(found), expected))
