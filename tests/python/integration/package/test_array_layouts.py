# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays: what is taken as it is, and what is copied."""

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np

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
    Call,
)
from rows import rows


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


def unaligned(array: np.ndarray) -> np.ndarray:
    held = np.zeros(array.nbytes + 1, np.uint8)[1:].view(array.dtype).reshape(array.shape)
    held[:] = array
    return held


LAYOUTS: dict[str, Callable[[np.ndarray], Any]] = {
    "Fortran-ordered": np.asfortranarray,
    "strided": strided,
    "read-only": read_only,
    "of negative stride": reversed_rows,
    "unaligned": unaligned,
}
FLOAT_LAYOUTS = LAYOUTS | {
    "float64": lambda array: array.astype(np.float64),
    "byte-swapped": lambda array: array.astype(array.dtype.newbyteorder(">")),
    "byte-swapped float64": lambda array: array.astype(">f8"),
    "a list of rows": lambda array: array.tolist(),
}


def all_descriptors(table: Any) -> Any:
    """What an index and tables find of descriptors."""
    index = fusionslam.DescriptorIndex(8)
    found = []
    for row in table:
        found.append(index.query(row, k=3))
        index.add(row)
    return (
        *found,
        fusionslam.nearest_causal(table, window=3, k=2),
        fusionslam.nearest(table, DESCRIPTORS),
        fusionslam.nearest(DESCRIPTORS, table),
    )


STEREO = {
    "stereo": lambda left: fusionslam.stereo_disparity(left, np.roll(LEFT, -7, axis=1)),
    "right": lambda left: fusionslam.stereo_disparity(np.roll(LEFT, 7, axis=1), left),
}


@rows(
    "calls, array, layouts",
    [
        (POINT_CALLS, POINTS, FLOAT_LAYOUTS),
        (COLOR_CALLS, COLORS, LAYOUTS),
        ({"colorize": IMAGE_CALLS["colorize"]}, IMAGE, LAYOUTS),
        (STEREO, LEFT, LAYOUTS),
        ({"colorize": MATRIX_CALLS["colorize"]}, PROJECTION, FLOAT_LAYOUTS),
        ({"descriptors": all_descriptors}, DESCRIPTORS, FLOAT_LAYOUTS),
    ],
)
def test_arrays_in_another_layout_give_the_same_answer(
    calls: dict[str, Call], array: np.ndarray, layouts: dict[str, Callable[[np.ndarray], Any]]
) -> None:
    for name, call in calls.items():
        expected = call(array)
        for layout, given in layouts.items():
            assert same(call(given(array)), expected), f"{name} of what is {layout}"


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
    others = (points.astype(np.float64), np.asfortranarray(points), strided(points))
    for copied in (*others, unaligned(points)):
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
