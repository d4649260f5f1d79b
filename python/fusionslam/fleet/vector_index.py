# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Searches a table of places by its index, whose recall is measured on the table's own vectors."""

import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from fusionslam import DescriptorIndex
from fusionslam.fleet.place_rows import METRIC, SHOWN, vectors_of
from fusionslam.storage.arrays import Floats, Floats32

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
_PARTITION = 800  # rows; LanceDB keeps to it when new ones come
_TRAINING = 128  # rows for each partition
_ROUNDS = 25  # of k-means
_MOST_DELTAS = 4  # parts of an index, each of which is searched
_GROWTH = 1.5  # of the rows, after which partitions are made anew
_MARGIN = 2  # times the lists that suffice for the queries that measure recall
_CANDIDATES = (30, 100, 400)
_CAREFUL = 0.1  # of the partitions are searched while recall is not measured
_BLOCK = 8_192  # rows read at a time
_BATCH = 32  # queries at a time
_KEY = "fusionslam.index"


@dataclass(frozen=True)
class IndexReport:
    """How good the index of a table is, and how it is searched.

    Attributes:
        rows: of the table when recall was measured.
        built_rows: of the table when the lists were made.
        partitions: number of the index's lists, about; 0 without index.
        kind: "IVF_SQ", or "exact" for a small table, which has no index.
        nprobes: partitions searched by a query.
        candidates: rows that are compared exactly.
        wanted: recall that was asked for.
        recall: share of the true ten nearest that queries find.
        first: share of queries that find the true nearest.
        queries: number of them that recall was measured with.
        seconds: that building and measuring took.
        version: of the table when recall was measured.
        index: identity of the index that was measured.
    """

    rows: int
    built_rows: int
    partitions: int
    kind: str
    nprobes: int
    candidates: int
    wanted: float
    recall: float
    first: float
    queries: int
    seconds: float
    version: int
    index: str


class Search(NamedTuple):
    """How a table is searched.

    Attributes:
        nprobes: partitions of the index that are searched; 0 for all rows without index.
        candidates: rows that are compared exactly, of each query.
        where: condition that rows fulfil, as SQL; None for any.
    """

    nprobes: int
    candidates: int
    where: str | None = None


def exactly(k: int, where: str | None = None) -> Search:
    """Search all rows for k neighbours; some more are compared, as their order may change."""
    return Search(0, 2 * k + 20, where)


def nearest_rows(
    table: Any, queries: Floats32, search: Search
) -> Iterator[tuple[Any, list[int], list[float]]]:
    """For each query yield rows with columns ``SHOWN``, their order, nearest first, and distances.

    Args:
        table: LanceDB's.
        queries: float32 (q, D).
        search: how.
    """
    for first in range(0, len(queries), _BATCH):
        batch = queries[first : first + _BATCH]
        for query, found in zip(batch, _candidates(table, batch, search), strict=True):
            yield found, *_order(query, vectors_of(found["vector"], len(query)))


def read_report(table: Any) -> IndexReport | None:
    """The report that a table carries."""
    text = (table.schema.field("vector").metadata or {}).get(_KEY.encode())
    try:
        return IndexReport(**json.loads(text)) if text else None
    except (ValueError, TypeError):  # of another version of this program
        return None


def write_report(table: Any, report: IndexReport) -> None:
    """Store a report in the table, which is one commit."""
    table.update_field_metadata({"path": "vector", "metadata": {_KEY: json.dumps(asdict(report))}})


def usual_search(table: Any) -> Search | None:
    """How the table's index is searched for the measured recall; None without index.

    An index that was not measured yet, as its process was killed, is searched with care.
    """
    index, report = _vector_index(table), read_report(table)
    if index is None:
        return None
    if report is not None and report.index == index.index_uuid:
        return Search(report.nprobes, report.candidates)
    return Search(math.ceil(_CAREFUL * _partitions(table.count_rows())), _CANDIDATES[-1])


def build(table: Any, recall: float, progress: Progress | None) -> IndexReport:
    """Build the index of vectors, and those of keys and filters, and measure recall.

    Args:
        table: LanceDB's, of ``FEWEST_ROWS`` or more.
        recall: to reach, by searching more partitions.
        progress: called with a line of text for each step.
    """
    from lancedb.index import Bitmap, BTree, IvfSq

    say, started = progress or _say_nothing, time.monotonic()
    say("index of keys and filters")
    table.create_index("key", config=BTree())
    for name in ("site", "robot", "session"):
        table.create_index(name, config=Bitmap())
    say("index of vectors")
    config = IvfSq(
        distance_type="l2",
        target_partition_size=_PARTITION,
        sample_rate=_TRAINING,
        max_iterations=_ROUNDS,
    )
    table.create_index("vector", config=config)
    return _measure(table, table.count_rows(), recall, say, started)


