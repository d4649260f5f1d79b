# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the rows of a table whose vectors are near: candidates of an index, compared exactly."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fusionslam import DescriptorIndex
from fusionslam.fleet.place_rows import METRIC, SHOWN, vectors_of
from fusionslam.fleet.segment import Segment
from fusionslam.storage.arrays import Floats32, Integers, Mask

_BATCH = 32  # queries at a time
_BLOCK = 8_192  # rows read at a time
_LATER = 20_000  # rows that are kept in memory to be compared with each query
_FILTERS = 64  # whose rows are remembered
_FILTERED = 4  # times the lists of a search without filter: the allowed rows may be anywhere
_COLUMNS = (*SHOWN, "vector", "_rowid")


class Search(NamedTuple):
    """How a table is searched.

    Attributes:
        nprobes: lists of the index that are searched; 0 for all rows without index.
        candidates: rows that are compared exactly, of each query.
        where: condition that rows fulfil, as SQL; None for any.
    """

    nprobes: int
    candidates: int
    where: str | None = None


Candidates = Callable[[Floats32, Search], Iterator[Any]]
"""Yields for each query a table of rows that may be near, with columns ``SHOWN`` and vectors."""


def exactly(k: int, where: str | None = None) -> Search:
    """Search all rows for k neighbours; some more are compared, as their order may change."""
    return Search(0, 2 * k + 20, where)


def nearest_rows(
    candidates: Candidates, queries: Floats32, search: Search
) -> Iterator[tuple[Any, list[int], list[float]]]:
    """For each query yield rows with columns ``SHOWN``, their order, nearest first, and distances.

    Args:
        candidates: of the table.
        queries: float32 (q, D).
        search: how.
    """
    for first in range(0, len(queries), _BATCH):
        batch = queries[first : first + _BATCH]
        for query, found in zip(batch, candidates(batch, search), strict=True):
            yield found, *_order(query, vectors_of(found["vector"], len(query)))


def scan(table: Any, columns: list[str], where: str | None = None) -> Iterator[Any]:
    """Yield columns of rows, some thousands at a time, as Arrow's batches."""
    found = table.search().select(columns).with_row_id("_rowid" in columns)
    yield from (found if where is None else found.where(where)).to_batches(_BLOCK)


def by_lance(table: Any) -> Candidates:
    """Candidates by LanceDB itself, with its index of vectors or by comparing all rows."""
    return partial(_lance_candidates, table)


