# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of places for tests of the loop detector, and descriptors of a robot that wanders."""

import numpy as np
from numpy.typing import NDArray

from fusionslam import Cloud

SECOND = 1_000_000_000
PLACES = 12


def place(number: int, visit: int = 0) -> Cloud:
    """A coloured cloud of a place; visits differ by noise, a turn and a shift."""
    rng = np.random.default_rng(number)
    size = [30 + 2 * number, 8 + number, 2 + number % 4]
    walls = [
        rng.uniform(low, low + rng.uniform([1, 1, 1], size), (300, 3))
        for low in rng.uniform(-20, 20, (5, 3)) * [1, 0.5, 0.1]
    ]
    points = np.concatenate(walls)
    colors = np.repeat(rng.integers(0, 256, (5, 3), dtype=np.uint8), 300, axis=0)
    again = np.random.default_rng([number, visit])
    points += visit * again.normal(0, 0.02, points.shape)
    angle = 1.3 * visit
    turn = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    return Cloud((points @ np.array(turn).T + visit * 0.5).astype(np.float32), colors)


DRIVE = [place(number) for number in range(PLACES)] + [place(number, 1) for number in (2, 3, 7)]


def wander(places: int, frames: int, seed: int = 0) -> NDArray[np.float32]:
    """Descriptors of a robot that sees some places once, then stays at the last ones."""
    rng = np.random.default_rng(seed)
    seen = rng.normal(0, 1, (places, 8)).astype(np.float32)
    later = np.tile(np.arange(places - 10, places), frames // 10 + 1)[: frames - places]
    order = np.concatenate([np.arange(places), later])
    rows: NDArray[np.float32] = seen[order] + rng.normal(0, 0.01, (frames, 8)).astype(np.float32)
    return rows
