# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of keyframes joined into that of a map, in bounded memory."""

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest

from fusionslam import Cloud
from fusionslam.mapping import clouds
from fusionslam.mapping.clouds import join_clouds
from fusionslam.storage.arrays import Matrix


def placed(count: int, *, colored: bool = True) -> Iterator[tuple[Matrix, Cloud]]:
    """Clouds of one place of 10 m, taken from several poses."""
    rng = np.random.default_rng(1)
    for k in range(count):
        pose = np.eye(4)
        pose[0, 3] = k % 3
        points = rng.uniform(0, 10, (20_000, 3)).astype(np.float32) - pose[:3, 3]
        colors = np.full((20_000, 3), 10 * (k % 5), np.uint8) if colored else None
        yield pose, Cloud(points.astype(np.float32), colors)


def test_few_points_at_a_time_give_the_same_voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = join_clouds(placed(10), 1.0)
    monkeypatch.setattr(clouds, "MOST_POINTS", 50_000)
    joined = join_clouds(placed(10), 1.0)
    cells = [
        {tuple(cell) for cell in np.floor(cloud.points).astype(int).tolist()}
        for cloud in (whole, joined)
    ]
    assert cells[0] == cells[1] and len(joined) == len(cells[1]) == 1000
    assert joined.colors is not None and joined.colors.shape == (1000, 3)


def test_memory_does_not_grow_with_the_number_of_clouds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clouds, "MOST_POINTS", 50_000)
    peaks = []
    for count in (10, 100):
        tracemalloc.start()
        join_clouds(placed(count), 1.0)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def test_clouds_without_colours_make_one_without() -> None:
    mixed = [*placed(2), *placed(1, colored=False)]
    assert join_clouds(mixed, 1.0).colors is None
    assert join_clouds(placed(2, colored=False), 1.0).colors is None
    empty = join_clouds([], 1.0)
    assert len(empty) == 0 and empty.colors is None
