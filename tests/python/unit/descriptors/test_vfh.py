# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""VFH, CVFH and OUR-CVFH: turns about the sensor, sums, regions; PCL's values are in tests/cpp."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from fusionslam import CvfhConfig, OurCvfhConfig, VfhConfig
from places import make_place, turn

Floats = NDArray[np.float32]
Describe = Callable[..., Floats]

VFH, CVFH, OUR_CVFH = (
    pytest.param(function, id=function.__name__)
    for function in (fusionslam.vfh, fusionslam.cvfh, fusionslam.our_cvfh)
)


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


@pytest.mark.parametrize("describe", [VFH, CVFH, OUR_CVFH])
@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_quarter_turns_keep_the_cubes_and_the_descriptor(describe: Describe, quarters: int) -> None:
    points = make_place(1).points
    known, turned = describe(points), describe(turn(points, 90 * quarters))
    # Rounding moves a few of 7,000 points to the next bin.
    np.testing.assert_allclose(turned, known, atol=0.1)


@pytest.mark.parametrize("degrees", [17.0, 45.0, 160.0])
def test_other_turns_change_a_vfh_less_than_another_place_does(degrees: float) -> None:
    points = make_place(2).points
    known = fusionslam.vfh(points)
    turned = np.abs(fusionslam.vfh(turn(points, degrees)) - known).sum()
    assert turned < 0.5 * np.abs(fusionslam.vfh(make_place(3).points) - known).sum()


@pytest.mark.parametrize("describe", [CVFH, OUR_CVFH])
def test_unused_blocks_are_zero_and_come_last(describe: Describe) -> None:
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


@pytest.mark.parametrize("describe", [VFH, CVFH, OUR_CVFH])
def test_too_few_points_are_refused(describe: Describe) -> None:
    with pytest.raises(fusionslam.DataError, match="needs at least 3"):
        describe(np.zeros((2, 3), np.float32))
    far_apart = np.arange(300, dtype=np.float32).reshape(100, 3) * 10
    with pytest.raises(fusionslam.DataError, match="3 points with a normal"):
        describe(far_apart)


@pytest.mark.parametrize(
    ("function", "config"),
    [(fusionslam.cvfh, CvfhConfig), (fusionslam.our_cvfh, OurCvfhConfig)],
)
def test_a_cloud_without_a_smooth_region_is_refused(function: Describe, config: type) -> None:
    rough = np.random.default_rng(0).uniform(-3, 3, (3000, 3)).astype(np.float32)
    with pytest.raises(fusionslam.DataError, match="no smooth region of 50 points"):
        function(rough, config=config())


def test_options_out_of_range_are_refused() -> None:
    with pytest.raises(fusionslam.ConfigError, match=r"vfh\.leaf"):
        VfhConfig(leaf=0)
    with pytest.raises(fusionslam.ConfigError, match=r"cvfh\.regions"):
        CvfhConfig(regions=0)
