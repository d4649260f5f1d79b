# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The rules for arrays: what is taken as it is, what is copied, what is refused and how."""

import sys
import threading
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import fusionslam
from fusionslam import DataError, ShapeError

RNG = np.random.default_rng(0)
POINTS = RNG.uniform([-20, -5, 0], [30, 6, 4], (400, 3)).astype(np.float32)
COLORS = RNG.integers(0, 256, (400, 3), dtype=np.uint8)
IMAGE = RNG.integers(0, 256, (48, 64, 3), dtype=np.uint8)
LEFT = RNG.integers(0, 256, (48, 128), dtype=np.uint8)
PROJECTION = np.array([[30.0, 0, 32, 0], [0, 30, 24, 0], [0, 0, 1, 1]])
RIGHT_PROJECTION = PROJECTION - [[0, 0, 0, 15], [0, 0, 0, 0], [0, 0, 0, 0]]
DESCRIPTORS = RNG.normal(size=(30, 8)).astype(np.float32)

Call = Callable[[Any], Any]

POINT_CALLS: dict[str, Call] = {
    "m2dp": fusionslam.m2dp,
    "m2dp_signature": fusionslam.m2dp_signature,
    "cm2dp": lambda points: fusionslam.cm2dp(points, COLORS),
    "cm2dp_signature": lambda points: fusionslam.cm2dp_signature(points, COLORS),
    "shot": fusionslam.shot,
    "cshot": lambda points: fusionslam.cshot(points, COLORS),
    "cloud_resolution": fusionslam.cloud_resolution,
    "estimate_normals": lambda points: fusionslam.estimate_normals(points, radius=5.0),
    "colorize": lambda points: fusionslam.colorize(points, IMAGE, PROJECTION),
    "depth_image": lambda points: fusionslam.depth_image(points, PROJECTION, width=64, height=48),
    "above_height": lambda points: fusionslam.above_height(points, 1.0),
    "remove_ground_plane": fusionslam.remove_ground_plane,
    "voxel_downsample": lambda points: fusionslam.voxel_downsample(points, COLORS, size=2.0),
    "drop_invalid": fusionslam.drop_invalid,
}
COLOR_CALLS: dict[str, Call] = {
    "cm2dp": lambda colors: fusionslam.cm2dp(POINTS, colors),
    "cm2dp_signature": lambda colors: fusionslam.cm2dp_signature(POINTS, colors),
    "cshot": lambda colors: fusionslam.cshot(POINTS, colors),
    "voxel_downsample": lambda colors: fusionslam.voxel_downsample(POINTS, colors, size=2.0),
}
IMAGE_CALLS: dict[str, Call] = {
    "colorize": lambda image: fusionslam.colorize(POINTS, image, PROJECTION),
    "stereo_disparity": lambda image: fusionslam.stereo_disparity(image, image),
}
MATRIX_CALLS: dict[str, Call] = {
    "colorize": lambda matrix: fusionslam.colorize(POINTS, IMAGE, matrix),
    "depth_image": lambda matrix: fusionslam.depth_image(POINTS, matrix, width=64, height=48),
    "cloud_from_disparity": lambda matrix: fusionslam.cloud_from_disparity(
        np.full((48, 64), 4, np.float32), IMAGE, matrix, RIGHT_PROJECTION
    ),
}


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


# What is refused

WRONG_POINTS: dict[str, Any] = {
    "flat": POINTS.ravel(),
    "with a fourth column": np.zeros((10, 4), np.float32),
    "transposed": POINTS.T,
    "of three dimensions": POINTS[None],
    "of integers": POINTS.astype(np.int32),
    "of booleans": POINTS > 0,
    "of complex numbers": POINTS.astype(np.complex64),
    "of objects": POINTS.astype(object),
    "of texts": POINTS.astype(str),
    "lists of integers": [[1, 2, 3]] * 5,
    "ragged lists": [[1.0, 2.0, 3.0], [1.0, 2.0]],
    "None": None,
    "a number": 1.0,
    "a text": "points",
}
WRONG_COLORS: dict[str, Any] = {
    "of another length": COLORS[:-1],
    "flat": COLORS.ravel(),
    "with an alpha channel": np.zeros((400, 4), np.uint8),
    "of floats": COLORS.astype(np.float32) / 255,
    "of wide integers": COLORS.astype(np.int64),
    "of signed bytes": COLORS.astype(np.int8),
    "of booleans": COLORS > 128,
    "of objects": COLORS.astype(object),
    "a list of rows": COLORS.tolist(),
    "a number": 3,
}
WRONG_IMAGES: dict[str, Any] = {
    "with an alpha channel": np.zeros((48, 64, 4), np.uint8),
    "of one channel in three dimensions": np.zeros((48, 64, 1), np.uint8),
    "flat": np.zeros(48 * 64, np.uint8),
    "of floats": IMAGE / 255,
    "of sixteen bits": IMAGE.astype(np.uint16),
    "None": None,
}
WRONG_MATRICES: dict[str, Any] = {
    "square": np.eye(4),
    "transposed": PROJECTION.T,
    "flat": PROJECTION.ravel(),
    "of texts": PROJECTION.astype(str).astype(object).astype("U8"),
    "of objects": np.full((3, 4), "a", dtype=object),
    "None": None,
}


