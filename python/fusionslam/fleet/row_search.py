# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the rows of a table whose vectors are near: candidates of an index, compared exactly."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from fusionslam import DescriptorIndex
from fusionslam.base.arrays import Floats32, Integers, Mask
from fusionslam.fleet.place_rows import CHECKSUM, METRIC, SHOWN, check_rows, vectors_of
from fusionslam.fleet.segment import Segment

_BATCH = 32  # queries at a time
_BLOCK = 8_192  # rows read at a time
_LATER = 20_000  # rows that are kept in memory to be compared with each query
_FILTERS = 64  # whose rows are remembered
_FILTERED = 200_000  # rows that are compared, coarsely, of those that pass a filter


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


class Near(NamedTuple):
    """Rows near a query.

    Attributes:
        numbers: int64 (n), of the rows.
        vectors: float32 (n, D).
    """

    numbers: Integers
    vectors: Floats32


Candidates = Callable[[Floats32, Search], Iterator[Near]]
"""Yields for each query rows that may be near."""


def exactly(k: int, where: str | None = None) -> Search:
    """Search all rows for k neighbours; some more are compared, as their order may change."""
    return Search(0, 2 * k + 20, where)


def nearest_rows(
    candidates: Candidates, queries: Floats32, search: Search
) -> Iterator[tuple[Integers, Floats32]]:
    """For each query yield numbers of rows and their exact distances, nearest first.

    Args:
        candidates: of the table.
        queries: float32 (q, D).
        search: how.
    """
    for first in range(0, len(queries), _BATCH):
        batch = queries[first : first + _BATCH]
        for query, near in zip(batch, candidates(batch, search), strict=True):
            yield _order(query, near)


def read_rows(table: Any, numbers: Sequence[Integers], location: str) -> list[Any]:
    """Read rows of several queries at once, and check them.

    Args:
        table: LanceDB's.
        numbers: of the rows of each query.
        location: of the database.

    Returns:
        For each a table with ``SHOWN`` and ``_rowid``; rows that are gone by now are left out.
    """
    wanted = np.unique(np.concatenate([np.zeros(0, np.int64), *numbers]))
    columns = [*SHOWN, "vector", CHECKSUM]
    found = table.take_row_ids(wanted.tolist()).select(columns).with_row_id().to_arrow()
    check_rows(found, location)
    found = found.drop_columns(["vector", CHECKSUM])
    known = found["_rowid"].to_numpy().astype(np.int64)
    order = np.argsort(known)
    places = [np.searchsorted(known[order], some) for some in numbers]
    places = [some[np.isin(one, known)] for some, one in zip(places, numbers, strict=True)]
    return [found.take(order[some]) for some in places]


def scan(table: Any, columns: list[str], where: str | None = None) -> Iterator[Any]:
    """Yield columns of rows, some thousands at a time, as Arrow's batches."""
    found = table.search().select(columns).with_row_id("_rowid" in columns)
    yield from (found if where is None else found.where(where)).to_batches(_BLOCK)


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
            self._later = _Later(table, last_row)
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

    def __call__(self, queries: Floats32, search: Search) -> Iterator[Near]:
        """As ``Candidates``."""
        if not search.nprobes:
            yield from lance_candidates(self._table, queries, search)
            return
        allowed = self._kept if search.where is None else self._where(search.where)
        nprobes = self._more_lists(search, allowed)
        found = self.segment.search(queries, nprobes, search.candidates, allowed)
        later = self._later_candidates(queries, search, allowed)
        for numbers, others in zip(found, later, strict=True):
            some = numbers[numbers >= 0]
            vectors = np.concatenate([self.segment.vectors[some], others.vectors])
            yield Near(np.concatenate([some, others.numbers]), vectors)

    def _more_lists(self, search: Search, allowed: Mask | None) -> int:
        """Lists that have as many allowed rows as the usual number of lists has rows.

        What passes a filter may all be far from a query, and so anywhere: of that, more is
        compared.
        """
        if allowed is None:
            return search.nprobes
        rows, lists = np.count_nonzero(allowed[: self._last + 1]), self.segment.lists
        if not rows:
            return lists
        far = 0 if search.where is None else math.ceil(lists * _FILTERED / rows)
        return max(far, math.ceil(search.nprobes * len(self.segment) / rows))

    def _later_candidates(
        self, queries: Floats32, search: Search, allowed: Mask | None
    ) -> Iterator[Near]:
        if self._later is not None:
            mask = None if search.where is None else allowed
            for query in queries:
                yield self._later.nearest(query, search.candidates, mask)
            return
        where = f"_rowid > {self._last}"
        if search.where is not None:
            where = f"{where} AND ({search.where})"
        yield from lance_candidates(self._table, queries, Search(0, search.candidates, where))

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


class _Later:
    """Rows that came after a segment, in memory."""

    def __init__(self, table: Any, last_row: int) -> None:
        found = table.search().where(f"_rowid > {last_row}").select(["vector"]).with_row_id(True)
        self._rows = _near(found.to_arrow())
        self._norms = np.einsum("ij,ij->i", self._rows.vectors, self._rows.vectors)

    def nearest(self, query: Floats32, count: int, allowed: Mask | None) -> Near:
        """About the nearest rows of those that are allowed."""
        numbers, vectors = self._rows
        rows = np.arange(len(numbers))
        if allowed is not None:
            rows = rows[numbers < len(allowed)]
            rows = rows[allowed[numbers[rows]]]
        if len(rows) > count:
            # Not by BLAS, whose threads disturb those of FAISS.
            products = np.einsum("ij,j->i", vectors, query)
            scores = (self._norms - 2 * products)[rows]
            rows = rows[np.argpartition(scores, count)[:count]]
        return Near(numbers[rows], vectors[rows])


def _near(rows: Any) -> Near:
    numbers = rows["_rowid"].to_numpy().astype(np.int64)
    return Near(numbers, vectors_of(rows["vector"], rows["vector"].type.list_size))


def lance_candidates(table: Any, queries: Floats32, search: Search) -> Iterator[Near]:
    """Candidates by LanceDB itself, with its index of vectors or by comparing all rows."""
    import pyarrow.compute as pc

    several = len(queries) > 1
    builder = table.search(list(queries) if several else queries[0], vector_column_name="vector")
    builder = builder.distance_type(METRIC).select(["vector", "_distance"]).with_row_id(True)
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
        yield _near(found.filter(pc.equal(found["query_index"], number)) if several else found)


def _order(query: Floats32, near: Near) -> tuple[Integers, Floats32]:
    """Numbers of rows and their exact distances to a query, nearest first."""
    if not len(near.numbers):
        return near.numbers, np.zeros(0, np.float32)
    index = DescriptorIndex(len(query), metric=METRIC)
    for row in near.vectors:
        index.add(row)
    order, distances = index.query(query, k=len(near.numbers))
    return near.numbers[order], distances
