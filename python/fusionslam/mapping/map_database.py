# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The SQLite database of a map: opened, locked against other writers, of a known version."""

import errno
import fcntl
import json
import os
import secrets
import sqlite3
import stat
import struct
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Self

from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.storage.files import PathLike, cannot_write, why_not

APPLICATION_ID = 0x66736D70
VERSION = 2
_PAGE = 65536
_MOST_LOGGED = 64 * _PAGE
"""Bytes in the write-ahead log before they go into the file."""

_TABLES = """
CREATE TABLE state (
  id INTEGER PRIMARY KEY CHECK (id = 0),
  map BLOB NOT NULL,
  number INTEGER NOT NULL,
  base INTEGER NOT NULL,
  seals TEXT NOT NULL,
  crc INTEGER NOT NULL
);
CREATE TABLE setting (
  name TEXT PRIMARY KEY,
  value TEXT NOT NULL,
  crc INTEGER NOT NULL
);
CREATE TABLE session (
  id INTEGER PRIMARY KEY,
  name TEXT NOT NULL UNIQUE,
  crc INTEGER NOT NULL
);
CREATE TABLE keyframe (
  id INTEGER PRIMARY KEY,
  session INTEGER NOT NULL REFERENCES session (id) ON DELETE CASCADE,
  frame INTEGER NOT NULL,
  stamp_ns INTEGER NOT NULL,
  odometry BLOB NOT NULL,
  robot_from_cloud BLOB NOT NULL,
  crc INTEGER NOT NULL
);
CREATE INDEX keyframe_session ON keyframe (session);
CREATE TABLE cloud (
  keyframe INTEGER PRIMARY KEY REFERENCES keyframe (id) ON DELETE CASCADE,
  evidence BLOB NOT NULL,
  image BLOB,
  ground_level REAL NOT NULL,
  points BLOB NOT NULL,
  crc INTEGER NOT NULL
);
CREATE TABLE vector (
  descriptor TEXT NOT NULL,
  first INTEGER NOT NULL,
  keyframes BLOB NOT NULL,
  rows BLOB NOT NULL,
  crc INTEGER NOT NULL,
  PRIMARY KEY (descriptor, first)
);
CREATE TABLE edge (
  id INTEGER PRIMARY KEY,
  kind TEXT NOT NULL,
  a INTEGER NOT NULL REFERENCES keyframe (id) ON DELETE CASCADE,
  b INTEGER NOT NULL REFERENCES keyframe (id) ON DELETE CASCADE,
  pose BLOB NOT NULL,
  covariance BLOB NOT NULL,
  state TEXT NOT NULL,
  code TEXT,
  number REAL,
  text TEXT,
  crc INTEGER NOT NULL
);
CREATE INDEX edge_a ON edge (a);
CREATE INDEX edge_b ON edge (b);
CREATE TABLE solution (
  id INTEGER PRIMARY KEY CHECK (id = 0),
  keyframes BLOB NOT NULL,
  poses BLOB NOT NULL,
  parts BLOB NOT NULL,
  crc INTEGER NOT NULL
);
"""

_KEYS: Mapping[str, tuple[str, ...]] = {
    "setting": ("name",),
    "session": ("id",),
    "keyframe": ("id",),
    "cloud": ("keyframe",),
    "vector": ("descriptor", "first"),
    "edge": ("id",),
    "solution": ("id",),
}
"""Columns that tell the rows of a table apart, which come first."""

_FEWEST_STEPS = 10_000_000
_STEPS_PER_BYTE = 2
_STEPS_AT_ONCE = 100_000
"""Steps of SQLite's machine, some 100 million a second: what a statement has for a file of this
size, before it is broken off, and how many go by between two looks at that and at Ctrl-C."""
_CORRUPTED = (
    *(sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CONSTRAINT, sqlite3.SQLITE_AUTH),
    *(sqlite3.SQLITE_TOOBIG, sqlite3.SQLITE_MISMATCH, sqlite3.SQLITE_FORMAT, sqlite3.SQLITE_SCHEMA),
)
_LONGEST_VALUE = 10**9  # bytes
_PATIENCE_S = 10  # with another process
_LONGEST_WHY = 300  # characters of a message


