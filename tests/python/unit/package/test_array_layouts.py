# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays: what is taken as it is, and what is copied."""

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import fusionslam
from arrays import (
    COLOR_CALLS,
    COLORS,
    DESCRIPTORS,
    IMAGE,
    IMAGE_CALLS,
    LEFT,
    MATRIX_CALLS,
    POINT_CALLS,
    POINTS,
    PROJECTION,
)


def same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple):
        return all(same(x, y) for x, y in zip(a, b, strict=True))
    return np.array_equal(a, b)


def strided(array: np.ndarray) -> np.ndarray:
    wide = np.zeros((2 * len(array), *array.shape[1:-1], array.shape[-1] + 2), array.dtype)
    view = wide[::2, ..., 1:-1]
    view[:] = array
    return view


def read_only(array: np.ndarray) -> np.ndarray:
    locked = array.copy()
    locked.flags.writeable = False
    return locked


def reversed_rows(array: np.ndarray) -> np.ndarray:
    return array[::-1].copy()[::-1]


LAYOUTS: dict[str, Callable[[np.ndarray], Any]] = {
    "Fortran-ordered": np.asfortranarray,
    "strided": strided,
    "read-only": read_only,
    "of negative stride": reversed_rows,
}
FLOAT_LAYOUTS = LAYOUTS | {
    "float64": lambda array: array.astype(np.float64),
    "byte-swapped": lambda array: array.astype(array.dtype.newbyteorder(">")),
    "byte-swapped float64": lambda array: array.astype(">f8"),
    "a list of rows": lambda array: array.tolist(),
}


@pytest.mark.parametrize("layout", FLOAT_LAYOUTS)
@pytest.mark.parametrize("call", POINT_CALLS)
def test_points_in_another_layout_give_the_same_answer(call: str, layout: str) -> None:
    given = FLOAT_LAYOUTS[layout](POINTS)
    assert same(POINT_CALLS[call](given), POINT_CALLS[call](POINTS))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("call", COLOR_CALLS)
def test_colours_in_another_layout_give_the_same_answer(call: str, layout: str) -> None:
    assert same(COLOR_CALLS[call](LAYOUTS[layout](COLORS)), COLOR_CALLS[call](COLORS))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_images_in_another_layout_give_the_same_answer(layout: str) -> None:
    assert same(IMAGE_CALLS["colorize"](LAYOUTS[layout](IMAGE)), IMAGE_CALLS["colorize"](IMAGE))
    right = np.roll(LEFT, -7, axis=1)
    given = fusionslam.stereo_disparity(LAYOUTS[layout](LEFT), LAYOUTS[layout](right))
    assert same(given, fusionslam.stereo_disparity(LEFT, right))


@pytest.mark.parametrize("layout", FLOAT_LAYOUTS)
def test_matrices_in_another_layout_give_the_same_answer(layout: str) -> None:
    given = FLOAT_LAYOUTS[layout](PROJECTION)
    assert same(MATRIX_CALLS["colorize"](given), MATRIX_CALLS["colorize"](PROJECTION))


@pytest.mark.parametrize("layout", FLOAT_LAYOUTS)
def test_descriptors_in_another_layout_give_the_same_answer(layout: str) -> None:
    given = FLOAT_LAYOUTS[layout](DESCRIPTORS)
    assert same(
        fusionslam.nearest_causal(given, window=3, k=2),
        fusionslam.nearest_causal(DESCRIPTORS, window=3, k=2),
    )
    for table in (fusionslam.nearest(given, DESCRIPTORS), fusionslam.nearest(DESCRIPTORS, given)):
        assert same(table, fusionslam.nearest(DESCRIPTORS, DESCRIPTORS))
    plain, other = fusionslam.DescriptorIndex(8), fusionslam.DescriptorIndex(8)
    for row, given_row in zip(DESCRIPTORS, given, strict=True):
        assert same(other.query(given_row, k=3), plain.query(row, k=3))
        plain.add(row)
        other.add(given_row)


def numpy_bytes_during(call: Callable[[], object]) -> int:
    """Memory that numpy allocates during a call, at its peak."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_contiguous_points_are_not_copied_and_others_are_copied_once() -> None:
    points = np.zeros((500_000, 3), np.float32)

    def used(given: np.ndarray) -> int:
        return numpy_bytes_during(lambda: fusionslam.above_height(given, 1.0))

    assert used(points) < 100_000
    for copied in (points.astype(np.float64), np.asfortranarray(points), strided(points)):
        assert points.nbytes <= used(copied) < 1.1 * points.nbytes


def test_contiguous_colours_images_and_descriptors_are_not_copied() -> None:
    image = np.zeros((2000, 2000, 3), np.uint8)
    nobody = np.zeros((0, 3), np.float32)
    assert numpy_bytes_during(lambda: fusionslam.colorize(nobody, image, PROJECTION)) < 100_000
    descriptor = np.zeros(1_000_000, np.float32)
    index = fusionslam.DescriptorIndex(len(descriptor))
    assert numpy_bytes_during(lambda: index.query(descriptor)) < 100_000
    points, colors = np.ones((300_000, 3), np.float32), np.ones((300_000, 3), np.uint8)
    used = numpy_bytes_during(lambda: fusionslam.voxel_downsample(points, colors, size=1.0))
    assert used < 100_000


def test_arguments_are_left_as_they_were() -> None:
    points, colors = POINTS.copy(), COLORS.copy()
    for call in POINT_CALLS.values():
        call(points)
    for call in COLOR_CALLS.values():
        call(colors)
    assert same(points, POINTS) and same(colors, COLORS)


def test_results_can_be_written_and_outlive_their_call() -> None:
    points, colors, indices = fusionslam.colorize(POINTS, IMAGE, PROJECTION)
    expected = points.copy()
    for _ in range(20):
        fusionslam.colorize(POINTS[::-1], IMAGE, PROJECTION)
    assert same(points, expected)
    for array in (points, colors, indices, fusionslam.m2dp(POINTS)):
        assert array.flags.writeable
        array[:] = 0