@pytest.mark.parametrize("kind", WRONG_POINTS)
@pytest.mark.parametrize("call", POINT_CALLS)
def test_wrong_points_are_refused_by_name(call: str, kind: str) -> None:
    with pytest.raises(ShapeError, match=r"^points "):
        POINT_CALLS[call](WRONG_POINTS[kind])


@pytest.mark.parametrize("kind", WRONG_COLORS)
@pytest.mark.parametrize("call", COLOR_CALLS)
def test_wrong_colours_are_refused_by_name(call: str, kind: str) -> None:
    with pytest.raises(ShapeError, match=r"^colors "):
        COLOR_CALLS[call](WRONG_COLORS[kind])


@pytest.mark.parametrize("kind", WRONG_IMAGES)
@pytest.mark.parametrize("call", IMAGE_CALLS)
def test_wrong_images_are_refused(call: str, kind: str) -> None:
    with pytest.raises(ShapeError, match=r"^(image|left|right) "):
        IMAGE_CALLS[call](WRONG_IMAGES[kind])


@pytest.mark.parametrize("kind", WRONG_MATRICES)
@pytest.mark.parametrize("call", MATRIX_CALLS)
def test_wrong_matrices_are_refused(call: str, kind: str) -> None:
    with pytest.raises(ShapeError, match=r"^(matrix|projection|left_projection) "):
        MATRIX_CALLS[call](WRONG_MATRICES[kind])


@pytest.mark.parametrize(
    "disparity",
    [np.zeros((48, 63), np.float32), np.zeros(48 * 64, np.float32), np.zeros((48, 64), int), None],
)
def test_a_disparity_of_another_shape_or_kind_is_refused_by_name(disparity: Any) -> None:
    with pytest.raises(ShapeError, match=r"^disparity "):
        fusionslam.cloud_from_disparity(disparity, IMAGE, PROJECTION, RIGHT_PROJECTION)


@pytest.mark.parametrize("given", [DESCRIPTORS, np.arange(8), np.zeros(7, np.float32), None])
def test_wrong_descriptors_are_refused_and_nothing_is_added(given: Any) -> None:
    index = fusionslam.DescriptorIndex(8)
    for call in (index.add, index.query):
        with pytest.raises(ShapeError, match=r"^descriptor "):
            call(given)
    assert len(index) == 0


@pytest.mark.parametrize("given", [DESCRIPTORS[0], np.ones((3, 3), int), np.zeros((3, 0), "f4")])
def test_wrong_tables_of_descriptors_are_refused(given: Any) -> None:
    with pytest.raises(ShapeError):
        fusionslam.nearest_causal(given, window=0)


# Clouds that cannot be described

DESCRIBE: dict[str, Call] = {
    "m2dp": fusionslam.m2dp,
    "m2dp paper": lambda points: fusionslam.m2dp(points, preset="paper"),
    "m2dp author": lambda points: fusionslam.m2dp(points, preset="author"),
    "m2dp_signature": fusionslam.m2dp_signature,
    "cm2dp": lambda points: fusionslam.cm2dp(points, COLORS[: len(points)]),
    "shot": fusionslam.shot,
    "cshot": lambda points: fusionslam.cshot(points, COLORS[: len(points)]),
}
LINE = (np.arange(60)[:, None] * [1.0, 2.0, 3.0] + [5, 6, 7]).astype(np.float32)
UNUSABLE: dict[str, np.ndarray] = {
    "empty": np.zeros((0, 3), np.float32),
    "one point": POINTS[:1],
    "three points": POINTS[:3],
    "all equal": np.full((50, 3), 3.3, np.float32),
    "all at the origin": np.zeros((50, 3), np.float32),
    "all equal and far away": np.full((50, 3), 1234.567, np.float32),
    "with a NaN": np.where(np.arange(1200).reshape(400, 3) == 100, np.nan, POINTS),
    "with an infinity": np.where(np.arange(1200).reshape(400, 3) == 100, np.inf, POINTS),
}


