# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the index of a table of places, and measures its recall on the table's own vectors."""

import logging
import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from fusionslam.base.archive import dump_sealed, parse_sealed
from fusionslam.base.arrays import Floats, Floats32, Integers
from fusionslam.errors import DataError
from fusionslam.fleet.place_rows import vectors_of
from fusionslam.fleet.row_search import (
    BySegment,
    Candidates,
    Search,
    lance_candidates,
    nearest_rows,
    scan,
)
from fusionslam.fleet.segment import (
    FOLDER,
    Segment,
    delete_segments,
    digest_of,
    size_of,
    write_segment,
)

logger = logging.getLogger(__name__)

FEWEST_ROWS = 5_000
"""Of a table that has an index: smaller ones are searched as fast without."""

K = 10
"""Neighbours whose recall is measured."""
RECALL = 0.99
"""To reach, if nothing else is asked for."""

Progress = Callable[[str], None]

_QUERIES = 200
_NOISE = 0.3  # of queries that measure recall, in deviations of the vectors
_SEED = 1
_PARTITION = 800  # rows of a list of LanceDB
_TRAINING = 128  # rows for each of these
_ROUNDS = 25  # of k-means
_MARGIN = 2  # times the lists that suffice for the queries that measure recall
_CANDIDATES = (30, 100, 400)
_CAREFUL = 0.1  # of LanceDB's lists are searched while recall is not measured


Kind = Literal["faiss", "lance", "exact"]
"""An IVF of FAISS or LanceDB, one byte a value, or none."""

_KEY = "fusionslam.index"
_SEGMENT = re.compile(r"[0-9a-f]{16}\.faiss")


@dataclass(frozen=True)
class IndexReport:
    """How good the index of a table is, and how it is searched; by default, without an index.

    Attributes:
        rows: of the table when the index was built.
        last_row: the greatest number of a row that it had then.
        partitions: number of the index's lists, about; 0 without index.
        kind: FAISS's segment beside the table, LanceDB's own index, or "exact" for a small table,
            which has no index.
        nprobes: partitions searched by a query.
        candidates: rows that are compared exactly.
        wanted: recall that was asked for.
        recall: share of the true ten nearest that queries find.
        first: share of queries that find the true nearest.
        queries: number of them that recall was measured with.
        seconds: that building and measuring took.
        index: identity of the index that was measured: name of the segment, or LanceDB's.
        size: of the segment's files, bytes.
        sha256: of the segment's files, as of ``segment.digest_of``.
    """

    rows: int
    last_row: int
    partitions: int = 0
    kind: Kind = "exact"
    nprobes: int = 0
    candidates: int = 0
    wanted: float = 1.0
    recall: float = 1.0
    first: float = 1.0
    queries: int = 0
    seconds: float = 0.0
    index: str = ""
    size: int = 0
    sha256: str = ""

    def __post_init__(self) -> None:
        if self.kind == "faiss" and not _SEGMENT.fullmatch(self.index):
            raise ValueError(f"{self.index!r} is no name of a segment")


def read_report(table: Any) -> IndexReport | None:
    """Return the report that a table carries; None, and a line in the log, if it is damaged."""
    text = (table.schema.field("vector").metadata or {}).get(_KEY.encode())
    try:
        return IndexReport(**parse_sealed(text)) if text else None
    except (DataError, ValueError, TypeError) as error:
        logger.warning("the report of an index cannot be read: %s", error)
        return None


def write_report(table: Any, report: IndexReport) -> None:
    """Store a report in the table, which is one commit."""
    table.update_field_metadata({"path": "vector", "metadata": {_KEY: dump_sealed(asdict(report))}})


@dataclass(frozen=True)
class Lookup:
    """How a table is searched, as it is at one version.

    Attributes:
        version: of the table.
        usual: how its index is searched for the measured recall; None without index.
        candidates: finds rows.
    """

    version: int
    usual: Search | None
    candidates: Candidates


