# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors by histograms: ESF, GFH, VFH and its kin, GASD and CoSPAIR.

Against numpy where that is short, in sums, and after turns of a place; PCL's values of VFH, CVFH,
OUR-CVFH and GASD are in tests/cpp.
"""

import colorsys
import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import cie_lab
from fusionslam import Cloud, CospairConfig, CvfhConfig, GfhConfig
from places import make_place, turn
from rows import rows

Floats = NDArray[np.float32]


# Turns


def describe(name: str, place: Cloud, degrees: float = 0.0) -> NDArray[np.float32]:
    points = turn(place.points, degrees)
    of_colors = name in ("cospair", "gasd_color")
    describe = getattr(fusionslam, name)
    return describe(points, place.colors) if of_colors else describe(points)


@pytest.mark.parametrize("name", ["vfh", "cvfh", "our_cvfh", "cospair"])
def test_quarter_turns_keep_the_cubes_and_the_descriptor(name: str) -> None:
    place = make_place(1)
    known = describe(name, place)
    for degrees in (90, 270):
        # Rounding moves a few of 7,000 points to the next bin.
        atol = 5e-3 if name == "cospair" else 0.1
        np.testing.assert_allclose(describe(name, place, degrees), known, atol=atol)


@pytest.mark.parametrize(
    ("name", "order", "degrees"),
    [
        ("esf", 1, (10, 45, 90, 200)),
        ("gfh", 2, (3, 50, 123)),
        ("vfh", 1, (17, 45, 160)),
        ("cospair", 2, (17, 160)),
    ],
)
def test_other_turns_change_it_less_than_another_place_does(
    name: str, order: int, degrees: tuple[float, ...]
) -> None:
    place = make_place(2)
    known = describe(name, place)
    length = partial(np.linalg.norm, ord=order)
    elsewhere = length(describe(name, make_place(3)) - known)
    for each in degrees:
        turned = length(describe(name, place, each) - known)
        assert turned < 0.5 * elsewhere
        assert name != "esf" or turned < 0.15


def test_turns_and_shifts_move_few_points_to_other_cells_of_gasd() -> None:
    place = make_place(1)
    known = describe("gasd_color", place).astype(np.float64)
    shifted = Cloud(place.points + np.float32([4, -3, 0.5]), place.colors)
    for degrees in (30.0, 90.0, 180.0, 275.0):
        # Half of the points would make 200: 100 percent each of cells and of hues.
        assert np.abs(describe("gasd_color", shifted, degrees) - known).sum() < 1


# ESF


def sum_of_differences(a: Floats, b: Floats) -> float:
    return float(np.abs(a.astype(np.float64) - b).sum())


def test_esf_sums_to_one_and_is_the_same_twice() -> None:
    points = make_place(0).points
    found = fusionslam.esf(points)
    assert (found >= 0).all()
    assert found.sum(dtype=np.float64) == pytest.approx(1, abs=1e-5)
    np.testing.assert_array_equal(fusionslam.esf(points), found)


@rows("scale", [0.01, 30.0])
def test_scale_and_shift_change_esf_by_rounding_only(scale: float) -> None:
    points = make_place(1).points
    changed = (scale * points + np.array([3, -2, 1])).astype(np.float32)
    assert sum_of_differences(fusionslam.esf(changed), fusionslam.esf(points)) < 0.01


def test_another_order_of_the_points_is_another_sample_of_esf() -> None:
    points = make_place(4).points
    mixed = np.random.default_rng(0).permutation(points)
    # 60,000 lines in a few hundred filled bins differ by about sqrt(bins / lines).
    assert 0.01 < sum_of_differences(fusionslam.esf(mixed), fusionslam.esf(points)) < 0.12


# GFH


def reference_gfh(points: np.ndarray, config: GfhConfig) -> NDArray[np.float64]:
    x, y, z = points.T.astype(np.float64)
    cylinder = np.column_stack([np.hypot(x, y), z, np.arctan2(y, x) % (2 * math.pi)])
    counts = np.histogramdd(
        cylinder,
        bins=[config.rings, config.layers, config.sectors],
        range=[(0, config.max_range), (config.bottom, config.top), (0, 2 * math.pi)],
    )[0]
    amplitudes = np.abs(np.fft.rfft(counts, axis=2)).ravel()
    return amplitudes / np.linalg.norm(amplitudes)


@rows("sectors", [60, 7, 2])
def test_gfh_is_the_amplitude_of_the_counts_over_azimuth(sectors: int) -> None:
    config = GfhConfig(sectors=sectors, max_range=18, bottom=-1.5, top=3)
    points = make_place(0).points
    found = fusionslam.gfh(points, config=config)
    assert found.shape == (20 * 8 * (sectors // 2 + 1),)
    np.testing.assert_allclose(found, reference_gfh(points, config), atol=1e-6)


@rows("sectors", [1, 10, 15, 59])
def test_turns_by_whole_sectors_do_not_change_gfh(sectors: int) -> None:
    rng = np.random.default_rng(1)
    azimuths = (rng.integers(0, 60, 500) + rng.uniform(0.1, 0.9, 500)) * math.radians(6)
    ranges, heights = rng.uniform(1, 60, 500), rng.uniform(-2, 8, 500)
    points = np.column_stack([ranges * np.cos(azimuths), ranges * np.sin(azimuths), heights])
    known = fusionslam.gfh(points.astype(np.float32))
    turned = fusionslam.gfh(turn(points, 6 * sectors))
    np.testing.assert_allclose(turned, known, atol=2e-3)  # rings are rounded, too


# VFH, CVFH, OUR-CVFH


def test_each_histogram_of_a_vfh_sums_to_a_hundred() -> None:
    found = fusionslam.vfh(make_place(0).points)
    assert (found >= 0).all()
    parts = np.split(found.astype(np.float64), [45, 90, 135, 180])
    np.testing.assert_allclose([part.sum() for part in parts], 100, atol=0.1)


@rows("describe", [fusionslam.cvfh, fusionslam.our_cvfh])
def test_unused_blocks_of_cvfh_are_zero_and_come_last(describe: Callable[..., Floats]) -> None:
    blocks = describe(make_place(4).points).reshape(8, 308)
    used = blocks.any(axis=1)
    assert used[0]
    assert (np.sort(used)[::-1] == used).all()


def test_more_regions_of_cvfh_keep_the_first_ones() -> None:
    points = make_place(5).points
    few = fusionslam.cvfh(points, config=CvfhConfig(regions=2))
    many = fusionslam.cvfh(points, config=CvfhConfig(regions=30))
    assert few.shape == (2 * 308,)
    np.testing.assert_array_equal(many[: 2 * 308], few)


def test_a_block_of_cvfh_is_a_vfh_and_of_our_cvfh_has_octants_in_its_middle() -> None:
    points = make_place(6).points
    plain = fusionslam.cvfh(points)[:308].astype(np.float64)
    oriented = fusionslam.our_cvfh(points)[:308].astype(np.float64)
    sums = [part.sum() for part in np.split(plain, [45, 90, 135, 180])]
    np.testing.assert_allclose(sums, 100, atol=0.1)
    np.testing.assert_allclose(oriented[135 : 135 + 8 * 13].sum(), 100, atol=0.1)
    # Surfaces face the origin, hence nearly all are in the last bins of view.
    assert oriented[135 + 8 * 13 :].sum() <= 100.1


# GASD with colour


def reference_gasd(points: np.ndarray, colors: np.ndarray) -> NDArray[np.float64]:
    offsets = points.astype(np.float64) - points.mean(axis=0, dtype=np.float64)
    axes = np.linalg.eigh(np.cov(offsets.T))[1]
    x, z = axes[:, 2], axes[:, 0] * -np.sign(axes[2, 0])
    x = x * np.sign(((offsets @ x) ** 3).sum())
    aligned = offsets @ np.column_stack([x, np.cross(z, x), z])
    half = np.abs(aligned).max()
    hues = np.array([colorsys.rgb_to_hsv(*color)[0] for color in colors / 255])
    # The upper faces of the cube belong to no cell.
    inside = (aligned < half).all(axis=1)
    box = [(-half, half)] * 3
    shape = np.histogramdd(aligned[inside], bins=6, range=box)[0]
    joined = np.column_stack([aligned, hues])[inside]
    color = np.histogramdd(joined, bins=[4, 4, 4, 12], range=[*box, (0, 1)])[0]
    return 100 * np.concatenate([shape.ravel(), color.ravel()]) / (len(points) - 1)


@rows("seed", range(3))
def test_gasd_is_the_histogram_of_cells_and_hues(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = (rng.gamma(1, size=(500, 3)) * [9, 4, 1.5]).astype(np.float32)
    # Hues in the middle of their bins.
    hues = (rng.integers(0, 12, 500) + 0.5) / 12
    colors = np.array([colorsys.hsv_to_rgb(hue, 0.8, 0.9) for hue in hues])
    rounded = np.round(255 * colors).astype(np.uint8)
    found = fusionslam.gasd_color(points, rounded)
    np.testing.assert_allclose(found, reference_gasd(points, rounded), atol=1e-4)


def test_greys_have_the_hue_of_red_in_gasd() -> None:
    rng = np.random.default_rng(0)
    points = (rng.normal(size=(200, 3)) * [9, 4, 1]).astype(np.float32)
    found = fusionslam.gasd_color(points, np.full((200, 3), 77, np.uint8))[216:].reshape(-1, 12)
    assert found[:, 0].any()
    assert not found[:, 1:].any()


# Global CoSPAIR

RANGES = ((-np.pi, np.pi), (-1, 1), (-1, 1), (0, 100), (-128, 128), (-128, 128))


def reference_cospair(points: np.ndarray, colors: np.ndarray, leaf: float) -> NDArray[np.float64]:
    cloud, shades, _ = fusionslam.voxel_downsample(points, colors, size=leaf)
    normals, _, kept = fusionslam.estimate_normals(cloud, radius=3 * leaf)
    normals, cloud, shades = normals.astype(np.float64), cloud[kept].astype(float), shades[kept]
    u = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
    offsets = cloud - cloud.mean(axis=0)
    distances = np.linalg.norm(offsets, axis=1)
    v = np.cross(offsets, u)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    w = np.cross(u, v)
    theta = np.arctan2((w * normals).sum(axis=1), normals @ u)
    columns = [theta, (v * normals).sum(axis=1), offsets @ u / distances, *cie_lab(shades).T]
    shells = np.minimum((7 * distances / distances.max()).astype(int), 6)
    found = [
        np.histogram(values[shells == shell], bins=9, range=limits)[0] / (shells == shell).sum()
        for shell in range(7)
        for values, limits in zip(columns, RANGES, strict=True)
    ]
    return np.concatenate(found)


@rows("seed", range(2))
def test_cospair_is_the_histograms_of_angles_and_colours_by_shell(seed: int) -> None:
    place = make_place(seed)
    found = fusionslam.cospair(place.points, place.colors)
    expected = reference_cospair(place.points, place.colors, CospairConfig().leaf)
    # A few points lie near the border of a bin.
    assert np.abs(found - expected).mean() < 1e-4
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_colours_change_the_halves_of_colours_of_cospair_only() -> None:
    place = make_place(4)
    known = fusionslam.cospair(place.points, place.colors).reshape(7, 2, 27)
    other = fusionslam.cospair(place.points, 255 - place.colors).reshape(7, 2, 27)
    np.testing.assert_array_equal(other[:, 0], known[:, 0])
    assert (other[:, 1] != known[:, 1]).any()
