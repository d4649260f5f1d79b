# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A database of places that several recordings and robots have seen."""

import math
import os
import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Self

import numpy as np

from fusionslam.base.arrays import Floats, Floats32, Integers
from fusionslam.base.files import PathLike
from fusionslam.base.write_lock import WriteLock, lock_folder
from fusionslam.config import explain_choice
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.fleet import lance_extra, vector_index
from fusionslam.fleet.place_rows import (
    CHECKSUM,
    SHOWN,
    DatabaseSettings,
    candidate_of,
    check_rows,
    check_vectors,
    poses_of,
    rows_of,
    schema_of,
    settings_of,
    thin_out,
)
from fusionslam.fleet.places import ABOUT, Candidate, PlaceFilter, Places, quote
from fusionslam.fleet.row_search import Search, exactly, nearest_rows, read_rows, scan
from fusionslam.fleet.segment import FOLDER, Segment
from fusionslam.fleet.vector_index import IndexReport, Kind, Lookup, Progress, read_report

__all__ = ["DatabaseSettings", "IndexReport", "PlaceDatabase", "Positions", "Session", "Version"]

_KEYS = 10_000  # looked up at a time


@dataclass(frozen=True)
class Session:
    """A recording in the database.

    Attributes:
        session, robot, site, region: its name, who drove, and where.
        places: number of them.
        first_ns, last_ns: when the first and the last were seen.
    """

    session: str
    robot: str
    site: str
    region: str
    places: int
    first_ns: int
    last_ns: int


@dataclass(frozen=True)
class Positions:
    """Where the places of a site are.

    Attributes:
        sessions: names of their recordings, (n).
        frames: int64 (n), numbers in their recordings.
        stamps_ns: int64 (n).
        poses: float64 (n, 4, 4), in a frame of the recording; NaN where unknown.
        every: so many places of a recording stand for one of these.
        counts: numbers of all places, by recording.
    """

    sessions: Sequence[str]
    frames: Integers
    stamps_ns: Integers
    poses: Floats
    every: int
    counts: Mapping[str, int]


@dataclass(frozen=True)
class Version:
    """A state of the database: each change makes one.

    Attributes:
        number: of the version.
        time: when it was made.
        places: number of them.
    """

    number: int
    time: datetime
    places: int


