# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Queries that wait at the same time are searched together, which takes a third of the work."""

import asyncio
from collections import deque
from dataclasses import dataclass
from functools import partial

import numpy as np

from fusionslam.base.arrays import Floats32
from fusionslam.fleet.places import Candidate, PlaceFilter
from fusionslam.service.places import ServedPlaces
from fusionslam.service.workers import Workers

_MOST = 32
"""Vectors that are searched together; more take hardly less work each, and others wait longer."""


@dataclass(frozen=True)
class _Query:
    vectors: Floats32
    k: int
    where: PlaceFilter
    answer: "asyncio.Future[list[list[Candidate]]]"


class QueryBatches:
    """Searches places for vectors; those that come while others are searched wait for each other.

    A query that comes alone does not wait. To be used from the event loop only.

    Args:
        places: that are searched.
        workers: whose threads search; so many batches are searched at a time.
    """

    def __init__(self, places: ServedPlaces, workers: Workers) -> None:
        self._places, self._workers = places, workers
        self._most_lanes = workers.threads
        self._waiting: deque[_Query] = deque()
        self._lanes = 0  # that search now
        self._tasks: set[asyncio.Task[None]] = set()  # kept, as the event loop does not

    async def find(self, vectors: Floats32, k: int, where: PlaceFilter) -> list[list[Candidate]]:
        """Return the k nearest places of each of some vectors (n, D), nearest first.

        Many vectors are searched part by part, so that other queries come in between.

        Raises:
            RequestError: as ``ServedPlaces.query``.
        """
        found: list[list[Candidate]] = []
        for first in range(0, len(vectors), _MOST):
            answer = asyncio.get_running_loop().create_future()
            self._waiting.append(_Query(vectors[first : first + _MOST], k, where, answer))
            if self._lanes < self._most_lanes:
                self._lanes += 1
                task = asyncio.create_task(self._search())
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
            found += await answer
        return found

    async def _search(self) -> None:
        """Search batch after batch until no query waits."""
        while self._waiting:
            await self._answer(self._next())
        self._lanes -= 1  # at once: a query that comes now begins another

    async def _answer(self, batch: list[_Query]) -> None:
        """Search a batch; if that fails, each query alone, so that only the culprits fail."""
        try:
            found = await self._workers.run(partial(self._query, batch))
        except Exception as error:
            if len(batch) > 1:
                for query in batch:
                    await self._answer([query])
            elif not batch[0].answer.done():
                batch[0].answer.set_exception(error)
            return
        for query in batch:
            rows = [found.pop(0)[: query.k] for _ in query.vectors]
            if not query.answer.done():  # its client may be gone
                query.answer.set_result(rows)

    def _next(self) -> list[_Query]:
        """Take the query that waits longest, and those with its filter that fit."""
        batch = [self._waiting.popleft()]
        size, others = len(batch[0].vectors), deque[_Query]()
        while self._waiting:
            query = self._waiting.popleft()
            if query.where == batch[0].where and size + len(query.vectors) <= _MOST:
                batch.append(query)
                size += len(query.vectors)
            else:
                others.append(query)
        self._waiting = others
        return batch

    def _query(self, batch: list[_Query]) -> list[list[Candidate]]:
        vectors = np.concatenate([query.vectors for query in batch])
        return self._places.query(vectors, max(query.k for query in batch), batch[0].where)
