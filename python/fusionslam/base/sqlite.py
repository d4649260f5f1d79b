# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Connections to SQLite files that a stranger may have made: no statement runs or grows forever."""

import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

PATIENCE_S = 10  # with another process
_LONGEST_VALUE = 10**9  # bytes
_FEWEST_STEPS = 10_000_000
_STEPS_PER_BYTE = 2
_STEPS_AT_ONCE = 100_000
"""Steps of SQLite's machine, some 100 million a second: what a statement has for a file of this
size, before it is broken off, and how many go by between two looks at that and at Ctrl-C."""
_SMALLEST_FILE = 65536  # bytes: one page of a map


class BoundedConnection(sqlite3.Connection):
    """A connection to a file that a stranger may have made: each statement ends."""

    _left: Sequence[int] = (0,)  # looks that the statement has left

    @property
    def was_interrupted(self) -> bool:
        """Whether a signal, as of Ctrl-C, ended the last statement, not its own length."""
        return self._left[0] >= 0

    def execute(self, statement: str, values: Iterable[Any] = (), /) -> sqlite3.Cursor:  # type: ignore[override]
        self._allow(_FEWEST_STEPS)
        return super().execute(statement, values)  # type: ignore[arg-type]

    def fetch(self, statement: str, values: Iterable[Any] = ()) -> list[tuple[Any, ...]]:
        """Return the rows of a statement, which are no more than the file.

        Raises:
            sqlite3.DatabaseError: they are: pages lead to each other in a ring.
        """
        most = self._size()
        rows, size = [], 0
        self.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, most)
        try:
            self._allow(_FEWEST_STEPS + _STEPS_PER_BYTE * most)
            for row in super().execute(statement, values):  # type: ignore[arg-type]
                size += sum(len(value) for value in row if isinstance(value, bytes | str))
                if size > most:
                    raise sqlite3.DatabaseError(f"rows of {size} bytes in a file of {most}")
                rows.append(row)
        finally:
            self.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST_VALUE)
        return rows

    def _size(self) -> int:
        """Bytes of the file, with its log."""
        count, page = (
            int(super(BoundedConnection, self).execute(f"PRAGMA {name}").fetchone()[0])
            for name in ("page_count", "page_size")
        )
        return max(count * page, _SMALLEST_FILE)

    def _allow(self, steps: int) -> None:
        self._left = left = [steps // _STEPS_AT_ONCE]

        def is_over() -> bool:  # an exception in here, as of Ctrl-C, ends the statement, too
            left[0] -= 1
            return left[0] < 0

        self.set_progress_handler(is_over, _STEPS_AT_ONCE)


def connect(path: Path, mode: str) -> BoundedConnection:
    """Connect to a file, in a mode of SQLite's addresses: "ro", "rw" or "rwc".

    Raises:
        sqlite3.Error: it cannot be opened, or is no database.
    """
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?mode={mode}",
        uri=True,
        isolation_level=None,
        timeout=PATIENCE_S,
        check_same_thread=False,
        factory=BoundedConnection,
    )
    assert isinstance(connection, BoundedConnection)
    for setting in ("trusted_schema = OFF", "cell_size_check = ON"):
        connection.execute(f"PRAGMA {setting}")
    return connection


@contextmanager
def reader(path: Path) -> Iterator[BoundedConnection]:
    """Connect for reading, and leave nothing beside the file."""
    try:
        with closing(connect_read_only(path)) as connection:
            yield connection
    finally:
        delete_empty_log(path)


def delete_empty_log(path: Path) -> None:
    """Delete the files beside a database that its last reader leaves, as SQLite lets only writers.

    A log that is not empty has what a killed writer left for the next one.
    """
    with suppress(OSError, sqlite3.Error):
        if not Path(f"{path.resolve()}-wal").stat().st_size:
            with closing(connect(path, "rw")) as connection:
                connection.execute("PRAGMA schema_version")


def connect_read_only(path: Path) -> BoundedConnection:
    """Connect for reading, where nothing may be written beside the file, too."""
    connection = connect(path, "ro")
    try:
        connection.execute("PRAGMA schema_version")
    except sqlite3.OperationalError as error:
        connection.close()
        beside = Path(f"{path.resolve()}-wal")
        refused = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)
        if error.sqlite_errorcode & 0xFF not in refused or beside.exists():
            raise
        return connect(path, "ro&immutable=1")
    except sqlite3.Error:
        connection.close()
        raise
    return connection
