# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes and scales beyond what the core computes with are errors, never a crash or NaN."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from arrays import COLORS, POINTS, PROJECTION
from fusionslam.errors import DataError, ShapeError
from rows import rows


def repeated(*shape: int) -> NDArray[np.uint8]:
    """An image of one grey, of any size, which takes no memory until it is copied."""
    return np.broadcast_to(np.uint8(7), shape)


def zeros(*shape: int) -> NDArray[np.uint8]:
    """An image that is not copied, and takes memory where it is read."""
    return np.zeros(shape, np.uint8)


def rectify(image: Any, size: tuple[int, int]) -> Any:
    return fusionslam.rectify_image(
        image,
        camera_matrix=np.eye(3),
        distortion=[],
        model="none",
        rectification=np.eye(3),
        projection=np.eye(3, 4),
        size=size,
    )


BEYOND = 2**32 + 8
IMAGES: dict[str, Callable[[], Any]] = {
    "colorize, wide": lambda: fusionslam.colorize(POINTS, repeated(0, BEYOND), PROJECTION),
    "colorize, high": lambda: fusionslam.colorize(POINTS, repeated(BEYOND, 0), PROJECTION),
    "rectify, wide": lambda: rectify(repeated(0, BEYOND), (8, 0)),
    "demosaic, wide": lambda: fusionslam.demosaic(repeated(0, BEYOND), "rggb"),
    "stereo": lambda: fusionslam.stereo_disparity(repeated(0, BEYOND), repeated(0, BEYOND)),
    "rectify": lambda: rectify(zeros(2, 32_767), (32_767, 2)),
    "demosaic": lambda: fusionslam.demosaic(zeros(26_800, 26_800), "rggb"),
    "demosaic, long": lambda: fusionslam.demosaic(zeros(4, 32_767), "rggb"),
}


@rows("name", IMAGES)
def test_images_beyond_what_is_counted_in_are_refused(name: str) -> None:
    with pytest.raises((ShapeError, DataError)):
        IMAGES[name]()


@pytest.mark.nightly
def test_the_last_pixel_of_a_very_wide_image_is_read() -> None:
    width = 800_000_000  # three bytes each are more than an int
    image = np.zeros((1, width, 3), np.uint8)  # memory is taken where it is touched
    image[0, -1] = 50, 60, 70
    projection = np.array([[1, 0, 0, width - 1.0], [0, 1, 0, 0], [0, 0, 1, 1]])
    point = np.zeros((1, 3), np.float32)
    for way in ("nearest", "bilinear"):
        colored = fusionslam.colorize(point, image, projection, interpolation=way)
        assert colored[1].tolist() == [[50, 60, 70]]


SHOT: dict[str, Callable[[Any], Any]] = {
    "shot": fusionslam.shot,
    "cshot": lambda points: fusionslam.cshot(points, COLORS),
    "of normals": lambda points: fusionslam.shot_at_centroid(
        points, np.tile(np.float32([0.6, 0, 0.8]), (len(points), 1))
    ),
}


@rows("name", SHOT)
def test_shot_of_any_scale_is_that_of_metres_or_refused(name: str) -> None:
    expected = SHOT[name](POINTS)
    fits = []
    for exponent in range(-145, 125, 5):
        with np.errstate(over="ignore"):
            scaled = np.ldexp(POINTS, exponent)
        if not np.isfinite(scaled).all():
            continue
        try:
            found = SHOT[name](scaled)
        except DataError:
            continue
        # Powers of two round nothing but what underflows.
        np.testing.assert_allclose(found, expected, atol=1e-3)
        fits.append(exponent)
    assert min(fits) <= -40 and max(fits) >= 40


def test_a_ground_plane_of_any_scale_is_finite_or_refused() -> None:
    flat = POINTS * np.float32([1, 1, 0])
    for exponent in range(-145, 125):
        with np.errstate(over="ignore"):
            scaled = np.ldexp(flat, exponent)
        try:
            kept, plane = fusionslam.remove_ground_plane(scaled)
        except DataError:
            assert exponent > 40
            continue
        assert np.isfinite(plane).all() and len(kept) <= len(POINTS)