def look_up(table: Any, location: str, before: Lookup | None) -> Lookup:
    """Return how a table is searched now.

    An index of LanceDB that was not measured yet, as its process was killed, is searched with
    care; without a segment that it should have, the whole table is searched.

    Args:
        table: LanceDB's.
        location: of the folder that it is in.
        before: what was returned for an earlier version.
    """
    version = int(table.version)  # first: what changes meanwhile is looked up again
    report = read_report(table)
    if report is not None and report.kind == "exact":
        return Lookup(version, None, partial(lance_candidates, table))
    if report is not None and report.kind == "faiss":
        usual = Search(report.nprobes, report.candidates)
        known = before.candidates if before is not None else None
        known = known if isinstance(known, BySegment) else None
        try:
            segment = (
                known.segment
                if known is not None and known.segment.name == report.index
                else Segment(Path(location) / FOLDER / report.index, report.sha256)
            )
        except DataError as error:
            logger.warning("%s: all places are compared until `fleet index` makes one", error)
            return Lookup(version, None, partial(lance_candidates, table))
        return Lookup(version, usual, BySegment(table, segment, report.last_row, known))
    index, search = _lance_index(table), None
    if index is not None:
        search = Search(math.ceil(_CAREFUL * _lance_lists(table.count_rows())), _CANDIDATES[-1])
        if report is not None and report.index == index.index_uuid:
            search = Search(report.nprobes, report.candidates)
    return Lookup(version, search, partial(lance_candidates, table))


def build(
    table: Any, location: str, recall: float, kind: Kind, progress: Progress | None
) -> IndexReport:
    """Build the index of vectors, and those of keys and filters, and measure recall.

    A table of less than ``FEWEST_ROWS`` has none.

    Args:
        table: LanceDB's.
        location: of the folder that it is in.
        recall: to reach, by searching more lists.
        kind: whose index.
        progress: called with a line of text for each step.
    """
    say, started = progress or (lambda text: None), time.monotonic()
    rows, last_row, folder = table.count_rows(), _last_row(table), Path(location) / FOLDER
    if rows < FEWEST_ROWS:
        if read_report(table) is not None:
            write_report(table, IndexReport(rows, last_row))
            delete_segments(folder, but="")
        return IndexReport(rows, last_row)
    say("index of keys and filters")
    _index_columns(table)
    say("index of vectors")
    size, digest = 0, ""
    if kind == "faiss":
        path = write_segment(folder, rows, last_row, lambda: _blocks(table), say)
        size, digest = size_of(path), digest_of(path)
        segment = Segment(path, digest)
        candidates: Candidates = BySegment(table, segment, last_row)
        name, partitions = segment.name, segment.lists
    else:
        _build_by_lance(table)
        candidates, partitions = partial(lance_candidates, table), _lance_lists(rows)
        name = _lance_index(table).index_uuid
    search, (found, first), queries = _measure(table, candidates, partitions, recall, say)
    report = IndexReport(
        rows=rows,
        last_row=last_row,
        partitions=partitions,
        kind=kind,
        nprobes=search.nprobes,
        candidates=search.candidates,
        wanted=recall,
        recall=found,
        first=first,
        queries=queries,
        seconds=time.monotonic() - started,
        index=name,
        size=size,
        sha256=digest,
    )
    write_report(table, report)
    delete_segments(folder, but=name)
    return report


def renew(table: Any, location: str, progress: Progress | None) -> None:
    """Build an index anew that is gone, or that rows were added to or deleted from since."""
    report = read_report(table)
    if report is None:
        if _lance_index(table) is not None:  # the process that built it was killed
            build(table, location, RECALL, "lance", progress)
        return
    is_there = report.kind != "faiss" or (Path(location) / FOLDER / report.index).exists()
    if is_there and (report.rows, report.last_row) == (table.count_rows(), _last_row(table)):
        return
    if report.kind != "exact":
        build(table, location, report.wanted, report.kind, progress)


def _index_columns(table: Any) -> None:
    from lancedb.index import Bitmap, BTree

    table.create_index("key", config=BTree())
    for name in ("site", "robot", "session"):
        table.create_index(name, config=Bitmap())


def _build_by_lance(table: Any) -> None:
    from lancedb.index import IvfSq

    config = IvfSq(
        distance_type="l2",
        target_partition_size=_PARTITION,
        sample_rate=_TRAINING,
        max_iterations=_ROUNDS,
    )
    table.create_index("vector", config=config)


def _blocks(table: Any) -> Iterator[tuple[Integers, Floats32]]:
    for batch in scan(table, ["vector", "_rowid"]):
        numbers = batch["_rowid"].to_numpy().astype(np.int64)
        yield numbers, vectors_of(batch["vector"], batch["vector"].type.list_size)


