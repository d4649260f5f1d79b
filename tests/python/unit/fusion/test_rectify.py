# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Rectified and demosaiced images against numpy and scipy."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import convolve, map_coordinates
from scipy.spatial.transform import Rotation

import fusionslam
from fusionslam.errors import ConfigError, DataError, ShapeError
from rows import rows

SIZE = (160, 120)
K = np.array([[120.0, 0, 78], [0, 124, 61], [0, 0, 1]])
P = np.array([[110.0, 0, 80, -5], [0, 112, 58, 0], [0, 0, 1, 0]])
MODELS = {
    "": [],
    "none": [],
    "plumb_bob": [-0.25, 0.08, 0.004, -0.003, -0.01],
    "rational_polynomial": [0.3, 0.1, 0.002, -0.001, 0.02, 0.5, 0.05, 0.01],
    "equidistant": [0.05, -0.02, 0.003, 0.001],
}


def bent(model: str, k: list[float], x: Any, y: Any) -> tuple[Any, Any]:
    """Where a ray (x, y, 1) is seen on the plane at depth 1 (OpenCV's documented formulas)."""
    if model == "equidistant":
        r = np.hypot(x, y)
        angle = np.arctan(r)
        powers = sum(c * angle ** (2 * i) for i, c in enumerate([1.0, *k]))
        scale = np.where(r > 0, angle * powers / np.where(r > 0, r, 1), 1)
        return x * scale, y * scale
    k1, k2, p1, p2, k3, k4, k5, k6 = [*k, *[0.0] * (8 - len(k))]
    r2 = x * x + y * y
    scale = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    return (
        x * scale + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * scale + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def picture(channels: int = 3) -> NDArray[np.uint8]:
    """A smooth picture: bilinear values then depend little on 1/32 of a pixel."""
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    planes = [127 + 60 * np.sin(u / (9 + c)) + 60 * np.cos(v / (7 + c)) for c in range(channels)]
    image = np.stack(planes, axis=-1).astype(np.uint8)
    return image if channels == 3 else image[:, :, 0].copy()


def rectified(image: NDArray[np.uint8], **changes: Any) -> NDArray[np.uint8]:
    settings: dict[str, Any] = {"camera_matrix": K, "distortion": np.zeros(0), "size": SIZE}
    settings |= {"model": "plumb_bob", "rectification": np.eye(3), "projection": P}
    return fusionslam.rectify_image(image, **(settings | changes))


@rows("channels", [1, 3])
@rows("model", MODELS)
def test_a_rectified_image_is_read_where_published_formulas_say(model: str, channels: int) -> None:
    image, turn = picture(channels), Rotation.from_euler("xyz", [2, -3, 1], degrees=True)
    made = rectified(
        image, model=model, distortion=np.array(MODELS[model]), rectification=turn.as_matrix()
    )
    assert made.shape == image.shape and made.dtype == np.uint8
    v, u = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    rays = np.stack([(u - P[0, 2]) / P[0, 0], (v - P[1, 2]) / P[1, 1], np.ones_like(u)])
    x, y, z = np.tensordot(turn.as_matrix().T, rays, 1)
    x, y = bent(model, MODELS[model], x / z, y / z)
    column, row = K[0, 0] * x + K[0, 2], K[1, 1] * y + K[1, 2]
    inside = (column > 1) & (row > 1) & (column < SIZE[0] - 2) & (row < SIZE[1] - 2)
    assert inside.mean() > 0.5
    planes, results = (np.moveaxis(np.atleast_3d(each), 2, 0) for each in (image, made))
    for plane, result in zip(planes, results, strict=True):
        expected = map_coordinates(plane.astype(float), [row, column], order=1)
        assert np.abs(result - expected)[inside].max() < 1.2


def test_a_dot_appears_where_its_point_projects() -> None:
    point = np.array([0.25, -0.18, 1.3])
    x, y = bent("plumb_bob", MODELS["plumb_bob"], point[0] / point[2], point[1] / point[2])
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    distance = np.hypot(u - (K[0, 0] * x + K[0, 2]), v - (K[1, 1] * y + K[1, 2]))
    image = (250 * np.exp(-(distance**2) / 8)).astype(np.uint8)
    made = rectified(image, distortion=np.array(MODELS["plumb_bob"])).astype(float)
    centre = np.array([(made * u).sum(), (made * v).sum()]) / made.sum()
    # The translation of P belongs to another camera of a pair: it does not move a single image.
    expected = P[:2, :2] @ point[:2] / point[2] + P[:2, 2]
    assert centre == pytest.approx(expected, abs=0.15)


@rows(
    "changes, error, message",
    [
        ({"camera_matrix": np.zeros((3, 3))}, DataError, "camera matrix"),
        ({"camera_matrix": np.full((3, 3), np.nan)}, DataError, "camera matrix"),
        ({"projection": np.zeros((3, 4))}, DataError, "projection"),
        ({"rectification": np.zeros((3, 3))}, DataError, "rectification"),
        ({"distortion": np.ones(3)}, DataError, "plumb_bob"),
        ({"distortion": np.array([np.inf] * 4)}, DataError, "distortion"),
        ({"model": "fov"}, ConfigError, "'fov'.* none, plumb_bob"),
        ({"size": (640, 480)}, ShapeError, "160x120.*640x480"),
        ({"size": (0, 0)}, ShapeError, "0x0"),
        ({"camera_matrix": np.eye(4)}, ShapeError, r"camera_matrix .*\(4, 4\)"),
        ({"rectification": np.eye(2)}, ShapeError, r"rectification .*\(2, 2\)"),
        ({"projection": np.eye(3)}, ShapeError, r"projection .*\(3, 3\)"),
        ({"distortion": np.eye(4)}, ShapeError, r"distortion .*\(4, 4\)"),
        ({"image": picture()[:0], "size": (160, 0)}, DataError, "empty"),
    ],
)
def test_what_is_no_calibration_or_image_is_refused(
    changes: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        rectified(**{"image": picture(), **changes})


def numpy_demosaic(mosaic: NDArray[np.uint8], pattern: str) -> NDArray[np.float64]:
    """Means of the nearest pixels of each colour, by convolution."""
    cross = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
    square = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
    planes = []
    for color, kernel in (("r", square), ("g", cross), ("b", square)):
        cell = np.array([letter == color for letter in pattern]).reshape(2, 2)
        mask = np.tile(cell, (mosaic.shape[0] // 2, mosaic.shape[1] // 2))
        planes.append(convolve(np.where(mask, mosaic, 0).astype(float), kernel, mode="constant"))
    return np.stack(planes, axis=-1)


@rows("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_demosaiced_colours_are_means_of_the_nearest_pixels(pattern: str) -> None:
    mosaic = np.random.default_rng(3).integers(0, 256, (40, 64), dtype=np.uint8)
    made = fusionslam.demosaic(mosaic, pattern)
    assert made.shape == (40, 64, 3) and made.dtype == np.uint8
    inner = np.s_[1:-1, 1:-1]
    assert np.abs(made - numpy_demosaic(mosaic, pattern))[inner].max() <= 0.5 + 1e-9
    assert np.array_equal(made[0, 1:-1], made[1, 1:-1])
    assert np.array_equal(made[:, -1], made[:, -2])


@rows(
    "image, pattern, error, message",
    [
        (picture(1), "xyzw", ConfigError, r"'xyzw'.* rggb"),
        (picture(3), "rggb", ShapeError, "3 channels"),
        (picture(1)[:, :2].copy(), "rggb", DataError, "2x120"),
        (picture(1).astype(np.uint16), "rggb", ShapeError, "uint8"),
    ],
)
def test_demosaicing_refuses_what_is_no_mosaic(
    image: NDArray[Any], pattern: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        fusionslam.demosaic(image, pattern)
