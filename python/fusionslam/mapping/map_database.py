# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The SQLite database of a map: opened, locked against other writers, of a known version."""

import errno
import fcntl
import os
import sqlite3
import stat
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from fusionslam.errors import DataError, FusionSlamError
from fusionslam.storage.files import PathLike, cannot_write, why_not

APPLICATION_ID = 0x66736D70
VERSION = 1
_PAGE = 65536
_MOST_LOGGED = 64
"""Pages in the write-ahead log, some 4 MB, before they go into the file."""

_TABLES = """
CREATE TABLE setting (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE session (
  id INTEGER PRIMARY KEY,
  name TEXT NOT NULL UNIQUE
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

_MIGRATIONS: Mapping[int, str] = {}
"""What makes version n + 1 of version n."""


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
            ("newer-version"), changed by another process ("locked"), missing ("not-found"), or it
            cannot be written ("cannot-write").
    """

    def __init__(self, path: PathLike, *, read_only: bool = False) -> None:
        self.path = Path(path)
        self.read_only = read_only
        self._lock = -1
        self._lock_file: Path | None = None
        self._connection: sqlite3.Connection | None = None
        self._is_new = False
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
        """
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

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """What is changed within counts as a whole, once it ends, or not at all.

        Raises:
            DataError: it cannot be written, as on a full disk; nothing has changed.
        """
        with self._errors():
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._database.execute("COMMIT")
            except BaseException:
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")
                raise

    @contextmanager
    def reading(self) -> Iterator[None]:
        """All that is read within is of one moment."""
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
        return found + [f"table {row[0]}, row {row[1]}: its {row[2]} is missing" for row in broken]

    @property
    def _database(self) -> sqlite3.Connection:
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
        if exists:
            self._check_kind()
        if not self.read_only:
            self._take_lock()
            self._is_new = not self.path.exists()
            self._connection = _connect(self.path, "rwc")
        else:
            self._connection = _connect_read_only(self.path)
        version = self._one("PRAGMA user_version")
        found = self._one("PRAGMA application_id")
        is_new = version == (0,) and found == (0,) and not self._all("SELECT * FROM sqlite_master")
        if is_new and not self.read_only:
            self._make()
        elif found != (APPLICATION_ID,):
            raise self._other_format()
        else:
            assert version is not None
            self._migrate(int(version[0]))
        self._database.execute("PRAGMA foreign_keys = ON")
        if not self.read_only:
            # Each step reaches the disk: what was acknowledged survives a power cut, too.
            self._database.execute("PRAGMA synchronous = FULL")
            self._database.execute(f"PRAGMA wal_autocheckpoint = {_MOST_LOGGED}")

    def _check_kind(self) -> None:
        """Raise DataError for what is no map before SQLite makes files beside it.

        Nothing but SQLite opens the file: closing it would give up the locks that other
        connections of this process hold (POSIX).
        """
        size = self.path.stat().st_size
        if not size:
            return
        with _reader(self.path) as connection:
            identity = connection.execute("PRAGMA application_id").fetchone()[0]
            page = connection.execute("PRAGMA page_size").fetchone()[0]
        if identity != APPLICATION_ID:
            raise self._other_format()
        # A disk that was full leaves a part of a page, which the log beside the file has whole.
        log = self.path.with_name(f"{self.path.name}-wal")
        if size % page and not (log.exists() and log.stat().st_size):
            raise self._damaged(f"it is cut off, {size} bytes are no multiple of {page}")

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

    def _make(self) -> None:
        database = self._database
        database.execute(f"PRAGMA page_size = {_PAGE}")
        database.execute("PRAGMA journal_mode = WAL")
        with self.transaction():
            for statement in _TABLES.split(";"):
                database.execute(statement)
            database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            database.execute(f"PRAGMA user_version = {VERSION}")

    def _migrate(self, version: int) -> None:
        if version > VERSION:
            raise DataError(
                f"{self.path} has version {version} of the format, this fusionslam reads up to "
                f"{VERSION}: it was written by a later one",
                code="newer-version",
                fields=(str(self.path), str(version)),
            )
        if version < VERSION and self.read_only:
            raise DataError(
                f"{self.path} has version {version} of the format: open it once for writing, "
                f"which makes it version {VERSION}",
                code="older-version",
                fields=(str(self.path), str(version)),
            )
        for step in range(version, VERSION):
            with self.transaction():
                for statement in _MIGRATIONS[step].split(";"):
                    self._database.execute(statement)
                self._database.execute(f"PRAGMA user_version = {step + 1}")

    def _rows(self, table: str, rest: str = "", *values: Any) -> list[tuple[Any, ...]]:
        """Return whole rows of a table, without their CRC, which is checked."""
        rows = self._all(f"SELECT * FROM {table} {rest}", *values)
        with self.decoding():
            for row in rows:
                if row_crc(row[:-1]) != row[-1]:
                    raise self._damaged(f"table {table}, row {row[0]}: its CRC is another one")
        return [row[:-1] for row in rows]

    def _store(self, table: str, *values: Any, verb: str = "INSERT OR REPLACE") -> None:
        """Write a whole row with its CRC."""
        places = ", ".join("?" * (len(values) + 1))
        self._run(f"{verb} INTO {table} VALUES ({places})", *values, row_crc(values))

    def _one(self, statement: str, *values: Any) -> tuple[Any, ...] | None:
        with self._errors():
            row: tuple[Any, ...] | None = self._database.execute(statement, values).fetchone()
        return row

    def _all(self, statement: str, *values: Any) -> list[tuple[Any, ...]]:
        with self._errors():
            return self._database.execute(statement, values).fetchall()

    def _run(self, statement: str, *values: Any) -> int:
        with self._errors():
            return self._database.execute(statement, values).lastrowid or 0

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Raise what SQLite says as DataError that names the file."""
        try:
            yield
        except sqlite3.Error as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code == sqlite3.SQLITE_BUSY:
                raise self._locked() from error
            if code == sqlite3.SQLITE_NOTADB:
                raise self._other_format() from error
            if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CONSTRAINT):
                raise self._damaged(str(error)) from error
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

    def _damaged(self, why: str) -> DataError:
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


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    place = path.resolve().as_uri()
    return sqlite3.connect(
        f"{place}?mode={mode}", uri=True, isolation_level=None, timeout=10, check_same_thread=False
    )


@contextmanager
def _reader(path: Path) -> Iterator[sqlite3.Connection]:
    with closing(_connect_read_only(path)) as connection:
        yield connection
    _delete_empty_log(path)


def _delete_empty_log(path: Path) -> None:
    """Delete the files beside a map that its last reader leaves, as SQLite lets only writers.

    A log that is not empty has what a killed writer left for the next one.
    """
    with suppress(OSError, sqlite3.Error):
        if not Path(f"{path.resolve()}-wal").stat().st_size:
            with closing(_connect(path, "rw")) as connection:
                connection.execute("PRAGMA schema_version")


def _connect_read_only(path: Path) -> sqlite3.Connection:
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
