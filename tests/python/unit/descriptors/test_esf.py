# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""ESF: repeatable, and within the error of sampling of other samples of the same shape."""

import numpy as np
import pytest

import fusionslam
from places import make_place
from rows import rows


def difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a.astype(np.float64) - b).sum())


def test_it_sums_to_one_and_is_the_same_twice() -> None:
    points = make_place(0).points
    found = fusionslam.esf(points)
    assert found.dtype == np.float32
    assert found.shape == (640,)
    assert (found >= 0).all()
    assert found.sum(dtype=np.float64) == pytest.approx(1, abs=1e-5)
    np.testing.assert_array_equal(fusionslam.esf(points), found)


@rows("scale", [0.01, 30.0])
def test_scale_and_shift_change_it_by_rounding_only(scale: float) -> None:
    points = make_place(1).points
    changed = (scale * points + np.array([3, -2, 1])).astype(np.float32)
    assert difference(fusionslam.esf(changed), fusionslam.esf(points)) < 0.01


def test_another_order_of_the_points_is_another_sample() -> None:
    points = make_place(4).points
    mixed = np.random.default_rng(0).permutation(points)
    # 60,000 lines in a few hundred filled bins differ by about sqrt(bins / lines).
    assert 0.01 < difference(fusionslam.esf(mixed), fusionslam.esf(points)) < 0.12