def fold(table: Any, progress: Progress | None) -> None:
    """Measure recall again after ``optimize`` put new rows into the index; or build it anew.

    Each time makes a part of the index that queries search, too, and rows may be of other places
    than those that the partitions were made of.
    """
    before, started = read_report(table), time.monotonic()
    rows, index = table.count_rows(), _vector_index(table)
    if index is None or not rows:
        return
    parts = table.index_stats(index.name).num_indices
    if before is None:  # the process that built it was killed
        build(table, RECALL, progress)
    elif parts > _MOST_DELTAS or rows > _GROWTH * before.built_rows:
        build(table, before.wanted, progress)
    else:
        _measure(table, before.built_rows, before.wanted, progress or _say_nothing, started)


def _say_nothing(text: str) -> None:
    del text


def _measure(
    table: Any, built_rows: int, recall: float, say: Progress, started: float
) -> IndexReport:
    """Find how many partitions to search for a recall; the report is stored in the table."""
    rows = table.count_rows()
    partitions = _partitions(rows)
    queries = _sample(table)
    say(f"exact answers of {len(queries)} queries")
    true = _distances_of_neighbours(table, queries)
    search, (found, first) = _choose(
        partitions, recall, lambda search: _measured(table, queries, true, search), say
    )
    report = IndexReport(
        rows=rows,
        built_rows=built_rows,
        partitions=partitions,
        kind="IVF_SQ",
        nprobes=search.nprobes,
        candidates=search.candidates,
        wanted=recall,
        recall=found,
        first=first,
        queries=len(queries),
        seconds=time.monotonic() - started,
        version=table.version,
        index=_vector_index(table).index_uuid,
    )
    write_report(table, report)
    return report


def no_index(table: Any) -> IndexReport:
    """The report of a table that is searched as a whole."""
    rows = table.count_rows()
    return IndexReport(
        rows=rows,
        built_rows=rows,
        partitions=0,
        kind="exact",
        nprobes=0,
        candidates=0,
        wanted=1.0,
        recall=1.0,
        first=1.0,
        queries=0,
        seconds=0.0,
        version=table.version,
        index="",
    )


def scan(table: Any, columns: list[str], sql: str | None = None) -> Iterator[Any]:
    """Yield columns of all rows, or of those of a filter, some thousands at a time, as batches."""
    search = table.search().select(columns)
    yield from (search if sql is None else search.where(sql)).to_batches(_BLOCK)


def _vector_index(table: Any) -> Any:
    return next((one for one in table.list_indices() if one.columns == ["vector"]), None)


def _partitions(rows: int) -> int:
    return max(1, rows // _PARTITION)


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


def _candidates(table: Any, queries: Floats32, search: Search) -> Iterator[Any]:
    """For each query yield a table of rows that may be near."""
    import pyarrow.compute as pc

    several = len(queries) > 1
    builder = table.search(list(queries) if several else queries[0], vector_column_name="vector")
    builder = builder.distance_type(METRIC).select([*SHOWN, "vector", "_distance"])
    if search.nprobes:
        builder = builder.minimum_nprobes(search.nprobes).maximum_nprobes(
            0 if search.where else search.nprobes
        )
    else:
        builder = builder.bypass_vector_index()
    if search.where:
        builder = builder.where(search.where)
    found = builder.limit(search.candidates).to_arrow()
    for number in range(len(queries)):
        yield found.filter(pc.equal(found["query_index"], number)) if several else found


def _order(query: Floats32, rows: Floats32) -> tuple[list[int], list[float]]:
    """Rows by their exact distance to a query, and these distances."""
    if not len(rows):
        return [], []
    index = DescriptorIndex(len(query), metric=METRIC)
    for row in rows:
        index.add(row)
    order, distances = index.query(query, k=len(rows))
    return order.tolist(), distances.tolist()


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


def _measured(table: Any, queries: Floats32, true: Floats, search: Search) -> tuple[float, float]:
    """Shares of the K nearest and of the nearest that are found.

    A row that is as near as the true one is as good.
    """
    limits = true * (1 + 1e-5) + 1e-6 * np.abs(queries).max()
    found, first = 0, 0
    for limit, (_, _, distances) in zip(limits, nearest_rows(table, queries, search), strict=True):
        found += sum(distance <= limit[-1] for distance in distances[:K])
        first += bool(distances) and distances[0] <= limit[0]
    return found / true.size, first / len(true)
