# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors of millions of places in the order of a drive, made block by block, and exact answers."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from benchmarks.accuracy.data import data_folder
from fusionslam.base.arrays import Floats, Floats32
from fusionslam.fleet.places import Places

BLOCK = 10_000
"""Places that are made and added at a time."""
SESSION = 1_000
"""Frames of a recording."""
ROBOTS, SITES = 20, 5

_ISLAND = 50  # frames in which a robot sees the same
_SPREAD = 0.3  # noise of a frame, in deviations of the vectors
_REAL = "descriptors/kitti06_lidar_camera_m2dp.npy"

Blocks = Callable[[int], Floats32]
"""Vectors of a block by its number, float32 (BLOCK, D)."""


def made(visit: int = 0) -> Blocks:
    """Islands of fifty like vectors of length 576; another visit sees the same with other noise."""

    def block(number: int) -> Floats32:
        rng = np.random.default_rng([number, 0])
        centres = rng.standard_normal((BLOCK // _ISLAND, 576), np.float32)
        noise = np.random.default_rng([number, 1 + visit])
        rows = np.repeat(centres, _ISLAND, axis=0)
        rows += _SPREAD * noise.standard_normal(rows.shape, np.float32)
        return rows

    return block


def real(visit: int = 0) -> Blocks:
    """M2DP vectors of a drive of KITTI, length 192, that is driven again and again, with noise."""
    drive: Floats32 = np.load(data_folder() / _REAL).astype(np.float32)
    deviation = _SPREAD * drive.std(axis=0)

    def block(number: int) -> Floats32:
        rng = np.random.default_rng([number, 1 + visit])
        rows = drive[np.arange(number * BLOCK, (number + 1) * BLOCK) % len(drive)]
        seen: Floats32 = rows + deviation * rng.standard_normal(rows.shape, np.float32)
        return seen

    return block


DATA: Mapping[str, Callable[[int], Blocks]] = {"made": made, "real": real}


def places_of(number: int, vectors: Floats32, count: int) -> Places:
    """The first places of a block: recordings of a thousand frames, by twenty robots."""
    frames = np.arange(number * BLOCK, number * BLOCK + count)
    sessions = frames // SESSION
    return Places(
        keys=[f"drive{session:05}:{row}" for session, row in zip(sessions, frames, strict=True)],
        vectors=vectors[:count],
        stamps_ns=frames * 10**8,
        frames=frames % SESSION,
        session=[f"drive{session:05}" for session in sessions],
        robot=[f"r{session % ROBOTS}" for session in sessions],
        site=[f"site{session % ROBOTS % SITES}" for session in sessions],
    )


def blocks_of(blocks: Blocks, places: int) -> Iterator[tuple[int, Floats32]]:
    """Yield numbers and vectors of blocks until there are so many places."""
    for first in range(0, places, BLOCK):
        yield first // BLOCK, blocks(first // BLOCK)[: places - first]


def queries_of(name: str, places: int, count: int) -> Floats32:
    """What robots see that come again to places from all over the fleet, float32 (count, D)."""
    again, rng = DATA[name](1), np.random.default_rng(5)
    numbers = np.sort(rng.integers(0, places, count))
    rows = {number: again(number) for number in set((numbers // BLOCK).tolist())}
    found = np.stack([rows[number // BLOCK][number % BLOCK] for number in numbers.tolist()])
    return rng.permutation(found)


def exact_distances(blocks: Blocks, places: int, queries: Floats32, k: int) -> Floats:
    """Distances of the k nearest, nearest first, by brute force, float64 (q, k)."""
    nearest = np.full((len(queries), k), np.inf)
    wide = queries.astype(np.float64)  # differences of float32 squares are too coarse for near rows
    norms = (wide**2).sum(axis=1)[:, None]
    for _, narrow in blocks_of(blocks, places):
        rows = narrow.astype(np.float64)
        squares = norms - 2 * wide @ rows.T + (rows**2).sum(axis=1)
        some = np.partition(squares, k - 1, axis=1)[:, :k] if places > k else squares
        nearest = np.sort(np.hstack([nearest, some]), axis=1)[:, :k]
    exact: Floats = np.sqrt(np.maximum(nearest, 0))
    return exact