def _last_row(table: Any) -> int:
    numbers = (batch["_rowid"].to_numpy().max(initial=0) for batch in scan(table, ["_rowid"]))
    return int(max(numbers, default=-1))


def _lance_index(table: Any) -> Any:
    return next((one for one in table.list_indices() if one.columns == ["vector"]), None)


def _lance_lists(rows: int) -> int:
    return max(1, rows // _PARTITION)


def _measure(
    table: Any, candidates: Candidates, partitions: int, recall: float, say: Progress
) -> tuple[Search, tuple[float, float], int]:
    """Find how many lists to search for a recall; return this, the shares, and the queries."""
    queries = _sample(table)
    say(f"exact answers of {len(queries)} queries")
    true = _distances_of_neighbours(table, queries)

    def measured(search: Search) -> tuple[float, float]:
        return _shares(candidates, queries, true, search)

    search, shares = _choose(partitions, recall, measured, say)
    return search, shares, len(queries)


def _choose(
    partitions: int, recall: float, measured: Callable[[Search], tuple[float, float]], say: Progress
) -> tuple[Search, tuple[float, float]]:
    """Search some times the lists with which recall is reached and the nearest is always found.

    Few queries cannot tell 0.999 from 0.995. Of so many lists as few rows are then compared exactly
    as do. If recall is not reached, the best search is chosen.
    """
    wanted, best = (recall, 1.0), (Search(0, 0), (-1.0, 0.0))
    for nprobes in _numbers_of_lists(partitions):
        search = Search(nprobes, _CANDIDATES[-1])
        found = measured(search)
        say(f"{nprobes} lists, {search.candidates} candidates: recall {found[0]:.4f}")
        best = max(best, (search, found), key=lambda one: one[1])
        if found[0] >= recall and found[1] == 1.0:
            best = Search(min(_MARGIN * nprobes, 2 * partitions), _CANDIDATES[-1]), wanted
            break
    for candidates in _CANDIDATES:
        search = best[0]._replace(candidates=candidates)
        found = measured(search)
        if found >= best[1] and found[1] >= best[1][1]:
            break
    return search, found


def _numbers_of_lists(partitions: int) -> Iterator[int]:
    nprobes = 2
    while nprobes < partitions:  # some of which may have been split
        yield nprobes
        nprobes += max(1, nprobes // 2)
    yield 2 * partitions


def _sample(table: Any) -> Floats32:
    """Stored vectors from all over the table with noise, float32 (q, D)."""
    rng = np.random.default_rng(_SEED)
    rows = table.count_rows()
    offsets = np.sort(rng.choice(rows, min(_QUERIES, rows), replace=False))
    found = table.take_offsets(offsets.tolist()).select(["vector"]).to_arrow()["vector"]
    stored = vectors_of(found, found.type.list_size)
    noise = _NOISE * stored.std(axis=0) * rng.standard_normal(stored.shape)
    return np.asarray(stored + noise, np.float32)


def _distances_of_neighbours(table: Any, queries: Floats32) -> Floats:
    """Distances of each query to its nearest, by brute force; rows are read in blocks.

    Returns:
        float64 (q, K), nearest first.
    """
    wide = queries.astype(np.float64)
    norms = (wide**2).sum(axis=1)[:, None]
    nearest = np.full((len(wide), K), np.inf)
    for batch in scan(table, ["vector"]):
        rows = vectors_of(batch["vector"], wide.shape[1]).astype(np.float64)
        squares = norms - 2 * wide @ rows.T + (rows**2).sum(axis=1)
        nearest = np.partition(np.hstack([nearest, squares]), K - 1, axis=1)[:, :K]
    distances: Floats = np.sqrt(np.maximum(np.sort(nearest, axis=1), 0))
    return distances


def _shares(
    candidates: Candidates, queries: Floats32, true: Floats, search: Search
) -> tuple[float, float]:
    """Shares of the K nearest and of the nearest that are found.

    A row that is as near as the true one is as good.
    """
    limits = true * (1 + 1e-5) + 1e-6 * np.abs(queries).max()
    found, first = 0, 0
    for limit, (_, distances) in zip(
        limits, nearest_rows(candidates, queries, search), strict=True
    ):
        found += int(np.count_nonzero(distances[:K] <= limit[-1]))
        first += int(np.count_nonzero(distances[:1] <= limit[0]))
    return found / true.size, first / len(true)
