# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""VFH, CVFH and OUR-CVFH: turns about the sensor, sums, regions; PCL's values are in tests/cpp."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import fusionslam
from fusionslam import CvfhConfig
from places import make_place
from rows import rows

Floats = NDArray[np.float32]


def regions(descriptor: Floats) -> Floats:
    blocks = descriptor.reshape(-1, 308)
    return blocks[blocks.any(axis=1)]


def test_each_histogram_of_a_vfh_sums_to_a_hundred() -> None:
    found = fusionslam.vfh(make_place(0).points)
    assert found.dtype == np.float32
    assert found.shape == (308,)
    assert (found >= 0).all()
    parts = np.split(found.astype(np.float64), [45, 90, 135, 180])
    np.testing.assert_allclose([part.sum() for part in parts], 100, atol=0.1)


@rows("describe", [fusionslam.cvfh, fusionslam.our_cvfh])
def test_unused_blocks_are_zero_and_come_last(describe: Callable[..., Floats]) -> None:
    blocks = describe(make_place(4).points).reshape(8, 308)
    used = blocks.any(axis=1)
    assert used[0]
    assert (np.sort(used)[::-1] == used).all()


def test_more_regions_keep_the_first_ones() -> None:
    points = make_place(5).points
    few = fusionslam.cvfh(points, config=CvfhConfig(regions=2))
    many = fusionslam.cvfh(points, config=CvfhConfig(regions=30))
    assert few.shape == (2 * 308,)
    np.testing.assert_array_equal(many[: 2 * 308], few)


def test_a_block_of_cvfh_is_a_vfh_and_of_our_cvfh_has_octants_in_its_middle() -> None:
    points = make_place(6).points
    plain = regions(fusionslam.cvfh(points))[0].astype(np.float64)
    oriented = regions(fusionslam.our_cvfh(points))[0].astype(np.float64)
    sums = [part.sum() for part in np.split(plain, [45, 90, 135, 180])]
    np.testing.assert_allclose(sums, 100, atol=0.1)
    np.testing.assert_allclose(oriented[135 : 135 + 8 * 13].sum(), 100, atol=0.1)
    # Surfaces face the origin, hence nearly all are in the last bins of view.
    assert oriented[135 + 8 * 13 :].sum() <= 100.1
