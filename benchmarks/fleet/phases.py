# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is measured of a database of places, each phase in a process of its own.

    python -m benchmarks.fleet.phases PHASE FOLDER DATA PLACES QUERIES

prints figures as JSON; ``benchmarks.fleet.million`` runs these.
"""

import json
import resource
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fleet.drives import (
    BLOCK,
    DATA,
    Blocks,
    blocks_of,
    exact_distances,
    places_of,
    queries_of,
)
from fusionslam.base.arrays import Floats, Floats32, Integers
from fusionslam.fleet import lance_extra
from fusionslam.fleet.place_database import DatabaseSettings, PlaceDatabase
from fusionslam.fleet.places import PlaceFilter, Places
from fusionslam.fleet.vector_index import Kind

Figures = dict[str, float]

K = 10
ADDED = 1_000
LIMIT = 1 + 1e-5
"""Of distances that count as equal: they are float32."""
FILTERS = {"robot": PlaceFilter(robot="r2"), "site": PlaceFilter(site="site2")}
"""Of one in twenty places, and of one in five."""
FILTERED = 100
"""Queries with a filter whose answers are compared with the exact ones."""
_WARM = 20  # queries before those that are timed
_EXACT = "exact.npy"


def add(folder: Path, data: str, places: int, queries: int) -> Figures:
    """Add all places, block by block."""
    del queries
    blocks = DATA[data](0)
    settings = DatabaseSettings("cm2dp" if data == "made" else "m2dp", blocks(0).shape[1])
    seconds = 0.0
    with PlaceDatabase.create(folder / "database", settings) as database:
        for number, vectors in blocks_of(blocks, places):
            some = places_of(number, vectors, len(vectors))
            started = time.perf_counter()
            database.add(some)
            seconds += time.perf_counter() - started
    return {"add s": seconds}


def index(folder: Path, data: str, places: int, queries: int) -> Figures:
    """Build the index and measure its recall."""
    del data, places, queries
    return _build(folder, None)


def lance_index(folder: Path, data: str, places: int, queries: int) -> Figures:
    """The same by LanceDB alone."""
    del data, places, queries
    return _build(folder, "lance")


def _build(folder: Path, kind: Kind | None) -> Figures:
    with PlaceDatabase.open(folder / "database") as database:
        report = database.build_index(kind=kind, progress=_say)
    return {
        "index s": report.seconds,
        "partitions": report.partitions,
        "nprobes": report.nprobes,
        "candidates": report.candidates,
        "recall told": report.recall,
    }


def query(folder: Path, data: str, places: int, queries: int) -> Figures:
    """Open the database in a new process, and time and check single queries."""
    started = time.perf_counter()
    lance_extra.load()
    imported = time.perf_counter() - started
    started = time.perf_counter()
    database = PlaceDatabase.open(folder / "database", read_only=True)
    opened = time.perf_counter() - started
    vectors = queries_of(data, places, queries)
    started = time.perf_counter()
    database.query(vectors[0], k=K)
    first = time.perf_counter() - started
    figures = {
        "import s": imported,
        "open s": opened,
        "first query ms": 1e3 * first,
        **_timed(vectors, lambda vector: _distances_found(database, vector)),
        **_judged(folder, data, places, vectors, lambda some: _found(database, some)),
    }
    started = time.process_time()
    database.check()
    return {**figures, "check s": time.process_time() - started}


def change(folder: Path, data: str, places: int, queries: int) -> Figures:
    """Add rows, delete a robot, compact, each seen by a reader, and time queries after it."""
    with (
        PlaceDatabase.open(folder / "database", read_only=True) as reader,
        PlaceDatabase.open(folder / "database") as writer,
    ):
        vectors = queries_of(data, places, queries)
        reader.query(vectors[0])
        added = _seconds_to_add(writer, reader, DATA[data](2)(0))
        between = _timed(vectors[:220], lambda vector: _distances_found(reader, vector))
        robot = PlaceFilter(robot="r1")
        started = time.perf_counter()
        deleted = writer.delete(robot)
        left = len(reader.query(vectors[0], where=robot)[0])
        forgotten = time.perf_counter() - started
        found = {one.robot for row in reader.query(vectors[:100]) for one in row}
        assert not left and "r1" not in found, "a deleted robot was found"
        without = _timed(vectors[:220], lambda vector: _distances_found(reader, vector))
        started = time.perf_counter()
        writer.compact(keep_s=0, progress=_say)
        compacted = time.perf_counter() - started
    with PlaceDatabase.open(folder / "database", read_only=True) as reader:
        after = _timed(vectors[:220], lambda vector: _distances_found(reader, vector))
        filtered = {
            f"{name} {figure}": value
            for name, where in FILTERS.items()
            for figure, value in _filtered(reader, vectors, where).items()
        }
        report = reader.index
    return {
        f"add {ADDED} s": added,
        "delete s": forgotten,
        "deleted": deleted,
        "compact s": compacted,
        "recall told": report.recall if report else 1.0,
        **{f"added {name}": value for name, value in between.items()},
        **{f"deleted {name}": value for name, value in without.items()},
        **{f"compacted {name}": value for name, value in after.items()},
        **filtered,
    }


def _filtered(reader: PlaceDatabase, vectors: Floats32, where: PlaceFilter) -> Figures:
    """Times of queries of some places alone, and how many of the true ten nearest they find."""
    started = time.perf_counter()
    reader.query(vectors[0], where=where)
    first = time.perf_counter() - started
    times = _timed(vectors[:220], lambda vector: reader.query(vector, where=where))
    some = vectors[:FILTERED]
    found, right = (reader.query(some, k=K, where=where, exact=exact) for exact in (False, True))
    pairs = [
        ([one.distance for one in row], LIMIT * true[-1].distance, LIMIT * true[0].distance)
        for row, true in zip(found, right, strict=True)
    ]
    return {
        "first ms": 1e3 * first,
        **times,
        "recall": float(np.mean([np.mean(np.array(row) <= last) for row, last, _ in pairs])),
        "top-1": float(np.mean([row[0] <= nearest for row, _, nearest in pairs])),
    }


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _seconds_to_add(writer: PlaceDatabase, reader: PlaceDatabase, rows: Floats32) -> float:
    """Seconds until rows that one process adds are found by another's reader."""
    some = places_of(0, rows[:ADDED], ADDED)
    new = Places(
        [f"new:{row}" for row in range(ADDED)], some.vectors, some.stamps_ns, some.frames, "new"
    )
    started = time.perf_counter()
    writer.add(new)
    ((found,),) = reader.query(new.vectors[-1], k=1)
    seconds = time.perf_counter() - started
    assert found.key == f"new:{ADDED - 1}", "an added place was not found"
    return seconds


