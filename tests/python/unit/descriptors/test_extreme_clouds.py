# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that break fast code: very many points, denormal coordinates, odd memory layouts."""

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam


def whole_numbers(count: int) -> NDArray[np.float32]:
    random = np.random.default_rng(5)
    return random.integers(-1000, 1000, (count, 3)).astype(np.float32) * np.float32([4, 2, 1])


@pytest.mark.parametrize("preset", ["paper", "robust"])
def test_denormal_coordinates_have_the_descriptor_of_the_same_cloud_in_metres(preset: str) -> None:
    points = whole_numbers(500)
    tiny = points * np.float32(2.0**-149)  # each a whole multiple of the smallest float
    assert 0 < np.abs(tiny).max() < np.finfo(np.float32).tiny
    expected = fusionslam.m2dp_signature(points, preset=preset)
    assert np.array_equal(fusionslam.m2dp_signature(tiny, preset=preset), expected)


def test_ten_million_points_are_counted_one_by_one() -> None:
    random = np.random.default_rng(6)
    points = random.random((10_000_000, 3), dtype=np.float32) * np.float32([9, 4, 1])
    colors = np.zeros(points.shape, np.uint8)
    colors[:, 0] = 200
    one = fusionslam.cm2dp_signature(points, colors, preset="paper")
    assert np.array_equal(np.rint(one[:, :128] * len(points)).sum(axis=1), np.full(64, len(points)))
    for channel in range(3):
        rows = one[:, 128 + 128 * channel : 256 + 128 * channel]
        assert np.array_equal(np.rint(rows * len(points)).sum(axis=1), np.full(64, len(points)))
    two = fusionslam.cm2dp_signature(points, colors, preset="paper", threads=2)
    assert np.array_equal(one, two)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_points_are_refused(count: int) -> None:
    with pytest.raises(fusionslam.DataError, match=f"{count}"):
        fusionslam.m2dp(whole_numbers(count))


def test_all_points_at_one_place_are_refused() -> None:
    with pytest.raises(fusionslam.DataError):
        fusionslam.m2dp(np.ones((70_000, 3), np.float32))


def test_memory_that_is_not_aligned_or_not_contiguous_gives_the_same() -> None:
    points = whole_numbers(1000)
    expected = fusionslam.m2dp(points)
    shifted = np.frombuffer(b"x" + points.tobytes(), np.uint8)[1:].view(np.float32).reshape(-1, 3)
    assert not shifted.flags.aligned
    strided = np.repeat(points, 2, axis=0)[::2]
    for other in (shifted, strided, np.asfortranarray(points), points.astype(">f4")):
        assert np.array_equal(fusionslam.m2dp(other), expected)
