# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Exact search among descriptors: by L2, and of Scan Contexts at every turn."""

from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

import fusionslam
from benchmarks.speed.cases import Agreement, Bound, Case, agree, times_faster
from benchmarks.speed.inputs import Inputs, Points, random_descriptors
from benchmarks.speed.peers import faiss_causal, faiss_flat, native, numpy_search
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import timer

Nearest = tuple[NDArray[np.int64], Points]

FAISS, OPENCV, NUMPY = "FAISS IndexFlatL2", "OpenCV BFMatcher", "NumPy"
WINDOW = 50


def filled(rows: Points) -> fusionslam.DescriptorIndex:
    """An index that holds these rows."""
    index = fusionslam.DescriptorIndex(rows.shape[1])
    for row in rows:
        index.add(row)
    return index


def searches(rows: Points) -> dict[str, Callable[[Points], Nearest]]:
    """The peers, ready to be asked for the nearest row of each query."""
    return {
        FAISS: faiss_flat(rows),
        OPENCV: lambda queries: native.opencv_nearest(queries, rows),
        NUMPY: numpy_search(rows),
    }


def search_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """One query against a table, then a table against itself."""
    for count, width in settings.tables:
        rows = random_descriptors(count, width)
        query = random_descriptors(1, width, seed=1)
        index = filled(rows)
        for peer, search in searches(rows).items():
            yield Case(
                f"1 query in {count:,} x {width}",
                peer,
                timer(index.query, query[0]),
                timer(search, query),
                partial(
                    _same_nearest,
                    partial(index.query, query[0]),
                    partial(search, query),
                    query,
                    rows,
                ),
                times_faster(1) if peer == FAISS else None,
            )
    yield from _batches(settings)
    yield _every_turn()


def _batches(settings: Settings) -> Iterator[Case]:
    count, width = settings.batch, settings.tables[0][1]
    rows = random_descriptors(count, width)
    what = f"all of {count:,} x {width} against all older ones"
    yield Case(
        what,
        f"{FAISS}, one search a row",
        timer(causal, rows),
        timer(faiss_causal, rows, WINDOW),
        partial(
            _same_nearest, partial(causal, rows), partial(faiss_causal, rows, WINDOW), rows, rows
        ),
        times_faster(1),
    )
    older = count - WINDOW - 1
    pairs = (older * (older + 1) / 2, count * count)
    everywhere = cache(partial(_everywhere, rows))
    for peer, search in searches(rows).items():
        yield Case(
            f"{what}, time per pair of rows",
            f"{peer}, all against all at once",
            timer(causal, rows),
            timer(search, rows),
            partial(_same_nearest, everywhere, partial(search, rows), rows, rows),
            times_faster(1) if peer == FAISS else None,
            work=pairs,
        )


def _every_turn() -> Case:
    """The distances of one Scan Context to 300, each at the best of 60 turns."""
    rng = np.random.default_rng(2)
    contexts = rng.uniform(0, 6, (301, 60, 20)) * (rng.uniform(size=(301, 60, 20)) < 0.4)
    query, *rows = contexts.astype(np.float32).reshape(301, 1200)
    index = fusionslam.DescriptorIndex(1200, metric="scan_context")
    for row in rows:
        index.add(row)
    spectra = _sector_spectra(np.stack(rows))

    def same() -> Agreement:
        found, distances = index.query(query, k=300)
        expected = _distances_of_turns(query, spectra)[found]
        return agree(
            "largest difference of a distance", float(abs(expected - distances).max()), 1e-6
        )

    return Case(
        "1 Scan Context at 60 turns against 300, all distances",
        f"{NUMPY}, FFT over azimuth",
        timer(index.query, query, k=300),
        timer(_distances_of_turns, query, spectra),
        same,
        Bound("median", "<=", 1),
    )


def _sector_spectra(rows: Points) -> tuple[NDArray[np.complex128], NDArray[np.int64]]:
    """Of unit sectors, over azimuth, (N, 31, rings), and how many sectors are filled."""
    sectors = rows.reshape(len(rows), 60, -1).astype(np.float64)
    lengths = np.linalg.norm(sectors, axis=2, keepdims=True)
    sectors /= np.where(lengths > 0, lengths, 1)
    return np.fft.rfft(sectors, axis=1), (lengths > 0).sum(axis=(1, 2))


def _distances_of_turns(
    query: Points, rows: tuple[NDArray[np.complex128], NDArray[np.int64]]
) -> NDArray[np.float64]:
    """As ``compare_scan_contexts`` has them."""
    (spectra, filled), (one, most) = rows, _sector_spectra(query[None])
    sums: NDArray[np.float64] = np.fft.irfft((one * spectra.conj()).sum(axis=2), 60, axis=1)
    distances: NDArray[np.float64] = 1 - sums.max(axis=1) / np.maximum(filled, most)
    return distances


def causal(rows: Points) -> Nearest:
    """The nearest older row of each row."""
    indices, distances = fusionslam.nearest_causal(rows, window=WINDOW, threads=1)
    return indices[:, 0], distances[:, 0]


def _everywhere(rows: Points) -> Nearest:
    """The nearest of all rows of each row, by our index: itself, at distance 0."""
    index = filled(rows)
    found = [index.query(row) for row in rows]
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def _same_nearest(
    ours: Callable[[], Nearest], theirs: Callable[[], Nearest], queries: Points, rows: Points
) -> Agreement:
    """The rows named are equally far from the query, as double precision has it.

    Peers that expand the square lose digits: theirs may be another row that is as near to 1e-3.
    """
    (found, distances), (others, _) = ours(), theirs()
    if not np.array_equal(found >= 0, others >= 0):
        return agree("rows answered by one alone", float("inf"), 0)
    asked = found >= 0
    query = queries[asked].astype(np.float64)
    true = np.linalg.norm(query - rows[found[asked]], axis=1)
    other = np.linalg.norm(query - rows[others[asked]], axis=1)
    error = max(np.abs(true - other).max(), np.abs(distances[asked] - true).max())
    tolerance = 1e-3 if len(queries) == len(rows) else 1e-5
    return agree("largest difference of a distance", float(error), tolerance)
