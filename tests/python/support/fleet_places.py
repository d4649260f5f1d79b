# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Made places of a fleet."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fusionslam.base.arrays import Floats32, Integers
from fusionslam.fleet.place_database import DatabaseSettings
from fusionslam.fleet.places import Places
from fusionslam.fleet.segment import write_segment

LENGTH = 16
SETTINGS = DatabaseSettings("m2dp", LENGTH, config={"source": "cloud"})


def made_vectors(count: int, *, seed: int = 0, length: int = LENGTH) -> Floats32:
    """Vectors of a drive: each fifty are alike."""
    rng = np.random.default_rng(seed)
    centres = rng.standard_normal((count // 50 + 1, length))
    rows = np.repeat(centres, 50, axis=0)[:count] + 0.3 * rng.standard_normal((count, length))
    return rows.astype(np.float32)


def made_places(session: str, count: int = 20, *, seed: int = 0, **about: str) -> Places:
    """Places of a drive along x, the first of which has no pose."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 3] = np.arange(count)
    poses[:1] = np.nan
    return Places(
        keys=[f"{session}:{row}" for row in range(count)],
        vectors=made_vectors(count, seed=seed),
        stamps_ns=np.arange(count, dtype=np.int64) * 10**9,
        frames=np.arange(count, dtype=np.int64),
        session=session,
        poses=poses,
        **about,
    )


SEGMENT_ROWS = 6000
NUMBERS = np.delete(np.arange(SEGMENT_ROWS + 500), np.arange(1000, 1500))  # some rows are gone
VECTORS = np.random.default_rng(3).standard_normal((SEGMENT_ROWS, 64)).astype(np.float32)


def made_segment(folder: Path) -> Path:
    """Write a segment of the vectors above in a folder."""

    def blocks() -> Iterator[tuple[Integers, Floats32]]:
        for some in np.array_split(np.arange(SEGMENT_ROWS), 7):
            yield NUMBERS[some], VECTORS[some]

    return write_segment(folder, SEGMENT_ROWS, int(NUMBERS[-1]), blocks, lambda text: None)
