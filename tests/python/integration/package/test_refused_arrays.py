# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays: what is refused and how."""

from itertools import product
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
    MATRIX_CALLS,
    POINT_CALLS,
    POINTS,
    PROJECTION,
    RIGHT_PROJECTION,
    RNG,
    Call,
)
from fusionslam import DataError, ShapeError
from rows import rows

WRONG_POINTS: dict[str, Any] = {
    "flat": POINTS.ravel(),
    "with a fourth column": np.zeros((10, 4), np.float32),
    "without a third column": np.zeros((10, 2), np.float32),
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


WRONG_DESCRIPTORS: dict[str, Any] = {
    "a table": DESCRIPTORS,
    "of integers": np.arange(8),
    "of another length": np.zeros(7, np.float32),
    "None": None,
}
WRONG_TABLES: dict[str, Any] = {
    "flat": DESCRIPTORS[0],
    "of integers": np.ones((3, 3), int),
    "without columns": np.zeros((3, 0), np.float32),
}
WRONG_DISPARITIES: dict[str, Any] = {
    "of another width": np.zeros((48, 63), np.float32),
    "flat": np.zeros(48 * 64, np.float32),
    "of integers": np.zeros((48, 64), int),
    "None": None,
}
INDEX = fusionslam.DescriptorIndex(8)


@rows(
    "calls, wrong, says",
    [
        (POINT_CALLS, WRONG_POINTS, r"^points "),
        (COLOR_CALLS, WRONG_COLORS, r"^colors "),
        (IMAGE_CALLS, WRONG_IMAGES, r"^(image|left|right) "),
        (MATRIX_CALLS, WRONG_MATRICES, r"^(matrix|projection|left_projection) "),
        (
            {
                "cloud_from_disparity": lambda disparity: fusionslam.cloud_from_disparity(
                    disparity, IMAGE, PROJECTION, RIGHT_PROJECTION
                )
            },
            WRONG_DISPARITIES,
            r"^disparity ",
        ),
        ({"add": INDEX.add, "query": INDEX.query}, WRONG_DESCRIPTORS, r"^descriptor "),
        (
            {"nearest_causal": lambda table: fusionslam.nearest_causal(table, window=0)},
            WRONG_TABLES,
            None,
        ),
    ],
)
def test_arrays_of_another_shape_or_kind_are_refused_by_name(
    calls: dict[str, Call], wrong: dict[str, Any], says: str | None
) -> None:
    for (name, call), (kind, given) in product(calls.items(), wrong.items()):
        try:
            with pytest.raises(ShapeError, match=says):
                call(given)
        except BaseException as problem:
            problem.add_note(f"{name} of what is {kind}")
            raise
    assert len(INDEX) == 0


DESCRIBE: dict[str, Call] = {
    "m2dp": fusionslam.m2dp,
    "m2dp paper": lambda points: fusionslam.m2dp(points, preset="paper"),
    "m2dp upright": lambda points: fusionslam.m2dp(points, preset="upright"),
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


@rows("call, kind", product(DESCRIBE, UNUSABLE))
def test_a_cloud_that_cannot_be_described_says_why(call: str, kind: str) -> None:
    with pytest.raises(DataError, match=r"\bpoints?\b") as error:
        DESCRIBE[call](UNUSABLE[kind].astype(np.float32))
    assert "\n" not in str(error.value)


@rows(
    "call, scale",
    product(
        [name for name in DESCRIBE if "shot" not in name and "upright" not in name],
        [1e-3, 1.0, 1e3],
    ),
)
def test_collinear_points_have_no_principal_axes(call: str, scale: float) -> None:
    with pytest.raises(DataError, match=r"\bline\b"):
        DESCRIBE[call]((LINE * scale).astype(np.float32))


def test_shot_of_collinear_points_says_why_or_is_finite() -> None:
    for call in ("shot", "cshot"):
        try:
            assert np.isfinite(DESCRIBE[call](LINE)).all()
        except DataError as error:
            assert "line" in str(error)


@rows("call", DESCRIBE)
def test_coplanar_points_can_be_described(call: str) -> None:
    flat = POINTS * np.array([1, 1, 0], np.float32) + np.array([0, 0, 2], np.float32)
    tilted = (flat @ np.linalg.qr(RNG.normal(size=(3, 3)))[0]).astype(np.float32)
    for cloud in (flat, tilted):
        assert np.isfinite(DESCRIBE[call](cloud)).all()


def test_four_points_are_enough_for_m2dp() -> None:
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 0.5]], np.float32)
    for preset in ("robust", "paper", "author"):
        assert np.isfinite(fusionslam.m2dp(corners, preset=preset)).all()


@rows(
    "call, value",
    product(
        [name for name in POINT_CALLS if name not in (*DESCRIBE, "drop_invalid")],
        [np.nan, np.inf, -np.inf],
    ),
)
def test_points_that_are_not_finite_are_refused_by_number(call: str, value: float) -> None:
    spoilt = POINTS.copy()
    spoilt[7, 1] = value
    with pytest.raises(DataError, match=r"\bpoint 7\b"):
        POINT_CALLS[call](spoilt)


def test_filters_of_an_empty_cloud_are_empty() -> None:
    nobody = np.zeros((0, 3), np.float32)
    points, colors, indices = fusionslam.colorize(nobody, IMAGE, PROJECTION)
    assert points.shape == (0, 3) and colors.shape == (0, 3) and indices.shape == (0,)
    assert not fusionslam.depth_image(nobody, PROJECTION, width=64, height=48).any()
    assert len(fusionslam.above_height(nobody, 0.0)) == len(fusionslam.drop_invalid(nobody)) == 0
    assert len(fusionslam.voxel_downsample(nobody, size=1.0)[0]) == 0
