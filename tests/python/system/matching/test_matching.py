# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What an index refuses, and whether threads may share it."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from arrays import filled
from fusionslam import ConfigError, DataError, DescriptorIndex, ShapeError, nearest_causal
from rows import rows


def test_an_empty_index_answers_with_nothing() -> None:
    indices, distances = DescriptorIndex(4).query(np.zeros(4, np.float32), k=3)
    assert indices.shape == distances.shape == (0,)
    assert indices.dtype == np.int64 and distances.dtype == np.float32


@rows("value", [np.nan, np.inf])
def test_a_descriptor_that_is_not_finite_is_refused_and_not_added(value: float) -> None:
    index = filled()
    spoilt = np.zeros(7, np.float32)
    spoilt[3] = value
    for call in (index.add, lambda row: index.query(row, stamp_ns=0)):
        with pytest.raises(DataError, match=r"descriptor 20 .*position 3"):
            call(spoilt)
    assert len(index) == 20
    with pytest.raises(DataError, match="descriptor 1 "):
        nearest_causal(np.stack([np.zeros(7, np.float32), spoilt]), window=0)


def test_a_descriptor_of_another_length_is_refused_and_not_added() -> None:
    index = filled()
    for call in (index.add, lambda row: index.query(row, stamp_ns=0)):
        with pytest.raises(ShapeError, match=r"\b8\b.*\b7\b"):
            call(np.zeros(8, np.float32))
    assert len(index) == 20


def test_a_window_in_seconds_needs_a_stamp() -> None:
    with pytest.raises(ConfigError, match="stamp_ns"):
        filled().query(np.zeros(7, np.float32))


@rows(
    "options, message",
    [
        ({"dimension": 0}, r"dimension .*\b0"),
        ({"dimension": -3}, r"dimension .*-3"),
        ({"dimension": 4, "window": -1}, r"window .*-1"),
        ({"dimension": 4, "window_seconds": -0.5}, r"window_seconds .*-0\.5"),
        ({"dimension": 4, "window_seconds": float("nan")}, r"window_seconds .*\bnan"),
    ],
)
def test_options_out_of_range_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        DescriptorIndex(**options)


def test_k_must_be_positive_and_an_index_within_range() -> None:
    index = filled()
    for k in (0, -1):
        with pytest.raises(ConfigError, match=f"k .*{k}"):
            index.query(np.zeros(7, np.float32), k=k, stamp_ns=0)
        with pytest.raises(ConfigError, match=f"k .*{k}"):
            nearest_causal(np.zeros((3, 7), np.float32), window=0, k=k)
    with pytest.raises(ShapeError, match=r"descriptor 20\b"):
        index.descriptor(20)


def test_a_k_beyond_all_bounds_is_refused_and_does_not_crash() -> None:
    program = (
        "import numpy as np, fusionslam\n"
        "try: fusionslam.nearest_causal(np.zeros((4, 3), 'f4'), window=0, k=2**62)\n"
        "except (fusionslam.ConfigError, MemoryError): print('refused')"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (run.returncode, run.stdout.strip()) == (0, "refused")


def test_an_index_may_be_shared_by_threads_that_add_and_query() -> None:
    rows = np.random.default_rng(5).normal(size=(4000, 64)).astype(np.float32)
    index = DescriptorIndex(64)
    index.add(rows[0])

    def ask(_: int) -> None:
        while len(index) < len(rows):
            found, distances = index.query(rows[0])
            assert found[0] == 0 and distances[0] == 0

    with ThreadPoolExecutor(3) as pool:
        askers = pool.map(ask, range(2))
        for row in rows[1:]:
            index.add(row)
        list(askers)
    assert len(index) == len(rows)


def test_a_window_in_seconds_needs_the_stamp_of_what_is_added() -> None:
    index = DescriptorIndex(3, window_seconds=5.0)
    with pytest.raises(ConfigError, match="stamp_ns"):
        index.add(np.ones(3, np.float32))
    assert len(index) == 0


def test_threads_may_save_to_one_path_at_a_time(tmp_path: Path) -> None:
    index = DescriptorIndex(64)
    for row in np.random.default_rng(6).normal(size=(500, 64)).astype(np.float32):
        index.add(row)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: index.save(tmp_path / "places.index"), range(40)))
    assert len(DescriptorIndex.load(tmp_path / "places.index")) == 500
    assert [path.name for path in tmp_path.iterdir()] == ["places.index"]