class PlaceDatabase:
    """Places in a folder or an object store; ``create`` or ``open`` makes it.

    Any number of processes read; they see changes at their next call. One at a time changes it,
    which a lock in the folder ensures. Object stores have no lock: let one process write. It may be
    shared by threads, not by forked processes, whose calls raise DataError (code "forked").

    Attributes:
        location: of the folder, or an address such as s3://bucket/places.
        settings: what its vectors are.
        read_only: whether this one changes nothing.
    """

    def __init__(
        self, location: str, table: Any, *, lock: WriteLock | None = None, read_only: bool = False
    ) -> None:
        self.location = location
        self.settings = settings_of(table.schema, location)
        self.read_only = read_only
        self._table, self._lock = table, lock
        self._is_pinned = self._is_closed = False
        self._process = os.getpid()
        self._lookup: Lookup | None = None
        self._looking = threading.Lock()

    @classmethod
    def create(
        cls,
        location: PathLike,
        settings: DatabaseSettings,
        *,
        storage_options: Mapping[str, str] | None = None,
    ) -> Self:
        """Make an empty database and open it.

        Args:
            location: of a folder that is made, or an address such as s3://bucket/places.
            settings: what its vectors are.
            storage_options: of the object store, as LanceDB documents them.

        Raises:
            ConfigError: the descriptor is unknown or not compared by l2.
            DataError: there is one already (code "exists"), or it cannot be written.
            FusionSlamError: LanceDB is not installed (code "missing-extra").
        """
        settings.check()
        place = str(location)
        table = lance_extra.create_table(place, schema_of(settings), storage_options)
        return cls(place, table, lock=_lock(place))

    @classmethod
    def open(
        cls,
        location: PathLike,
        *,
        expected: DatabaseSettings | None = None,
        read_only: bool = False,
        storage_options: Mapping[str, str] | None = None,
    ) -> Self:
        """Open a database.

        Args:
            location, storage_options: as for ``create``.
            expected: settings that it must have.
            read_only: whether nothing is changed; then others may write meanwhile.

        Raises:
            DataError: there is none (code "not-found"), something else is there ("other-format"),
                it is of another version ("newer-version", "older-version"), damaged ("damaged"),
                it cannot be read ("cannot-read"), or another process changes it ("locked").
            ConfigError: its settings are others (code "other-descriptor"); ``fields`` has the
                name of the first that differs, what was found, and what was expected.
            FusionSlamError: LanceDB is not installed (code "missing-extra").
        """
        place = str(location)
        lance_extra.check_location(place)
        lock = None if read_only else _lock(place)
        try:
            table = lance_extra.open_table(place, storage_options)
            database = cls(place, table, lock=lock, read_only=read_only)
            if expected is not None:
                database.settings.require(expected)
        except BaseException:
            if lock is not None:
                lock.release()
            raise
        return database

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        with self._reading() as table:
            return int(table.count_rows())

    def close(self) -> None:
        """Let others change the database; it cannot be used any more."""
        self._is_closed = True
        if self._lock is not None:
            self._lock.release()

    def add(self, places: Places) -> int:
        """Add places, all of them or none, and return how many are new.

        Those whose keys are there already are left out: adding again what a killed process may
        have added is right.

        Raises:
            ShapeError: an array of another length or shape; the first of ``fields`` is its name.
            DataError: vectors that are not finite (code "not-finite"), a key that is empty
                ("bad-key") or there twice ("duplicate-key"), a database that is read-only
                ("read-only"), or it cannot be written ("cannot-write").
        """
        import pyarrow as pa
        import pyarrow.compute as pc

        rows = rows_of(places, self.settings)
        with self._writing() as table:
            known = _known_keys(table, list(places.keys))
            if known:
                is_known = pc.is_in(rows["key"], value_set=pa.array(known, pa.string()))
                rows = rows.filter(pc.invert(is_known))
            if rows.num_rows:
                table.add(rows)
            return int(rows.num_rows)

    def known_keys(self, keys: Sequence[str]) -> set[str]:
        """Those of some keys that the database has."""
        with self._reading() as table:
            return set(_known_keys(table, list(keys)))

    def delete(self, where: PlaceFilter) -> int:
        """Delete places and return how many there were; no query finds them any more.

        Their bytes leave the disk with ``compact``.

        Raises:
            ConfigError: a filter that any place passes (code "empty-filter").
            DataError: read-only (code "read-only"), or it cannot be written ("cannot-write").
        """
        if where.is_any:
            raise ConfigError(
                "where: expected a site, region, robot, session or time, not any place",
                code="empty-filter",
                fields=("where",),
            )
        with self._writing() as table:
            return int(table.delete(where.sql()).num_deleted_rows)

    def delete_keys(self, keys: Sequence[str]) -> int:
        """Delete places by their keys; return how many of them there were.

        Raises:
            DataError: as ``delete``.
        """
        count = 0
        with self._writing() as table:
            for first in range(0, len(keys), _KEYS):
                some = ", ".join(map(quote, keys[first : first + _KEYS]))
                count += int(table.delete(f"key IN ({some})").num_deleted_rows)
        return count

    def build_index(
        self,
        *,
        recall: float = vector_index.RECALL,
        kind: Kind | None = None,
        progress: Progress | None = None,
    ) -> IndexReport:
        """Build the index anew, and measure its recall on the database's own vectors.

        Queries are 200 stored vectors with noise. So many partitions are searched that they find
        that share of the ten nearest, or all partitions. Small databases need no index.

        Args:
            recall: to reach, of the ten nearest.
            kind: whose index; None for FAISS's in a folder and LanceDB's in an object store.
            progress: called with a line of text for each step.

        Raises:
            ConfigError: recall is not within (0, 1] (code "limit").
            DataError: as ``add``, or a place is damaged (code "damaged").
        """
        if not 0 < recall <= 1:
            raise ConfigError(
                f"recall: expected more than 0, at most 1, not {recall}",
                code="limit",
                fields=("recall",),
            )
        with self._writing() as table:
            _check_all(table, self.location)
            kind = kind or ("lance" if lance_extra.is_remote(self.location) else "faiss")
            return vector_index.build(table, self.location, recall, kind, progress)

    def check(self) -> None:
        """Read all places and the index, and compare them with their checksums.

        Raises:
            DataError: one was changed after it was written, or cannot be read (code "damaged").
        """
        with self._reading() as table:
            _check_all(table, self.location)
            report = read_report(table)
            if report is not None and report.kind == "faiss":
                Segment(Path(self.location) / FOLDER / report.index, report.sha256)

    @property
    def index(self) -> IndexReport | None:
        """The report of the last ``build_index`` or ``compact``; None without index."""
        with self._reading() as table:
            return read_report(table)

    def compact(
        self, *, keep_s: float = 3600.0, renews: bool = True, progress: Progress | None = None
    ) -> None:
        """Merge small files, build the index anew with new rows, and drop old versions.

        Args:
            keep_s: age of versions that stay, for readers that are in the middle of one.
            renews: whether the index is built anew if need be; not, if ``build_index`` follows.
            progress: called with a line of text for each step.

        Raises:
            DataError: as ``add``.
        """
        with self._writing() as table:
            keep = timedelta(seconds=max(keep_s, 1e-3))  # LanceDB warns of zero
            table.optimize(cleanup_older_than=keep, delete_unverified=self._lock is not None)
            if renews:
                vector_index.renew(table, self.location, progress)

    def query(
        self, vectors: Any, k: int = 10, where: PlaceFilter | None = None, *, exact: bool = False
    ) -> list[list[Candidate]]:
        """Find the places nearest to each vector, nearest first.

        The index finds candidates; rows that are not in it yet are searched, too. Distances are
        exact.

        Args:
            vectors: float32 (q, D), or (D,) for one.
            k: number of places to find, at most.
            where: which places may be found.
            exact: whether all places are compared, which takes longer.

        Returns:
            A list for each vector.

        Raises:
            ShapeError: vectors of another length.
            DataError: vectors that are not finite (code "not-finite"), or the database is damaged
                ("damaged"), as a place that is found, or cannot be read ("cannot-read").
            ConfigError: k is less than 1 (code "limit").
        """
        if k < 1:
            raise ConfigError(f"k: expected at least 1, not {k}", code="limit", fields=("k",))
        queries = np.asarray(vectors)
        if queries.ndim not in (1, 2):
            raise ShapeError(
                f"vectors: expected float32 (q, {self.settings.length}), not {queries.shape}",
                fields=("vectors",),
            )
        rows = check_vectors("vectors", np.atleast_2d(queries), self.settings.length)
        with self._reading() as table:
            lookup = self._looked_up(table)
            search = _search(table, lookup, k, where, exact)
            return _best(table, [*nearest_rows(lookup.candidates, rows, search)], k, self.location)

    def count_by(self, column: str) -> dict[str, int]:
        """Number of places by one of site, region, robot and session.

        Raises:
            ConfigError: another column (code "choice").
        """
        if column not in ABOUT:
            raise ConfigError(
                f"column {column!r}: {explain_choice(column, ABOUT)}",
                code="choice",
                fields=("column", column),
            )
        counts: Counter[str] = Counter()
        with self._reading() as table:
            for batch in scan(table, [column]):
                for pair in batch[column].value_counts().to_pylist():
                    counts[pair["values"]] += pair["counts"]
        return dict(sorted(counts.items()))

    def sessions(self) -> list[Session]:
        """Recordings in the database, by name."""
        import pyarrow as pa

        columns = [*ABOUT, "stamp_ns"]
        with self._reading() as table:
            found = pa.Table.from_batches(
                scan(table, columns),
                pa.schema([table.schema.field(name) for name in columns]),
            )
        spans = [("stamp_ns", "count"), ("stamp_ns", "min"), ("stamp_ns", "max")]
        rows = found.group_by(list(ABOUT)).aggregate(spans).to_pylist()
        found = [
            Session(
                **{name: row[name] for name in ABOUT},
                places=row["stamp_ns_count"],
                first_ns=row["stamp_ns_min"],
                last_ns=row["stamp_ns_max"],
            )
            for row in rows
        ]
        return sorted(found, key=lambda one: (one.session, one.robot))

    def positions(self, site: str, most: int | None = None) -> Positions:
        """Where the places of a site are, by recording and frame.

        Args:
            site: name of the site.
            most: number of places that are returned, and one more for each recording; of more,
                every n-th of each recording, in the order in which they were added. None is all.
                The others are not kept in memory.
        """
        import pyarrow as pa

        sql = PlaceFilter(site=site).sql()
        with self._reading() as table:
            every = 1 if most is None else max(1, -(-table.count_rows(sql) // most))
            counts: Counter[str] = Counter()
            columns = [*SHOWN, CHECKSUM]
            found = pa.Table.from_batches(
                (thin_out(each, every, counts) for each in scan(table, columns, sql)),
                pa.schema([table.schema.field(name) for name in columns]),
            ).sort_by([("session", "ascending"), ("frame", "ascending")])
            check_rows(found, self.location)
        return Positions(
            found["session"].to_pylist(),
            found["frame"].to_numpy(),
            found["stamp_ns"].to_numpy(),
            poses_of(found["pose"]),
            every,
            dict(sorted(counts.items())),
        )

    def versions(self) -> list[Version]:
        """States of the database that ``at_version`` shows, oldest first."""
        with self._reading() as table:
            return [
                Version(
                    int(one["version"]),
                    one["timestamp"],
                    int(one["metadata"].get("total_rows", 0)),
                )
                for one in table.list_versions()
            ]

    def at_version(self, number: int) -> "PlaceDatabase":
        """A state of the database as it was, which nothing changes; it may have lost its index.

        Raises:
            DataError: there is none of this number any more (code "not-found").
        """
        if number not in {version.number for version in self.versions()}:
            raise DataError(
                f"{self.location} has no version {number} any more",
                code="not-found",
                fields=(self.location, str(number)),
            )
        with self._reading() as table:
            then = table._conn.open_table(table.name)
            then.checkout(number)
        database = PlaceDatabase(self.location, then, read_only=True)
        database._is_pinned = True
        return database

    @contextmanager
    def _reading(self, *, writing: bool = False) -> Iterator[Any]:
        """The table as it is now; ``writing`` is as of ``lance_extra.errors``."""
        if self._is_closed:
            raise DataError(f"{self.location} is closed", code="closed", fields=(self.location,))
        if self._process != os.getpid():  # LanceDB's threads are not there, and calls never return
            raise DataError(
                f"{self.location} was opened before this process was forked from another: LanceDB "
                "cannot be used here, expected a process that is spawned",
                code="forked",
                fields=(self.location,),
            )
        with lance_extra.errors(self.location, writing=writing):
            if not self._is_pinned and self._lock is None:
                self._table.checkout_latest()
            yield self._table

    @contextmanager
    def _writing(self) -> Iterator[Any]:
        if self.read_only:
            raise DataError(
                f"{self.location} is open read-only",
                code="read-only",
                fields=(self.location,),
            )
        with self._reading(writing=True) as table:
            yield table

    def _looked_up(self, table: Any) -> Lookup:
        """How the table is searched as it is now."""
        with self._looking:
            if self._lookup is None or self._lookup.version != table.version:
                self._lookup = vector_index.look_up(table, self.location, self._lookup)
            return self._lookup


def _check_all(table: Any, location: str) -> None:
    import pyarrow as pa

    for batch in scan(table, [*SHOWN, "vector", CHECKSUM]):
        check_rows(pa.Table.from_batches([batch]), location)


def _search(table: Any, lookup: Lookup, k: int, where: PlaceFilter | None, exact: bool) -> Search:
    sql = None if where is None or where.is_any else where.sql()
    usual = lookup.usual
    if (
        exact
        or usual is None
        or (sql is not None and table.count_rows(sql) < vector_index.FEWEST_ROWS)
    ):
        return exactly(k, sql)
    # Recall was measured with few neighbours; more of them lie in more lists.
    nprobes = usual.nprobes * math.ceil(k / vector_index.K)
    return Search(nprobes, max(usual.candidates, 3 * k), sql)


def _lock(location: str) -> WriteLock | None:
    return None if lance_extra.is_remote(location) else lock_folder(Path(location))


def _known_keys(table: Any, keys: list[str]) -> list[str]:
    """Those of the keys that a table has."""
    if not table.count_rows():
        return []
    known: list[str] = []
    for first in range(0, len(keys), _KEYS):
        some = keys[first : first + _KEYS]
        sql = f"key IN ({', '.join(quote(key) for key in some)})"
        found = table.search().where(sql).select(["key"]).limit(2 * len(some) + 1).to_arrow()
        known += found["key"].to_pylist()
    return known


def _best(
    table: Any, found: list[tuple[Integers, Floats32]], k: int, location: str
) -> list[list[Candidate]]:
    """The k nearest of each query, each key once."""
    rows = read_rows(table, [numbers[:k] for numbers, _ in found], location)
    best = [_once(some, *one) for some, one in zip(rows, found, strict=True)]
    for place, (numbers, distances) in enumerate(found):
        if len(best[place]) < min(k, len(numbers)):  # a key is there twice
            (some,) = read_rows(table, [numbers], location)
            best[place] = _once(some, numbers, distances)[:k]
    return best


def _once(rows: Any, numbers: Integers, distances: Floats32) -> list[Candidate]:
    """Candidates of some rows, those of each key once."""
    far = dict(zip(numbers.tolist(), distances.tolist(), strict=True))
    found: dict[str, Candidate] = {}
    for row in rows.to_pylist():
        found.setdefault(row["key"], candidate_of(row, far[row["_rowid"]]))
    return [*found.values()]
