# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the preset "robust" promises."""

from collections.abc import Callable
from itertools import pairwise, product

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import Points, distance, load_made, street
from rows import rows

SCANS = ("circle_100", "town_040", "town_150", "town_300")


def random_axes(rng: np.random.Generator, *, mirrored: bool) -> NDArray[np.float64]:
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    if (np.linalg.det(axes) < 0) != mirrored:
        axes[0] = -axes[0]
    return axes


def moves(seed: int) -> dict[str, Callable[[Points], Points]]:
    """Rotation, shift, flips, and all at once."""
    rng = np.random.default_rng(seed)
    turn, mirror = random_axes(rng, mirrored=False), random_axes(rng, mirrored=True)
    shift, flip = rng.uniform(-20, 20, 3), np.diag([1.0, -1.0, 1.0])

    def moved(axes: NDArray[np.float64], by: NDArray[np.float64]) -> Callable[[Points], Points]:
        return lambda points: (points.astype(np.float64) @ axes.T + by).astype(np.float32)

    return {
        "turned": moved(turn, np.zeros(3)),
        "shifted": moved(np.eye(3), shift),
        "flipped in y": moved(flip, np.zeros(3)),
        "flipped in x, y and z": moved(-np.eye(3), np.zeros(3)),
        "turned, flipped and shifted": moved(mirror, shift),
    }


def test_the_robust_preset_is_the_default_and_keeps_the_lengths() -> None:
    points, colors = street(9)
    m2dp, cm2dp = fusionslam.m2dp(points), fusionslam.cm2dp(points, colors)
    assert m2dp.shape == (192,) and m2dp.dtype == np.float32
    assert cm2dp.shape == (576,) and cm2dp.dtype == np.float32
    assert np.array_equal(m2dp, fusionslam.m2dp(points, preset="robust"))
    given = fusionslam.cm2dp(points, colors, color_space="rgb", preset="robust")
    assert np.array_equal(cm2dp, given)
    for preset, space in product(["upright", "paper", "author"], ["rgb", "hsv", "lab"]):
        assert fusionslam.m2dp(points, preset=preset).shape == (192,)
        given = fusionslam.cm2dp(points, colors, preset=preset, color_space=space)
        assert given.shape == (576,)


@rows("seed", range(4))
def test_moving_a_synthetic_cloud_leaves_the_robust_descriptor_unchanged(seed: int) -> None:
    points, colors = street(10 + seed)
    for what, move in moves(seed).items():
        moved = move(points)
        assert distance(fusionslam.m2dp(moved), fusionslam.m2dp(points)) <= 1e-4, what
        assert distance(fusionslam.cm2dp(moved, colors), fusionslam.cm2dp(points, colors)) <= 1e-4
    order = np.random.default_rng(seed).permutation(len(points))
    assert distance(fusionslam.m2dp(points[order]), fusionslam.m2dp(points)) <= 1e-4


@pytest.mark.parametrize("name", SCANS)
def test_moving_a_real_scan_leaves_the_robust_descriptor_unchanged(name: str) -> None:
    points = load_made(name)[0]
    colors = (np.abs(points) * 20 % 256).astype(np.uint8)
    m2dp, cm2dp = fusionslam.m2dp(points), fusionslam.cm2dp(points, colors)
    for what, move in moves(20).items():
        moved = move(points)
        assert distance(fusionslam.m2dp(moved), m2dp) <= 1e-4, what
    assert distance(fusionslam.cm2dp(moved, colors), cm2dp) <= 1e-4


def test_a_cloud_that_lost_a_tenth_of_its_points_is_nearest_to_itself() -> None:
    rng = np.random.default_rng(21)
    streets = [street(30 + seed)[0] * [1, 1 + 0.3 * seed, 1 + 0.5 * seed] for seed in range(4)]
    for clouds in ([load_made(name)[0] for name in SCANS], streets):
        known = [fusionslam.m2dp(cloud) for cloud in clouds]
        for number, cloud in enumerate(clouds):
            given = fusionslam.m2dp(cloud[rng.random(len(cloud)) >= 0.1])
            assert np.argmin([distance(given, other) for other in known]) == number


def mean_change(points: Points, noise: float, seeds: int = 4) -> float:
    """Mean change of the robust descriptor under this much noise on each coordinate."""
    known, changes = fusionslam.m2dp(points), []
    for seed in range(seeds):
        shake = np.random.default_rng(seed).normal(0, noise, points.shape)
        changes.append(distance(fusionslam.m2dp((points + shake).astype(np.float32)), known))
    return float(np.mean(changes))


def test_less_noise_changes_the_robust_descriptor_less() -> None:
    for seed in range(3):
        points, _ = street(40 + seed)
        full, half, quarter = (mean_change(points, noise) for noise in (0.04, 0.02, 0.01))
        assert quarter < half < full < 0.05
        assert quarter < 0.75 * full


def test_a_centimetre_of_noise_on_a_real_scan_changes_the_robust_descriptor_little() -> None:
    scans = [load_made(name)[0][::4] for name in SCANS]
    full, half = ([mean_change(scan, noise, seeds=2) for scan in scans] for noise in (0.01, 0.005))
    assert max(full + half) < 0.005
    assert sum(half) < sum(full)


@rows("axis", [0, 1, 2])
def test_a_nearly_symmetric_cloud_does_not_jump(axis: int) -> None:
    rng = np.random.default_rng(50 + axis)
    half = rng.normal(size=(3000, 3)) * [20, 8, 2] + [4, 1.5, 0.6]
    mirrored = half.copy()
    mirrored[:, axis] *= -1
    symmetric = np.concatenate([half, mirrored])
    descriptors = []
    for lean in np.linspace(-1e-3, 1e-3, 9):  # from just left of symmetric to just right of it
        leaning = symmetric.copy()
        leaning[:, axis] += lean * np.abs(leaning[:, axis])
        descriptors.append(fusionslam.m2dp(leaning.astype(np.float32)))
    steps = [distance(a, b) for a, b in pairwise(descriptors)]
    assert max(steps) < 0.01