def _distances_found(database: PlaceDatabase, vector: Floats32) -> list[float]:
    return [one.distance for one in database.query(vector, k=K)[0]]


def _found(database: PlaceDatabase, vectors: Floats32) -> Iterator[list[float]]:
    for row in database.query(vectors, k=K):
        yield [one.distance for one in row]


def _timed(vectors: Floats32, search: Callable[[Floats32], object]) -> Figures:
    """Milliseconds of single queries, but for the first ones, and those of processors."""
    seconds = []
    for vector in vectors:
        started, processor = time.perf_counter(), time.process_time()
        search(vector)
        seconds.append((time.perf_counter() - started, time.process_time() - processor))
    some = 1e3 * np.array(seconds[min(_WARM, len(seconds) // 2) :])
    p50, p95 = np.quantile(some[:, 0], [0.5, 0.95])
    return {"p50 ms": float(p50), "p95 ms": float(p95), "cpu ms": float(some[:, 1].mean())}


def _judged(
    folder: Path,
    data: str,
    places: int,
    vectors: Floats32,
    search: Callable[[Floats32], Iterator[list[float]]],
) -> Figures:
    """Recall of ten neighbours, and the share of queries whose first is the true one."""
    limits = LIMIT * _exact(folder, data, places, vectors) + 1e-5
    found, first = 0, 0
    for limit, distances in zip(limits, search(vectors), strict=True):
        found += sum(distance <= limit[-1] for distance in distances)
        first += bool(distances and distances[0] <= limit[0])
    return {"recall": found / limits.size, "top-1": first / len(limits)}


def _exact(folder: Path, data: str, places: int, vectors: Floats32) -> Floats:
    """Distances of the nearest, computed once."""
    path = folder / _EXACT
    if not path.exists():
        np.save(path, exact_distances(DATA[data](0), places, vectors, K))
    exact: Floats = np.load(path)
    return exact


def faiss_sq(folder: Path, data: str, places: int, queries: int) -> Figures:
    """FAISS in memory, an index as ours without a database, that searches until recall is met."""
    import faiss

    found: Any  # faiss's types do not tell what the factory makes
    blocks, vectors = DATA[data](0), queries_of(data, places, queries)
    lists = max(1, int(places**0.5))
    started = time.perf_counter()
    found = faiss.index_factory(vectors.shape[1], f"IVF{lists},SQ8")
    # From all over the drives: trained with the first ones, lists of FAISS become unequal.
    every = max(1, places // (64 * lists))
    found.train(np.vstack([some[::every] for _, some in blocks_of(blocks, places)]))
    for _, some in blocks_of(blocks, places):
        found.add(some)
    seconds = time.perf_counter() - started

    def search(some: Floats32) -> Iterator[list[float]]:
        for first in range(0, len(some), BLOCK):
            _, numbers = found.search(some[first : first + BLOCK], 100)
            yield from _true_distances(blocks, some[first : first + BLOCK], numbers)

    found.nprobe, figures = 1, _judged(folder, data, places, vectors, search)
    while figures["recall"] < 0.99 and found.nprobe < lists:
        found.nprobe *= 2
        figures = _judged(folder, data, places, vectors, search)
    timed = _timed(vectors, lambda vector: found.search(vector[None], 100))
    return {"index s": seconds, "partitions": lists, "nprobes": found.nprobe, **timed, **figures}


def _true_distances(blocks: Blocks, vectors: Floats32, numbers: Integers) -> Iterator[list[float]]:
    """Distances of FAISS's candidates to their vectors before they were coded, nearest first."""
    needed = np.unique(numbers[numbers >= 0])
    stored = np.empty((len(needed), vectors.shape[1]), np.float32)
    for block in np.unique(needed // BLOCK):
        here = needed // BLOCK == block
        stored[here] = blocks(int(block))[needed[here] % BLOCK]
    for vector, row in zip(vectors, numbers, strict=True):
        rows = stored[np.searchsorted(needed, row[row >= 0])]
        yield np.sort(np.linalg.norm(rows - vector, axis=1))[:K].tolist()


PHASES: Mapping[str, Callable[[Path, str, int, int], Figures]] = {
    "add": add,
    "lance index": lance_index,
    "lance query": query,
    "index": index,
    "query": query,
    "change": change,
    "faiss sq": faiss_sq,
}


def main() -> None:
    phase, folder, data, places, queries = sys.argv[1:]
    figures = PHASES[phase](Path(folder), data, int(places), int(queries))
    used = resource.getrusage(resource.RUSAGE_SELF)
    whole = {"peak MB": used.ru_maxrss / 1e3, "cpu s": used.ru_utime + used.ru_stime}
    print(json.dumps({**figures, **whole}))


if __name__ == "__main__":
    main()
