# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stores arrays in a ``.npz`` or plain values in JSON, with the name of their format.

An archive is a ``.npz`` that holds, beside its arrays, the text ``about``: JSON with the format's
name and version, metadata of the arrays and the digests (SHA-256) of the arrays and of itself.
JSON files have a digest, too. A file that was changed after it was written is refused; one of an
earlier version, without digests, is read. Files are written atomically.
"""

import hashlib
import io
import json
import math
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from fusionslam.base.files import PathLike, atomic_path, check_expansion, reading, write_file
from fusionslam.errors import DataError, reason_of

T = TypeVar("T")

ABOUT = "about"
DIGEST = "digest"
"""Key of the digest of all other values."""

_ARRAY_DIGESTS = "array_digests"
_LONGEST_HEADER = 1 << 16  # of an array of numpy's first format
_BLOCK = 1 << 20
_SUFFIX = ".npy"


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
    present = {name: np.asarray(rows) for name, rows in arrays.items() if rows is not None}
    digests = {name: _digest_array(rows) for name, rows in present.items()}
    sealed = _seal({"format": format, **about, _ARRAY_DIGESTS: digests})
    text = np.array(json.dumps(sealed))
    save_arrays(target, {ABOUT: text, **present}, compress=compress)


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
        if _check_seal(about):
            _check_arrays(arrays, about.pop(_ARRAY_DIGESTS))
        del about["format"]
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
        with _members(source) as members:
            arrays = {name: read() for name, read in members.items()}
        yield arrays


def join_parts(parts: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Name the arrays of several parts "part.name", so that one archive holds them all."""
    return {
        f"{part}.{name}": rows for part, arrays in parts.items() for name, rows in arrays.items()
    }


def part_of(arrays: Mapping[str, T], part: str) -> dict[str, T]:
    """Return the arrays of one of the parts that ``join_parts`` joined, by their own names."""
    start = f"{part}."
    return {name.removeprefix(start): a for name, a in arrays.items() if name.startswith(start)}


def format_of(path: PathLike) -> str | None:
    """Format named in an archive; None if the file is not a readable archive."""
    try:
        with reading(path, "an archive"), _members(path) as members:
            return str(json.loads(str(members[ABOUT]()))["format"])
    except DataError:
        return None


def array_names(path: PathLike) -> set[str]:
    """Names of the arrays of a ``.npz``; none for any other file."""
    if Path(path).suffix.lower() != ".npz":
        return set()
    try:
        with reading(path, "a .npz"), zipfile.ZipFile(path) as archive:
            return {name.removesuffix(_SUFFIX) for name in archive.namelist()}
    except DataError:
        return set()


def save_json(
    path: PathLike, format: str | None, content: Mapping[str, Any], *, indent: int | None = None
) -> None:
    """Write values as JSON, with the name of their format unless it is None.

    Raises:
        DataError: the file cannot be written.
        ValueError: a number is not finite.
    """
    named = content if format is None else {"format": format, **content}
    write_file(path, dump_sealed(named, indent=indent) + "\n")


def dump_sealed(content: Mapping[str, Any], *, indent: int | None = None) -> str:
    """Return values as JSON with their digest. Raises ValueError: a number is not finite."""
    return json.dumps(_seal(content), indent=indent, allow_nan=False)


def parse_sealed(text: str | bytes) -> dict[str, Any]:
    """Return what ``dump_sealed`` was called on.

    Raises:
        DataError: it was changed after it was written (code "wrong-digest").
        ValueError: it is no JSON.
    """
    content = json.loads(text)
    if not isinstance(content, dict) or not _check_seal(content):
        raise DataError("has no digest of its values", code="wrong-digest")
    return content


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
        _check_seal(content)
        if format is not None:
            del content["format"]
        yield content


def parse_array(data: bytearray, name: str) -> NDArray[Any]:
    """View the bytes of a ``.npy`` as its array. Raises ValueError unless they are just that."""
    start = io.BytesIO(bytes(memoryview(data)[:_LONGEST_HEADER]))
    if np.lib.format.read_magic(start) != (1, 0):
        raise ValueError(f"{name} is of another version of numpy's format")
    shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(start)
    if dtype.hasobject:
        raise ValueError(f"{name} holds Python objects")
    expected = start.tell() + dtype.itemsize * math.prod(shape)
    if len(data) != expected:
        raise ValueError(f"{name} has {len(data)} bytes, its header says {expected}")
    order: Literal["F", "C"] = "F" if fortran_order else "C"
    rows: NDArray[Any] = np.ndarray(shape, dtype, data, start.tell(), order=order)
    return rows if rows.flags.aligned else rows.copy()


