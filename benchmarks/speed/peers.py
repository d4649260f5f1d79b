# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The libraries compared with, each kept to one thread."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    import faiss
    import fusionslam_peers
except ImportError as error:
    raise SystemExit(f"{error}: `make bench` builds and installs what is compared with") from error

native: Any = fusionslam_peers
Floats = NDArray[np.float32]

faiss.omp_set_num_threads(1)
native.set_opencv_threads(1)


def faiss_flat(rows: Floats) -> Callable[[Floats], tuple[NDArray[np.int64], Floats]]:
    """Nearest row of each query by FAISS IndexFlatL2: (indices, L2 distances)."""
    index = faiss.IndexFlatL2(rows.shape[1])
    index.add(rows)

    def search(queries: Floats) -> tuple[NDArray[np.int64], Floats]:
        squared, found = index.search(queries, 1)
        return found[:, 0], np.sqrt(squared[:, 0])

    return search


def faiss_causal(rows: Floats, window: int) -> tuple[NDArray[np.int64], Floats]:
    """Nearest earlier row of each row outside the window, one search a row, as rows come in."""
    index = faiss.IndexFlatL2(rows.shape[1])
    found = np.full(len(rows), -1, np.int64)
    distances = np.full(len(rows), np.inf, np.float32)
    for i in range(window + 1, len(rows)):
        index.add(rows[i - window - 1 : i - window])
        squared, nearest = index.search(rows[i : i + 1], 1)
        found[i], distances[i] = nearest[0, 0], np.sqrt(squared[0, 0])
    return found, distances


def numpy_search(rows: Floats) -> Callable[[Floats], tuple[NDArray[np.int64], Floats]]:
    """Nearest row of each query by one matrix product: |a - b|^2 = |a|^2 - 2 a b + |b|^2."""
    squares = np.einsum("ij,ij->i", rows, rows)

    def search(queries: Floats) -> tuple[NDArray[np.int64], Floats]:
        partial = squares - 2 * (queries @ rows.T)
        found = partial.argmin(axis=1)
        own = np.einsum("ij,ij->i", queries, queries)
        squared = np.take_along_axis(partial, found[:, None], axis=1)[:, 0] + own
        return found, np.sqrt(np.maximum(squared, 0))

    return search


def numpy_colorize(
    points: Floats, image: NDArray[np.uint8], projection: NDArray[np.float64]
) -> tuple[Floats, NDArray[np.uint8], NDArray[np.int64]]:
    """Points in front of the camera whose nearest pixel is inside, with its colour."""
    matrix = projection[:, :3].T
    u, v, w = (points @ matrix + projection[:, 3]).T
    front = np.flatnonzero(w > 0)
    columns = np.floor(u[front] / w[front] + 0.5)
    rows = np.floor(v[front] / w[front] + 0.5)
    height, width = image.shape[:2]
    inside = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
    kept = front[inside]
    colors = image[rows[inside].astype(np.intp), columns[inside].astype(np.intp)]
    return points[kept], colors, kept
