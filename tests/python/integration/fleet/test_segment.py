# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""FAISS's index of rows in a file: what it finds."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.neighbors import NearestNeighbors

from fleet_places import NUMBERS, SEGMENT_ROWS, VECTORS, made_segment
from fusionslam.fleet.segment import Segment, delete_segments, size_of

pytest.importorskip("faiss", reason="FAISS is of an extra")


def test_rows_are_found_by_their_numbers_with_their_vectors(tmp_path: Path) -> None:
    path = made_segment(tmp_path / "segments")
    segment = Segment(path, size_of(path))
    assert (len(segment), segment.lists) == (SEGMENT_ROWS, 77)
    assert_array_equal(segment.vectors[NUMBERS], VECTORS)
    assert not segment.vectors[1000:1500].any()
    queries = VECTORS[::300]
    peer = NearestNeighbors(n_neighbors=5, algorithm="brute").fit(VECTORS)
    near = NUMBERS[peer.kneighbors(queries, return_distance=False)]
    found = segment.search(queries, segment.lists, 30, None)
    assert all(set(right) <= set(some) for right, some in zip(near, found, strict=True))
    numbers = np.arange(NUMBERS[-1] + 1)
    found = segment.search(queries, segment.lists, 30, numbers % 2 == 1)
    assert (found % 2 == 1).all()
    (few,) = segment.search(queries[:1], segment.lists, 30, numbers < 3)
    assert_array_equal(np.sort(few[few >= 0]), [0, 1, 2])


def test_all_segments_but_one_are_deleted(tmp_path: Path) -> None:
    first, second = made_segment(tmp_path), made_segment(tmp_path)
    delete_segments(tmp_path, but=second.name)
    assert not first.exists() and size_of(second)
    delete_segments(tmp_path, but="")
    assert not [*tmp_path.iterdir()]