class BySegment:
    """Candidates by a segment, but for rows that were deleted, and by comparing all later rows.

    It shows the table as it was when this object was made.

    Args:
        table: LanceDB's.
        segment: of its rows up to some number.
        last_row: this number.
        before: an earlier one, which may know the deleted rows already.
    """

    def __init__(
        self, table: Any, segment: Segment, last_row: int, before: "BySegment | None" = None
    ) -> None:
        self.segment = segment
        self._table, self._last = table, last_row
        self._later: _Later | None = None
        later = int(table.count_rows(f"_rowid > {last_row}"))
        if later <= _LATER:
            self._later = _Later(_read(table, f"_rowid > {last_row}"))
        # Rows are never changed and their numbers never given again: only fewer may be left.
        self._count = int(table.count_rows()) - later
        self._kept: Mask | None = None
        if self._count != len(segment):
            known = before if before is not None and before.segment is segment else None
            if known is not None and known._count == self._count:
                self._kept = known._kept
            else:
                self._kept = self._rows_of(f"_rowid <= {last_row}")
        self._allowed: dict[str, Mask] = {}

    def __call__(self, queries: Floats32, search: Search) -> Iterator[Any]:
        """As ``Candidates``."""
        import pyarrow as pa

        if not search.nprobes:
            yield from _lance_candidates(self._table, queries, search)
            return
        allowed, nprobes = self._kept, search.nprobes
        if search.where is not None:
            allowed, nprobes = self._where(search.where), _FILTERED * nprobes
        nprobes = self._more_lists(nprobes, allowed)
        numbers = self.segment.search(queries, nprobes, search.candidates, allowed)
        near = _Taken(self._table, numbers)
        later = self._later_candidates(queries, search, allowed)
        for some, others in zip(numbers, later, strict=True):
            yield pa.concat_tables([near.rows(some), others])

    def _more_lists(self, nprobes: int, allowed: Mask | None) -> int:
        """Lists that have as many allowed rows as so many lists have rows."""
        if allowed is None:
            return nprobes
        share = np.count_nonzero(allowed[: self._last + 1]) / max(1, len(self.segment))
        return self.segment.lists if not share else math.ceil(nprobes / share)

    def _later_candidates(
        self, queries: Floats32, search: Search, allowed: Mask | None
    ) -> Iterator[Any]:
        if self._later is not None:
            mask = None if search.where is None else allowed
            for query in queries:
                yield self._later.nearest(query, search.candidates, mask)
            return
        where = f"_rowid > {self._last}"
        if search.where is not None:
            where = f"{where} AND ({search.where})"
        for found in _lance_candidates(self._table, queries, Search(0, search.candidates, where)):
            yield found.select(list(_COLUMNS))

    def _where(self, where: str) -> Mask:
        """Rows that fulfil a condition, bool by number."""
        known = self._allowed.get(where)
        if known is None:
            known = self._rows_of(where)
            if len(self._allowed) >= _FILTERS:
                self._allowed.clear()
            self._allowed[where] = known
        return known

    def _rows_of(self, where: str) -> Mask:
        numbers = [batch["_rowid"].to_numpy() for batch in scan(self._table, ["_rowid"], where)]
        rows = np.concatenate([np.zeros(0, np.int64), *numbers]).astype(np.int64)
        mask = np.zeros(max(self._last, rows.max(initial=-1)) + 1, bool)
        mask[rows] = True
        return mask


class _Taken:
    """Rows that are read for several queries at once."""

    def __init__(self, table: Any, numbers: Integers) -> None:
        wanted = np.unique(numbers[numbers >= 0])
        found = table.take_row_ids(wanted.tolist()).select([*SHOWN, "vector"]).with_row_id()
        self._rows = found.to_arrow().select(list(_COLUMNS))
        known = self._rows["_rowid"].to_numpy().astype(np.int64)
        self._order = np.argsort(known)
        self._numbers = known[self._order]

    def rows(self, numbers: Integers) -> Any:
        """Rows of some numbers; those that are gone by now are left out."""
        places = np.searchsorted(self._numbers, numbers[numbers >= 0])
        here = places < len(self._numbers)
        here[here] = self._numbers[places[here]] == numbers[numbers >= 0][here]
        return self._rows.take(self._order[places[here]])


class _Later:
    """Rows that came after a segment, in memory."""

    def __init__(self, rows: Any) -> None:
        self._rows = rows
        self._numbers = rows["_rowid"].to_numpy().astype(np.int64)
        self._vectors = vectors_of(rows["vector"], rows["vector"].type.list_size)
        self._norms = np.einsum("ij,ij->i", self._vectors, self._vectors)

    def nearest(self, query: Floats32, count: int, allowed: Mask | None) -> Any:
        """About the nearest rows of those that are allowed."""
        rows = np.arange(len(self._numbers))
        if allowed is not None:
            rows = rows[allowed[np.minimum(self._numbers, len(allowed) - 1)]]
            rows = rows[self._numbers[rows] < len(allowed)]
        if len(rows) > count:
            scores = (self._norms - 2 * self._vectors @ query)[rows]
            rows = rows[np.argpartition(scores, count)[:count]]
        return self._rows.take(rows)


def _read(table: Any, where: str) -> Any:
    found = table.search().where(where).select([*SHOWN, "vector"]).with_row_id(True).to_arrow()
    return found.select(list(_COLUMNS))


def _lance_candidates(table: Any, queries: Floats32, search: Search) -> Iterator[Any]:
    import pyarrow.compute as pc

    several = len(queries) > 1
    builder = table.search(list(queries) if several else queries[0], vector_column_name="vector")
    builder = builder.distance_type(METRIC).select([*SHOWN, "vector", "_distance"])
    builder = builder.with_row_id(True)
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
