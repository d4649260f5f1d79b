# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""FAISS's index of rows in a file: what it finds, and what a full disk does to it."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.neighbors import NearestNeighbors

from fusionslam.errors import DataError
from fusionslam.fleet.segment import Segment, delete_segments, size_of, write_segment
from fusionslam.storage.arrays import Floats32, Integers

pytest.importorskip("faiss", reason="FAISS is of an extra")

ROWS, LENGTH = 6000, 64
NUMBERS = np.delete(np.arange(ROWS + 500), np.arange(1000, 1500))  # some rows are gone
VECTORS = np.random.default_rng(3).standard_normal((ROWS, LENGTH)).astype(np.float32)


def blocks() -> Iterator[tuple[Integers, Floats32]]:
    for some in np.array_split(np.arange(ROWS), 7):
        yield NUMBERS[some], VECTORS[some]


def write(folder: Path) -> Path:
    return write_segment(folder, ROWS, int(NUMBERS[-1]), blocks, lambda text: None)


def test_rows_are_found_by_their_numbers_with_their_vectors(tmp_path: Path) -> None:
    path = write(tmp_path / "segments")
    segment = Segment(path, size_of(path))
    assert (len(segment), segment.lists) == (ROWS, 77)
    assert_array_equal(segment.vectors[NUMBERS], VECTORS)
    assert not segment.vectors[1000:1500].any()
    queries = VECTORS[::300]
    peer = NearestNeighbors(n_neighbors=5, algorithm="brute").fit(VECTORS)
    near = NUMBERS[peer.kneighbors(queries, return_distance=False)]
    found = segment.search(queries, segment.lists, 30, None)
    assert all(set(right) <= set(some) for right, some in zip(near, found, strict=True))
    odd = np.arange(ROWS + 500) % 2 == 1
    found = segment.search(queries, segment.lists, 30, odd)
    assert (found % 2 == 1).all()
    (few,) = segment.search(queries[:1], segment.lists, 30, np.arange(ROWS + 500) < 3)
    assert_array_equal(np.sort(few[few >= 0]), [0, 1, 2])


def test_all_segments_but_one_are_deleted(tmp_path: Path) -> None:
    first, second = write(tmp_path), write(tmp_path)
    delete_segments(tmp_path, but=second.name)
    assert not first.exists() and size_of(second)
    delete_segments(tmp_path, but="")
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("space", ["1m", "1700k"])
def test_a_full_disk_is_named_and_nothing_is_left(tmp_path: Path, space: str) -> None:
    """The vectors take 1.6 MB, FAISS's file 0.5 MB."""
    mount = ["mount", "-t", "tmpfs", "-o", f"size={space}", "tmpfs", str(tmp_path)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted")
    try:
        with pytest.raises(DataError, check=lambda error: error.code == "cannot-write"):
            write(tmp_path / "segments")
        assert not [path for path in tmp_path.rglob("*") if path.suffix == ".faiss"]
        delete_segments(tmp_path / "segments", but="")
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)
