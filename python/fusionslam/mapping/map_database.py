# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The SQLite database of a map: opened, locked against other writers, of a known version."""

import errno
import json
import os
import secrets
import sqlite3
import stat
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from fusionslam.base.files import PathLike, cannot_write, why_not
from fusionslam.base.sqlite import (
    PATIENCE_S,
    BoundedConnection,
    connect,
    connect_read_only,
    delete_empty_log,
    reader,
)
from fusionslam.base.write_lock import WriteLock, locked_by_another
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.mapping.map_schema import (
    APPLICATION_ID,
    KEYS,
    TABLES,
    VERSION,
    MapState,
    decode_state,
    row_crc,
    schema,
    seal,
)

_PAGE = 65536
_MOST_LOGGED = 64 * _PAGE
"""Bytes in the write-ahead log before they go into the file."""

_CORRUPTED = (
    *(sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CONSTRAINT, sqlite3.SQLITE_AUTH),
    *(sqlite3.SQLITE_TOOBIG, sqlite3.SQLITE_MISMATCH, sqlite3.SQLITE_FORMAT, sqlite3.SQLITE_SCHEMA),
)
_LONGEST_WHY = 300  # characters of a message


class MapDatabase:
    """A map's database, open.

    One process at a time changes it; others may read it meanwhile. It belongs on a local disk.

    Args:
        path: of the file; made if missing, unless ``read_only``.
        read_only: whether nothing may be changed.

    Attributes:
        path: of the file.

    Raises:
        DataError: no map (code "other-format"), damaged ("damaged"), of a later version
            ("newer-version"), changed by another process ("locked"), missing ("not-found"), beside
            the log of another file ("other-log"), without changes that a process that was killed
            had acknowledged ("lost-changes"), or it cannot be written ("cannot-write"). Each use:
            the file was replaced or deleted since ("replaced"), or this process is a child of the
            one that opened it ("forked").
    """

    def __init__(self, path: PathLike, *, read_only: bool = False) -> None:
        self.path = Path(path)
        self.read_only = read_only
        self._lock: WriteLock | None = None
        self._connection: BoundedConnection | None = None
        self._is_new = False
        self._process = os.getpid()
        self._place: tuple[int, int] | None = None  # device and inode of the open file
        self._state: MapState | None = None  # within a transaction: what it will have
        self._has_changed = False
        self._base = 0
        try:
            with self._errors():
                self._open()
        except BaseException:
            self.close(failed=True)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self, *, failed: bool = False) -> None:
        """Close the file.

        Args:
            failed: whether it could not be used: if it was made by this, it is deleted.

        Raises:
            DataError: the file was replaced or deleted since it was changed (code "replaced").
        """
        if not self.is_mine:
            # All belongs to the parent: closing here would take its log and its lock away.
            _of_parents.append(self._connection)
            self._connection = None
            if self._lock is not None:
                self._lock.release()  # only the copy of this process
                self._lock = None
            return
        is_lost = self._has_changed and not failed and not self._is_in_place()
        if self._connection is not None:
            self._connection.close()
            self._connection = None
            if self.read_only:
                delete_empty_log(self.path)
        if failed and self._is_new:
            self.path.resolve().unlink(missing_ok=True)
        if self._lock is not None:
            self._lock.release(delete=True)
            self._lock = None
        self._has_changed = False
        if is_lost:
            raise self._replaced()

    @property
    def is_mine(self) -> bool:
        """Whether this process opened it, and not its parent."""
        return os.getpid() == self._process

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """What is changed within counts as a whole, once it ends, or not at all.

        Raises:
            DataError: it cannot be written, as on a full disk; nothing has changed. Or the file
                that is open is no longer that of the path (code "replaced").
        """
        with self._errors():
            self._check_place()
            self._database.execute("BEGIN IMMEDIATE")
            try:
                self._state = self._read_state()
                yield
                state = self._state._replace(number=self._state.number + 1, base=self._base)
                self._write_state(state)
                self._database.execute("COMMIT")
            except BaseException:
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
                raise
            finally:
                self._state = None
            self._has_changed = True
            self._check_place()
            self._note(state)
            self._checkpoint(state)

    @contextmanager
    def reading(self) -> Iterator[None]:
        """All that is read within is of one moment."""
        if self._database.in_transaction:
            yield
            return
        with self._errors():
            self._database.execute("BEGIN")
            try:
                yield
            finally:
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")

    def check(self) -> list[str]:
        """Return what is damaged, in SQLite's words; nothing if the file is whole."""
        with self._errors():
            rows = self._database.execute("PRAGMA integrity_check").fetchall()
            broken = self._database.execute("PRAGMA foreign_key_check").fetchall()
        found = [str(text) for (text,) in rows if text != "ok"]
        found += [f"table {row[0]}, row {row[1]}: its {row[2]} is missing" for row in broken]
        for table in KEYS.keys() - {"cloud"}:  # clouds are too many to be read at once
            try:
                self._table(table)
            except DataError as error:
                found.append(str(error))
        return found

    @property
    def _database(self) -> BoundedConnection:
        if not self.is_mine:
            raise DataError(
                f"{self.path} was opened by process {self._process}, of which this is a child: "
                "open it read-only here",
                code="forked",
                fields=(str(self.path),),
            )
        if self._connection is None:
            raise DataError(f"{self.path} is closed", code="closed", fields=(str(self.path),))
        return self._connection

    def _open(self) -> None:
        try:
            mode_bits = self.path.stat().st_mode
        except (FileNotFoundError, NotADirectoryError):
            exists = False
        except (OSError, ValueError) as error:  # a name that is too long, or holds a null byte
            raise cannot_read(self.path, getattr(error, "strerror", error)) from error
        else:
            exists = True
            if not stat.S_ISREG(mode_bits):  # a pipe would be waited for
                raise self._other_format()
            if not os.access(self.path, os.R_OK):
                raise cannot_read(self.path, os.strerror(errno.EACCES))
        if not exists and self.read_only:
            raise DataError(
                f"{self.path} does not exist: expected a map (.fsmap)",
                code="not-found",
                fields=(str(self.path),),
            )
        before = _place_of(self.path)
        if exists:
            self._check_kind()
        if not self.read_only:
            self._take_lock()
            self._is_new = not self.path.exists()
            self._connection = connect(self.path, "rwc")
        else:
            self._connection = connect_read_only(self.path)
        is_new = not self._all("SELECT * FROM sqlite_master")
        if is_new and not self.read_only and self._all("PRAGMA application_id") == [(0,)]:
            self._make()
        elif is_new:
            raise self._other_format()
        self._place = _place_of(self.path)
        if exists and self._place != before:
            raise self._replaced()
        self._database.execute("PRAGMA foreign_keys = ON")
        if not self.read_only:
            # Each step reaches the disk: what was acknowledged survives a power cut, too.
            self._database.execute("PRAGMA synchronous = FULL")
            self._database.execute("PRAGMA wal_autocheckpoint = 0")  # _checkpoint does
            with self.reading():
                state = self._read_state()
            self._base = state.base
            self._note(state)
            self._checkpoint(state, most=0)

    def _check_kind(self) -> None:
        """Raise DataError for what is no map before SQLite makes or changes files beside it.

        Nothing but SQLite opens the file: closing it would give up the locks that other
        connections of this process hold (POSIX).
        """
        size = self.path.stat().st_size
        if not size:
            return
        noted = self._noted()  # before the file: what is noted was written before
        with reader(self.path) as self._connection:
            try:
                identity = self._all("PRAGMA application_id")
                if identity == [(0,)] and not self._all("SELECT * FROM sqlite_master"):
                    return  # its maker was killed, or it is somebody's own empty file
                if identity != [(APPLICATION_ID,)]:
                    raise self._other_format()
                self._check_version()
                ((page,),) = self._all("PRAGMA page_size")
                # A full disk leaves a part of a page, which the log beside the file has whole.
                if size % page and not self._log_size():
                    raise self._damaged(f"it is cut off, {size} bytes are no multiple of {page}")
                self._check_schema()
                with self.reading():
                    state = self._read_state()
            finally:
                self._connection = None
        if self._log_size() and state.base:
            self._check_log(state)
        if noted is not None and noted[0] == state.map.hex() and noted[1] > state.number:
            raise DataError(
                f"{self.path} has {state.number} changes of {noted[1]} that a process acknowledged "
                "before it was killed: its log (-wal) is damaged or was taken away. Put it or a "
                "backup back; to go on without them, delete the file with -lock beside it",
                code="lost-changes",
                fields=(str(self.path), str(state.number), str(noted[1])),
            )

    def _check_version(self) -> None:
        ((version,),) = self._all("PRAGMA user_version")
        if version != VERSION:
            raise DataError(
                f"{self.path} has version {version} of the format, expected {VERSION}: it was "
                "written by another fusionslam",
                code="newer-version" if version > VERSION else "older-version",
                fields=(str(self.path), str(version)),
            )

    def _check_schema(self) -> None:
        """Raise DataError for tables that are not a map's, before anything is asked of them.

        Views, triggers and columns of others could run statements of their own.
        """
        found = self._all("SELECT type, name, tbl_name, sql FROM sqlite_master")
        other = {row[1] for row in set(found) ^ schema()}
        if other or len(found) != len(schema()):
            names = ", ".join(sorted(map(str, other)))[:_LONGEST_WHY]
            raise self._damaged(f"its tables are not those of a map: {names or 'some are double'}")
        for name, expected in (("auto_vacuum", 0), ("encoding", "UTF-8")):
            if self._all(f"PRAGMA {name}") != [(expected,)]:
                raise self._damaged(f"its header has another {name}, expected {expected}")

    def _check_log(self, state: MapState) -> None:
        """Raise DataError if the log beside the file is not that of the file.

        The log continues a certain state of the file: on an older one, such as a backup, or on
        another map it would leave parts of both.
        """
        for _ in range(3):  # a writer may be at this very page
            problem = "none"
            try:
                with closing(connect(self.path, "ro&immutable=1")) as itself:
                    # A checkpoint that was broken off leaves a file shorter than its header says,
                    # which is then no damage.
                    itself.execute("PRAGMA writable_schema = ON")
                    alone = decode_state(itself.fetch("SELECT * FROM state"))
            except (sqlite3.Error, ValueError, TypeError, LookupError) as error:
                problem = str(error)
            else:
                if alone.map == state.map and alone.number >= state.base:
                    return
                problem = f"change {alone.number} of the file, {state.base} of the log"
            time.sleep(0.02)
        raise DataError(
            f"{self.path} and the log beside it (-wal) do not belong together ({problem}): put "
            "back the file that was there, or, to use this one as it is, delete the files with "
            "-wal, -shm and -lock",
            code="other-log",
            fields=(str(self.path),),
        )

    def _log_size(self) -> int:
        """Bytes of the log beside the file; 0 if there is none."""
        try:
            return Path(f"{self.path.resolve()}-wal").stat().st_size
        except OSError:
            return 0

    def _take_lock(self) -> None:
        """Raise DataError if another process has the map open for changes."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(self.path, why_not(self.path, error)) from error
        self._lock = WriteLock(self._lock_file(), self.path)

    def _lock_file(self) -> Path:
        return Path(f"{self.path.resolve()}-lock")  # links to a map lead to the same lock

    def _noted(self) -> tuple[str, int] | None:
        """The map and its last change that a writer noted in its lock; None if there is none."""
        lock = self._lock_file()
        if not lock.is_file():
            return None
        try:
            with lock.open("rb") as file:
                text = file.read(100).strip(b"\0")
        except OSError:
            return None
        if not text:  # not written yet
            return None
        try:
            name, number = text.decode("ascii").split()
            return name, int(number)
        except ValueError as error:
            raise self._damaged(f"the file with -lock beside it has no note: {error}") from error

    def _note(self, state: MapState) -> None:
        """Note the last change in the lock, where a damaged log does not take it away.

        It follows the change: what a lock has noted, the file has.
        """
        if self._lock is not None:
            with suppress(OSError):
                self._lock.note(f"{state.map.hex()} {state.number:019}")

    def _checkpoint(self, state: MapState, most: int = _MOST_LOGGED) -> None:
        """Take the log into the file if it is longer than ``most`` bytes.

        On a full disk it stays, as while another process reads.
        """
        size = self._log_size()
        if not size:
            self._base = state.number
        if size <= most:
            return
        self._database.execute("PRAGMA busy_timeout = 0")
        with suppress(sqlite3.Error):
            ((_, logged, done),) = self._database.fetch("PRAGMA wal_checkpoint(TRUNCATE)")
            if logged == done:
                self._base = state.number
        self._database.execute(f"PRAGMA busy_timeout = {1000 * PATIENCE_S}")

    def _is_in_place(self) -> bool:
        return _place_of(self.path) == self._place

    def _check_place(self) -> None:
        """Raise DataError if the open file is not that of the path: changes would be lost."""
        if self._place is not None and not self._is_in_place():
            raise self._replaced()

    def _make(self) -> None:
        database = self._database
        database.execute(f"PRAGMA page_size = {_PAGE}")
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("BEGIN IMMEDIATE")
        for statement in TABLES.split(";"):
            database.execute(statement)
        self._write_state(MapState(secrets.token_bytes(16), 1, 0, dict.fromkeys(KEYS, 0)))
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")
        database.execute("COMMIT")

    def _read_state(self) -> MapState:
        with self.decoding():
            return decode_state(self._all("SELECT * FROM state"))

    def _write_state(self, state: MapState) -> None:
        values = 0, *state[:3], json.dumps(state.seals)
        statement = "INSERT OR REPLACE INTO state VALUES (?, ?, ?, ?, ?, ?)"
        self._database.execute(statement, (*values, row_crc(values)))

    def _table(self, table: str, order: str = "") -> list[tuple[Any, ...]]:
        """Return all rows of a table, of which none may be missing; otherwise as ``_rows``."""
        with self.reading():
            state = self._state or self._read_state()
            rows = self._all(f"SELECT * FROM {table} {order}")
        with self.decoding():
            self._check_rows(table, rows)
            if seal(row[-1] for row in rows) != state.seals[table]:
                raise self._damaged(f"table {table}: rows are missing, or there twice")
        return [row[:-1] for row in rows]

    def _rows(self, table: str, rest: str = "", *values: Any) -> list[tuple[Any, ...]]:
        """Return whole rows of a table, without their CRC, which is checked."""
        rows = self._all(f"SELECT * FROM {table} {rest}", *values)
        with self.decoding():
            self._check_rows(table, rows)
        return [row[:-1] for row in rows]

    def _check_rows(self, table: str, rows: list[tuple[Any, ...]]) -> None:
        for row in rows:
            if row_crc(row[:-1]) != row[-1]:
                raise self._damaged(f"table {table}, row {row[0]}: its CRC is another one")

    def _store(self, table: str, *values: Any) -> None:
        """Write a whole row with its CRC, within a transaction; it replaces that of its key."""
        keys = KEYS[table]
        self._delete(table, " AND ".join(f"{key} = ?" for key in keys), *values[: len(keys)])
        places, crc = ", ".join("?" * (len(values) + 1)), row_crc(values)
        self._run(f"INSERT INTO {table} VALUES ({places})", *values, crc)
        self._add_to_seal(table, seal([crc]))

    def _delete(self, table: str, where: str, *values: Any) -> None:
        """Delete rows, within a transaction."""
        gone = self._all(f"SELECT crc FROM {table} WHERE {where}", *values)
        if gone:
            self._run(f"DELETE FROM {table} WHERE {where}", *values)
            self._add_to_seal(table, -seal(crc for (crc,) in gone))

    def _add_to_seal(self, table: str, change: int) -> None:
        assert self._state is not None, "a table is changed outside a transaction"
        self._state.seals[table] += change

    def _all(self, statement: str, *values: Any) -> list[tuple[Any, ...]]:
        with self._errors():
            return self._database.fetch(statement, values)

    def _run(self, statement: str, *values: Any) -> None:
        with self._errors():
            self._database.execute(statement, values)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Raise what SQLite says as DataError that names the file."""
        try:
            yield
        except UnicodeDecodeError as error:  # of the name of a table that SQLite would complain of
            raise self._damaged(str(error)) from error
        except sqlite3.Error as error:
            code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF  # no UTF-8
            if code == sqlite3.SQLITE_BUSY:
                raise locked_by_another(self.path) from error
            if code == sqlite3.SQLITE_NOTADB:
                raise self._other_format() from error
            if code == sqlite3.SQLITE_INTERRUPT:
                if self._connection is not None and self._connection.was_interrupted:
                    raise KeyboardInterrupt from error
                raise self._damaged("a statement does not end") from error
            if code in _CORRUPTED:
                raise self._damaged(str(error)) from error
            if self.read_only:
                raise cannot_read(self.path, error) from error
            raise cannot_write(self.path, error) from error

    @contextmanager
    def decoding(self) -> Iterator[None]:
        """Raise DataError (code "damaged") for values that are not what they should be."""
        try:
            yield
        except DataError as error:
            if str(self.path) in str(error):
                raise
            raise self._damaged(str(error)) from error
        except ConfigError as error:
            if error.code in ("unknown-name", "own-descriptor"):  # a descriptor that is not here
                named = f"{self.path}: {error}"
                raise DataError(named, code=error.code, fields=error.fields) from error
            raise self._damaged(str(error)) from error
        except (FusionSlamError, ValueError, TypeError, LookupError, OverflowError) as error:
            raise self._damaged(str(error)) from error
        except RecursionError as error:
            raise self._damaged("values are nested too deeply") from error

    def _other_format(self) -> DataError:
        return DataError(
            f"{self.path} is no map: expected a file made by `fusionslam map build` (.fsmap)",
            code="other-format",
            fields=(str(self.path),),
        )

    def _replaced(self) -> DataError:
        return DataError(
            f"{self.path} is no longer the file that was opened: it was replaced or deleted "
            "meanwhile, and what was added since is not in the one that is there now; open the "
            "map again",
            code="replaced",
            fields=(str(self.path),),
        )

    def _damaged(self, why: str) -> DataError:
        if len(why) > _LONGEST_WHY:
            why = why[:_LONGEST_WHY] + " ..."
        return DataError(f"{self.path} is damaged: {why}", code="damaged", fields=(str(self.path),))


def cannot_read(path: Path, why: object) -> DataError:
    """Make the error of a file that cannot be read."""
    return DataError(f"cannot read {path}: {why}", code="cannot-read", fields=(str(path),))


def is_map(path: PathLike) -> bool:
    """Whether a file is a map, whatever its name."""
    path = Path(path)
    try:
        if not path.is_file() or not path.stat().st_size:
            return False
    except (OSError, ValueError):
        return False
    try:
        with reader(path) as connection:
            found = connection.execute("PRAGMA application_id").fetchone()
    except sqlite3.Error:
        return False
    return bool(found == (APPLICATION_ID,))


_of_parents: list[Any] = []
"""Connections of the parent, which a child must not close."""


def _place_of(path: Path) -> tuple[int, int] | None:
    """Device and inode of a file; None if it is not there."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino
