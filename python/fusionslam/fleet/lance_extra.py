# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the extra ``fleet``: LanceDB, in a folder or an object store."""

import errno
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fusionslam.base.files import cannot_write, why_not
from fusionslam.errors import DataError, FusionSlamError, needing

TABLE = "places"
_SUFFIX = ".lance"
_STABLE = {"new_table_enable_stable_row_ids": "true"}
"""Numbers of rows stay the same when files are merged: the index of vectors knows rows by them."""
_PANICS = ("RustPanic", "PanicException")
"""How Rust's panics come to Python, as of damaged files."""
_REFUSED = ("No space left", "Disk quota exceeded", "Read-only file system", "Permission denied")


def load() -> Any:
    """LanceDB's module.

    Raises:
        FusionSlamError: it is not installed (code "missing-extra").
    """
    with needing("fleet", "a database of places needs LanceDB"):
        import lancedb
    return lancedb


def is_remote(location: str) -> bool:
    """Whether a location is in an object store, such as s3://bucket/places."""
    return "://" in location


def create_table(location: str, schema: Any, options: Mapping[str, str] | None) -> Any:
    """Make an empty table.

    Args:
        location: of the folder, or an address in an object store.
        schema: pyarrow's.
        options: of the object store.

    Raises:
        DataError: there is something already (code "exists"), or it cannot be written.
    """
    lancedb = load()
    if not is_remote(location) and has_table(location):
        raise _exists(location)
    with errors(location, writing=True):
        try:
            Path(location).mkdir(parents=True, exist_ok=True) if not is_remote(location) else None
            return _connect(lancedb, location, options).create_table(
                TABLE, schema=schema, storage_options={**(options or {}), **_STABLE}
            )
        except ValueError as error:
            if "already exists" in str(error):
                raise _exists(location) from error
            raise


def open_table(location: str, options: Mapping[str, str] | None) -> Any:
    """Open a table that exists, and look into each of its files.

    Args:
        location, options: as for ``create_table``.

    Raises:
        DataError: there is none (code "not-found", or "other-format" for a folder of something
            else), it is damaged ("damaged"), or it cannot be read ("cannot-read").
    """
    lancedb = load()
    with errors(location):
        try:
            table = _connect(lancedb, location, options).open_table(TABLE)
        except ValueError as error:
            if "not found" not in str(error):
                raise
            if not is_remote(location):
                raise damaged(location, "it has no complete version of its table") from error
            raise _not_found(location) from error
        table.count_rows("frame >= 0")  # reads each file's end, and a column that is small
    return table


@contextmanager
def errors(location: str, *, writing: bool = False) -> Iterator[None]:
    """Raise what LanceDB says as DataError that names the location.

    Args:
        location: of the folder, or an address in an object store.
        writing: whether the block changes something: what the system refuses then has the code
            "cannot-write", else "cannot-read".
    """
    try:
        yield
    except (FusionSlamError, MemoryError):
        raise
    except UnicodeEncodeError as error:
        raise DataError(f"{error.object!r} is no text in Unicode", code="bad-text") from error
    except OSError as error:
        if not writing:
            raise _cannot_read(location, error.strerror or _first_line(error)) from error
        raise cannot_write(Path(location), why_not(Path(location) / TABLE, error)) from error
    except BaseException as error:
        known = isinstance(error, RuntimeError | ValueError | LookupError)
        if not known and type(error).__name__ not in _PANICS:
            raise
        first = _first_line(error)
        is_refused = any(sign in str(error) for sign in _REFUSED)
        if is_refused and writing:
            raise cannot_write(Path(location), first) from error
        if is_refused or is_remote(location):
            raise _cannot_read(location, first) from error
        raise damaged(location, first) from error


def damaged(location: str, why: object) -> DataError:
    """Make the error of a database that cannot be read."""
    return DataError(f"{location} is damaged: {why}", code="damaged", fields=(location,))


def other_format(location: str) -> DataError:
    """Make the error of what is no database of places."""
    return DataError(
        f"{location} is no database of places: expected a folder made by `fusionslam fleet`",
        code="other-format",
        fields=(location,),
    )


def _connect(lancedb: Any, location: str, options: Mapping[str, str] | None) -> Any:
    return lancedb.connect(location, storage_options=dict(options) if options else None)


def has_table(location: str) -> bool:
    """Whether a folder has a table with at least one version; not for object stores."""
    return (Path(location) / f"{TABLE}{_SUFFIX}" / "_versions").exists()


def check_location(location: str) -> None:
    """Raise DataError for a folder without a table: LanceDB would make what is missing.

    Raises:
        DataError: there is none (code "not-found"), it is a folder of something else
            ("other-format"), or it cannot be read ("cannot-read").
    """
    if is_remote(location):
        return
    path = Path(location)
    try:
        names = {entry.name for entry in path.iterdir()}
    except (FileNotFoundError, ValueError) as error:
        raise _not_found(location) from error
    except NotADirectoryError as error:
        raise other_format(location) from error
    except OSError as error:
        reason = error.strerror or errno.errorcode.get(error.errno or 0, "unknown")
        raise _cannot_read(location, reason) from error
    if TABLE + _SUFFIX not in names:
        raise other_format(location) if names else _not_found(location)


def _first_line(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def _cannot_read(location: str, why: str) -> DataError:
    return DataError(f"cannot read {location}: {why}", code="cannot-read", fields=(location,))


def _not_found(location: str) -> DataError:
    return DataError(
        f"{location} does not exist: expected a database of places, which `fusionslam fleet "
        "describe` makes",
        code="not-found",
        fields=(location,),
    )


def _exists(location: str) -> DataError:
    return DataError(
        f"{location} is there already: open it, or choose another folder",
        code="exists",
        fields=(location,),
    )