class _State(NamedTuple):
    """The row of table ``state``.

    Attributes:
        map: number of the map, by which its log is known; copies of the file have the same.
        number: of the change that wrote this, from 1 on.
        base: number of the change up to which the file itself, without its log, has all.
        seals: by table, its rows' number x 2**32 + the sum of their CRCs: none is missing.
    """

    map: bytes
    number: int
    base: int
    seals: dict[str, int]


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
        self._lock = -1
        self._lock_file: Path | None = None
        self._connection: _Connection | None = None
        self._is_new = False
        self._process = os.getpid()
        self._place: tuple[int, int] | None = None  # device and inode of the open file
        self._state: _State | None = None  # within a transaction: what it will have
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
        if os.getpid() != self._process:
            # All belongs to the parent: closing here would take its log and its lock away.
            _of_parents.append(self._connection)
            self._connection, self._lock, self._lock_file = None, -1, None
            return
        is_lost = self._has_changed and not failed and not self._is_in_place()
        if self._connection is not None:
            self._connection.close()
            self._connection = None
            if self.read_only:
                _delete_empty_log(self.path)
        if failed and self._is_new:
            self.path.resolve().unlink(missing_ok=True)
        if self._lock >= 0:
            if self._lock_file is not None:
                self._lock_file.unlink(missing_ok=True)
            os.close(self._lock)
            self._lock, self._lock_file = -1, None
        self._has_changed = False
        if is_lost:
            raise self._replaced()

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
        for table in _KEYS.keys() - {"cloud"}:  # clouds are too many to be read at once
            try:
                self._table(table)
            except DataError as error:
                found.append(str(error))
        return found

    @property
    def _database(self) -> "_Connection":
        if os.getpid() != self._process:
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
            self._connection = _connect(self.path, "rwc")
        else:
            self._connection = _connect_read_only(self.path)
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
        with _reader(self.path) as self._connection:
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
        other = {row[1] for row in set(found) ^ _schema()}
        if other or len(found) != len(_schema()):
            names = ", ".join(sorted(map(str, other)))[:_LONGEST_WHY]
            raise self._damaged(f"its tables are not those of a map: {names or 'some are double'}")
        for name, expected in (("auto_vacuum", 0), ("encoding", "UTF-8")):
            if self._all(f"PRAGMA {name}") != [(expected,)]:
                raise self._damaged(f"its header has another {name}, expected {expected}")

    def _check_log(self, state: _State) -> None:
        """Raise DataError if the log beside the file is not that of the file.

        The log continues a certain state of the file: on an older one, such as a backup, or on
        another map it would leave parts of both.
        """
        for _ in range(3):  # a writer may be at this very page
            problem = "none"
            try:
                with closing(_connect(self.path, "ro&immutable=1")) as itself:
                    # A checkpoint that was broken off leaves a file shorter than its header says,
                    # which is then no damage.
                    itself.execute("PRAGMA writable_schema = ON")
                    alone = _decode_state(itself.fetch("SELECT * FROM state"))
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
        path = self.path.resolve()  # links to a map lead to the same lock
        beside = path.with_name(f"{path.name}-lock")
        while True:
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                lock = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            except OSError as error:
                raise cannot_write(self.path, why_not(self.path, error)) from error
            self._lock = lock
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise self._locked() from error
            with suppress(FileNotFoundError):
                if beside.stat().st_ino == os.fstat(lock).st_ino:
                    self._lock_file = beside
                    return
            os.close(lock)  # its last owner deleted it meanwhile

    def _noted(self) -> tuple[str, int] | None:
        """The map and its last change that a writer noted in its lock; None if there is none."""
        lock = Path(f"{self.path.resolve()}-lock")
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

    def _note(self, state: _State) -> None:
        """Note the last change in the lock, where a damaged log does not take it away.

        It follows the change: what a lock has noted, the file has.
        """
        with suppress(OSError):
            os.pwrite(self._lock, f"{state.map.hex()} {state.number:019}".encode(), 0)

    def _checkpoint(self, state: _State, most: int = _MOST_LOGGED) -> None:
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
        self._database.execute(f"PRAGMA busy_timeout = {1000 * _PATIENCE_S}")

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
        for statement in _TABLES.split(";"):
            database.execute(statement)
        self._write_state(_State(secrets.token_bytes(16), 1, 0, dict.fromkeys(_KEYS, 0)))
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")
        database.execute("COMMIT")

    def _read_state(self) -> _State:
        with self.decoding():
            return _decode_state(self._all("SELECT * FROM state"))

    def _write_state(self, state: _State) -> None:
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
            if _seal(row[-1] for row in rows) != state.seals[table]:
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
        keys = _KEYS[table]
        self._delete(table, " AND ".join(f"{key} = ?" for key in keys), *values[: len(keys)])
        places, crc = ", ".join("?" * (len(values) + 1)), row_crc(values)
        self._run(f"INSERT INTO {table} VALUES ({places})", *values, crc)
        self._add_to_seal(table, _seal([crc]))

    def _delete(self, table: str, where: str, *values: Any) -> None:
        """Delete rows, within a transaction."""
        gone = self._all(f"SELECT crc FROM {table} WHERE {where}", *values)
        if gone:
            self._run(f"DELETE FROM {table} WHERE {where}", *values)
            self._add_to_seal(table, -_seal(crc for (crc,) in gone))

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
                raise self._locked() from error
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

    def _locked(self) -> DataError:
        return DataError(
            f"{self.path} is being changed by another process: wait for it, or open the map "
            "read-only",
            code="locked",
            fields=(str(self.path),),
        )

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