def check_types(value: T) -> T:
    """Check the fields of a dataclass that was made of a file's values, and return it.

    Arrays and classes of this package check themselves.

    Raises:
        DataError: a field has a value of another type than it is declared with, or a whole number
            beyond 64 bits.
    """
    for name, declared in get_type_hints(type(value)).items():
        given = getattr(value, name)
        if isinstance(given, int) and abs(given) >= 2**63:
            raise DataError(f"{name}: number beyond 64 bits", code="wrong-type", fields=(name,))
        checked = _adapter(declared)
        if checked is not None:
            try:
                checked.validate_python(given, strict=True)
            except ValidationError as error:
                problem = reason_of(error.errors()[0])
                raise DataError(f"{name}: {problem}", code="wrong-type", fields=(name,)) from error
    return value


_CHECKED = (np.ndarray, BaseModel)


@cache
def _adapter(declared: Any) -> "TypeAdapter[Any] | None":
    """Validator of a type; None for arrays and for classes."""
    for part in (declared, *get_args(declared)):
        kind = get_origin(part) or part
        if is_dataclass(kind) or (isinstance(kind, type) and issubclass(kind, _CHECKED)):
            return None
    return TypeAdapter(declared, config=ConfigDict(arbitrary_types_allowed=True))


def _read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """Read an array of a ``.npz``. Raises ValueError unless it is one array and nothing else.

    All bytes are read: the archive's check sum is compared at their end only.
    """
    data, filled = bytearray(info.file_size), 0
    with archive.open(info) as stream:
        while block := stream.read(_BLOCK):
            data[filled : filled + len(block)] = block
            filled += len(block)
    if filled != info.file_size:
        raise ValueError(f"{info.filename} is cut short")
    return parse_array(data, info.filename)


@contextmanager
def _members(source: PathLike | BinaryIO) -> Iterator[dict[str, Callable[[], NDArray[Any]]]]:
    """Open a ``.npz``; yield functions by name that read its arrays.

    Raises:
        ValueError: it is none, or its members are no arrays, overlap, or expand beyond the limit.
    """
    with (
        Path(source).open("rb") if isinstance(source, str | os.PathLike) else nullcontext(source)
    ) as stream:
        if not zipfile.is_zipfile(stream):
            raise ValueError("it is no .npz, or it is cut short")
        size = stream.seek(0, os.SEEK_END)
        with zipfile.ZipFile(stream) as archive:
            infos = {info.filename.removesuffix(_SUFFIX): info for info in archive.infolist()}
            ends = [info.filename.endswith(_SUFFIX) for info in infos.values()]
            if len(infos) != len(archive.infolist()) or not all(ends):
                raise ValueError("its members are not arrays of different names")
            if sum(info.compress_size for info in infos.values()) > size:
                raise ValueError("its members overlap")
            check_expansion(sum(info.file_size for info in infos.values()), size)
            yield {name: partial(_read_member, archive, info) for name, info in infos.items()}


def _digest_array(rows: NDArray[Any]) -> str:
    """Digest of the type, the shape and all numbers of an array."""
    found = hashlib.sha256(f"{rows.dtype.str} {rows.shape}".encode())
    found.update(np.ascontiguousarray(rows).reshape(-1).view(np.uint8).data)
    return found.hexdigest()


def _digest_values(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _seal(content: Mapping[str, Any]) -> dict[str, Any]:
    """Add the digest of all values to them."""
    return {**content, DIGEST: _digest_values(content)}


def _check_seal(content: dict[str, Any]) -> bool:
    """Remove the digest. Returns whether there was one; raises DataError if it does not fit."""
    stored = content.pop(DIGEST, None)
    if stored is None:
        return False
    if stored != _digest_values(content):
        raise DataError(
            f"was changed after it was written: its content does not fit its {DIGEST} (remove that "
            "entry if the change was intended)",
            code="wrong-digest",
        )
    return True


def _check_arrays(arrays: Mapping[str, NDArray[Any]], digests: Mapping[str, str]) -> None:
    """Raise DataError unless these are the arrays of which the digests were made."""
    for name in sorted(arrays.keys() | digests.keys()):
        if name not in arrays or digests.get(name) != _digest_array(arrays[name]):
            raise DataError(
                f"was changed after it was written: array {name} does not fit its digest",
                code="wrong-digest",
                fields=[name],
            )


def _check_format(about: dict[str, Any], expected: str) -> None:
    """Raise DataError unless the format is the expected one."""
    found = about.get("format")
    if found != expected:
        message = f"is of format {found}, expected {expected}"
        raise DataError(message, code="format", fields=(str(found), expected))