@pytest.mark.parametrize("kind", UNUSABLE)
@pytest.mark.parametrize("call", DESCRIBE)
def test_a_cloud_that_cannot_be_described_says_why(call: str, kind: str) -> None:
    with pytest.raises(DataError, match=r"points|point 33 is not finite") as error:
        DESCRIBE[call](UNUSABLE[kind].astype(np.float32))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("call", [name for name in DESCRIBE if "shot" not in name])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_collinear_points_have_no_principal_axes(call: str, scale: float) -> None:
    with pytest.raises(DataError, match="on one line"):
        DESCRIBE[call]((LINE * scale).astype(np.float32))


def test_shot_of_collinear_points_says_why_or_is_finite() -> None:
    for call in ("shot", "cshot"):
        try:
            assert np.isfinite(DESCRIBE[call](LINE)).all()
        except DataError as error:
            assert "on one line" in str(error)


@pytest.mark.parametrize("call", DESCRIBE)
def test_coplanar_points_can_be_described(call: str) -> None:
    flat = POINTS * np.array([1, 1, 0], np.float32) + np.array([0, 0, 2], np.float32)
    tilted = (flat @ np.linalg.qr(RNG.normal(size=(3, 3)))[0]).astype(np.float32)
    for cloud in (flat, tilted):
        assert np.isfinite(DESCRIBE[call](cloud)).all()


def test_four_points_are_enough_for_m2dp() -> None:
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 0.5]], np.float32)
    for preset in ("robust", "paper", "author"):
        assert np.isfinite(fusionslam.m2dp(corners, preset=preset)).all()


@pytest.mark.parametrize(
    "call", [name for name in POINT_CALLS if name not in (*DESCRIBE, "drop_invalid")]
)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_points_that_are_not_finite_are_refused_by_number(call: str, value: float) -> None:
    spoilt = POINTS.copy()
    spoilt[7, 1] = value
    with pytest.raises(DataError, match="point 7 is not finite"):
        POINT_CALLS[call](spoilt)


def test_filters_of_an_empty_cloud_are_empty() -> None:
    nobody = np.zeros((0, 3), np.float32)
    points, colors, indices = fusionslam.colorize(nobody, IMAGE, PROJECTION)
    assert points.shape == (0, 3) and colors.shape == (0, 3) and indices.shape == (0,)
    assert not fusionslam.depth_image(nobody, PROJECTION, width=64, height=48).any()
    assert len(fusionslam.above_height(nobody, 0.0)) == len(fusionslam.drop_invalid(nobody)) == 0
    assert len(fusionslam.voxel_downsample(nobody, size=1.0)[0]) == 0


# The GIL


def runs_beside(call: Callable[[], object]) -> bool:
    """Whether another Python thread gets to run before a call returns.

    Python never takes the GIL from a running thread here, so the call must give it away.
    """
    go, ran = threading.Event(), []

    def wait_and_note() -> None:
        go.wait()
        ran.append(True)

    thread, interval = threading.Thread(target=wait_and_note), sys.getswitchinterval()
    sys.setswitchinterval(1000)
    try:
        thread.start()
        go.set()
        call()
        beside = bool(ran)
    finally:
        sys.setswitchinterval(interval)
    thread.join()
    return beside


BIG = RNG.normal(size=(60_000, 3)).astype(np.float32) * [20, 8, 2]
BIG_COLORS = np.zeros((60_000, 3), np.uint8)
LONG_CALLS: dict[str, Callable[[], object]] = {
    "m2dp": lambda: fusionslam.m2dp(BIG),
    "cm2dp": lambda: fusionslam.cm2dp(BIG, BIG_COLORS),
    "shot": lambda: fusionslam.shot(BIG[:20_000]),
    "remove_ground_plane": lambda: fusionslam.remove_ground_plane(BIG),
    "voxel_downsample": lambda: fusionslam.voxel_downsample(BIG, size=0.1),
    "nearest_causal": lambda: fusionslam.nearest_causal(BIG[:20_000], window=0, threads=1),
    "stereo_disparity": lambda: fusionslam.stereo_disparity(
        *[np.tile(LEFT, (20, 12))] * 2, config=fusionslam.StereoConfig(method="sgbm")
    ),
}


@pytest.mark.parametrize("call", LONG_CALLS)
def test_other_threads_run_during_a_long_call(call: str) -> None:
    # On a busy machine the other thread may not get a core in time.
    assert any(runs_beside(LONG_CALLS[call]) for _ in range(5))


def test_the_check_above_notices_a_call_that_keeps_the_gil() -> None:
    assert not runs_beside(lambda: sum(range(2_000_000)))
