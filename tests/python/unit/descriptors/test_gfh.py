# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""GFH against numpy's FFT, and turns."""

import math

import numpy as np
from numpy.typing import NDArray

import fusionslam
from fusionslam import GfhConfig
from places import make_place, turn
from rows import rows


def reference(points: np.ndarray, config: GfhConfig) -> NDArray[np.float64]:
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
def test_it_is_the_amplitude_of_the_counts_over_azimuth(sectors: int) -> None:
    config = GfhConfig(sectors=sectors, max_range=18, bottom=-1.5, top=3)
    points = make_place(0).points
    found = fusionslam.gfh(points, config=config)
    assert found.dtype == np.float32
    assert found.shape == (20 * 8 * (sectors // 2 + 1),)
    np.testing.assert_allclose(found, reference(points, config), atol=1e-6)


@rows("sectors", [1, 10, 15, 59])
def test_turns_by_whole_sectors_do_not_change_it(sectors: int) -> None:
    rng = np.random.default_rng(1)
    azimuths = (rng.integers(0, 60, 500) + rng.uniform(0.1, 0.9, 500)) * math.radians(6)
    ranges, heights = rng.uniform(1, 60, 500), rng.uniform(-2, 8, 500)
    points = np.column_stack([ranges * np.cos(azimuths), ranges * np.sin(azimuths), heights])
    known = fusionslam.gfh(points.astype(np.float32))
    turned = fusionslam.gfh(turn(points, 6 * sectors))
    np.testing.assert_allclose(turned, known, atol=2e-3)  # rings are rounded, too
