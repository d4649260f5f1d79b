# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""LiDAR Iris against numpy's FFT (Wang et al., IROS 2020), and turns of a cloud."""

import math

import numpy as np
from numpy.typing import NDArray

from clouds import polar_cloud, seen_after_turn
from fusionslam._core import IrisConfig, iris, iris_image
from rows import rows

RINGS, COLUMNS, FILTERS, WORDS = 80, 360, 4, 40
Floats = NDArray[np.float32]


def unpack(row: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Code and mask, each rings x columns x filters x (real, imaginary)."""
    words = row.reshape(COLUMNS, 2, WORDS).astype(np.uint16)
    assert (words == row.reshape(words.shape)).all()
    bits = (words[..., None] >> np.arange(16, dtype=np.uint16)) & 1
    parts = bits.astype(bool).reshape(COLUMNS, 2, RINGS, FILTERS, 2)
    return parts[:, 0].swapaxes(0, 1), parts[:, 1].swapaxes(0, 1)


def responses(image: NDArray[np.uint8]) -> NDArray[np.complex128]:
    """Rings x columns x filters, through the spectra of whole rings."""
    frequency = np.arange(1, COLUMNS // 2) / COLUMNS
    spectrum = np.fft.fft(image.astype(np.float64), axis=1)
    found = np.zeros((RINGS, COLUMNS, FILTERS), complex)
    for i in range(FILTERS):
        gain = np.zeros(COLUMNS)
        octaves = np.log(frequency * 18 * 1.6**i) / math.log(0.75)
        gain[1 : COLUMNS // 2] = np.exp(-(octaves**2) / 2)
        found[..., i] = np.fft.ifft(spectrum * gain, axis=1)
    return found


def test_an_image_by_hand() -> None:
    points = [
        [10.5, 0.01, -2.9],  # lowest slice
        [10.5, 0.01, 4.9],  # highest slice of the same pixel
        [-0.01, 20.5, 0.5],  # slice 3, column 90
        [10, 0.01, 5.1],  # too high
        [10, 0.01, -3.1],  # too low
        [81, 0, 0],  # too far
    ]
    image = iris_image(np.array(points, np.float32))
    assert image.dtype == np.uint8
    assert image.shape == (RINGS, COLUMNS)
    assert {(int(r), int(c)): int(image[r, c]) for r, c in zip(*image.nonzero(), strict=True)} == {
        (10, 0): 1 + 128,
        (20, 90): 8,
    }
    higher = IrisConfig(lowest=-2.0, highest=6.0)
    moved = np.array(points, np.float32) + np.float32([0, 0, 1])
    np.testing.assert_array_equal(iris_image(moved, config=higher), image)


@rows("seed", range(3))
def test_code_and_mask_are_those_of_the_responses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = polar_cloud(rng, COLUMNS, RINGS, 80, count=3000)
    points = points[(np.hypot(points[:, 0], points[:, 1]) // 1) % 7 != seed]  # some rings are empty
    image = iris_image(points)
    code, mask = unpack(iris(points))
    expected = responses(image)
    amplitude = np.abs(expected)
    weakest = 255e-4
    assert (mask[..., 0] == mask[..., 1]).all()
    sure = np.abs(amplitude - weakest) > 0.01
    assert sure.mean() > 0.95
    np.testing.assert_array_equal(mask[..., 0][sure], (amplitude > weakest)[sure])
    assert not mask[~image.any(axis=1)].any()
    assert not code[~mask].any()
    for part, values in enumerate((expected.real, expected.imag)):
        clear = mask[..., part] & (np.abs(values) > 0.01)
        assert clear.mean() > 0.5
        np.testing.assert_array_equal(code[..., part][clear], (values > 0)[clear])


def test_a_lone_post_is_seen_by_every_filter() -> None:
    """Right at a post the real response is largest and > 0, the imaginary one changes its sign."""
    column = 100
    azimuth = math.radians(column + 0.5)
    post = [[30.5 * math.cos(azimuth), 30.5 * math.sin(azimuth), z] for z in np.arange(-2.5, 5)]
    code, mask = unpack(iris(np.array(post, np.float32)))
    assert mask[30, column].all()
    assert code[30, column, :, 0].all()
    assert code[30, column + 2, :, 1].all()
    assert not code[30, column - 2, :, 1].any()


@rows("degrees", [1, 90, 181, 359])
def test_a_turn_by_columns_moves_the_columns(degrees: int) -> None:
    points = polar_cloud(np.random.default_rng(degrees), COLUMNS, RINGS, 80)
    older, newer = (
        iris(each).reshape(COLUMNS, -1)
        for each in (points, seen_after_turn(points, math.radians(degrees)))
    )
    np.testing.assert_array_equal(newer, np.roll(older, -degrees, axis=0))