def row_crc(values: Iterable[Any]) -> int:
    """CRC-32 of a row: of integers and numbers as int64 and float64, of texts as UTF-8."""
    crc = 0
    for value in values:
        if isinstance(value, int | float):
            value = struct.pack("<q" if isinstance(value, int) else "<d", value)
        elif isinstance(value, str):
            value = value.encode()
        crc = zlib.crc32(value or b"", crc)
    return crc


def is_map(path: PathLike) -> bool:
    """Whether a file is a map, whatever its name."""
    path = Path(path)
    try:
        if not path.is_file() or not path.stat().st_size:
            return False
    except (OSError, ValueError):
        return False
    try:
        with _reader(path) as connection:
            found = connection.execute("PRAGMA application_id").fetchone()
    except sqlite3.Error:
        return False
    return bool(found == (APPLICATION_ID,))


_of_parents: list[Any] = []
"""Connections of the parent, which a child must not close."""


class _Connection(sqlite3.Connection):
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
            int(super(_Connection, self).execute(f"PRAGMA {name}").fetchone()[0])
            for name in ("page_count", "page_size")
        )
        return max(count * page, _PAGE)

    def _allow(self, steps: int) -> None:
        self._left = left = [steps // _STEPS_AT_ONCE]

        def is_over() -> bool:  # an exception in here, as of Ctrl-C, ends the statement, too
            left[0] -= 1
            return left[0] < 0

        self.set_progress_handler(is_over, _STEPS_AT_ONCE)


def _connect(path: Path, mode: str) -> _Connection:
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?mode={mode}",
        uri=True,
        isolation_level=None,
        timeout=_PATIENCE_S,
        check_same_thread=False,
        factory=_Connection,
    )
    assert isinstance(connection, _Connection)
    for setting in ("trusted_schema = OFF", "cell_size_check = ON"):
        connection.execute(f"PRAGMA {setting}")
    return connection


@cache
def _schema() -> set[tuple[str, str, str, str | None]]:
    """Type, name, table and statement of all that a map's file has."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(_TABLES)
        return {*database.execute("SELECT type, name, tbl_name, sql FROM sqlite_master")}


def _seal(crcs: Iterable[int]) -> int:
    return sum(2**32 + crc for crc in crcs)


def _decode_state(rows: list[tuple[Any, ...]]) -> _State:
    """Raises ValueError or TypeError for rows that are not the one of table ``state``."""
    if len(rows) != 1 or row_crc(rows[0][:-1]) != rows[0][-1]:
        raise ValueError("table state: its CRC is another one")
    _, name, number, base, seals = rows[0][:-1]
    sums = {table: int(value) for table, value in json.loads(seals).items()}
    return _State(bytes(name), int(number), int(base), sums)


def _place_of(path: Path) -> tuple[int, int] | None:
    """Device and inode of a file; None if it is not there."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


@contextmanager
def _reader(path: Path) -> Iterator[_Connection]:
    try:
        with closing(_connect_read_only(path)) as connection:
            yield connection
    finally:
        _delete_empty_log(path)


def _delete_empty_log(path: Path) -> None:
    """Delete the files beside a map that its last reader leaves, as SQLite lets only writers.

    A log that is not empty has what a killed writer left for the next one.
    """
    with suppress(OSError, sqlite3.Error):
        if not Path(f"{path.resolve()}-wal").stat().st_size:
            with closing(_connect(path, "rw")) as connection:
                connection.execute("PRAGMA schema_version")


def _connect_read_only(path: Path) -> _Connection:
    """Connect for reading, where nothing may be written beside the file, too."""
    connection = _connect(path, "ro")
    try:
        connection.execute("PRAGMA schema_version")
    except sqlite3.OperationalError as error:
        connection.close()
        beside = Path(f"{path.resolve()}-wal")
        refused = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)
        if error.sqlite_errorcode & 0xFF not in refused or beside.exists():
            raise
        return _connect(path, "ro&immutable=1")
    except sqlite3.Error:
        connection.close()
        raise
    return connection
