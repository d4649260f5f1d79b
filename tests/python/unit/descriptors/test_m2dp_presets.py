# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the presets "robust" and "upright" of M2DP and c-M2DP promise."""

import math
from collections.abc import Callable
from itertools import pairwise, product

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import Points, distance, load_made, seen_after_turn, street
from fusionslam import DescriptorConfig, Frame, FusionConfig, M2dpConfig
from fusionslam.config import merged
from fusionslam.descriptors import for_clouds, needs_up
from refusals import refuses
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


PLACES = 8


def turned(points: Points, yaw: float, shift: tuple[float, float, float] = (0, 0, 0)) -> Points:
    return seen_after_turn(points, -yaw) + np.float32(shift)


def densest_azimuth(offsets: NDArray[np.float64]) -> float:
    """By a search of the definition: four harmonics, cubed distances, 0.5 rad."""
    x, y, _ = offsets.T
    azimuths = np.linspace(-np.pi, np.pi, 36001)
    weights, turns = np.hypot(x, y) ** 3, np.arctan2(y, x)
    density = np.zeros_like(azimuths)
    for k in range(1, 5):
        moment = (weights * np.exp(-1j * k * turns)).sum() * np.exp(-((0.5 * k) ** 2) / 2)
        density += (moment * np.exp(1j * k * azimuths)).real
    return float(azimuths[density.argmax()])


def reference_signature(points: Points) -> NDArray[np.float64]:
    """Counts of the 64 planes, 8 rings x 16 sectors each, divided by the number of points."""
    offsets = points.astype(np.float64) - points.astype(np.float64).mean(axis=0)
    offsets /= 3 * math.sqrt((offsets**2).sum(axis=1).mean())
    offsets = turned(offsets, -densest_azimuth(offsets)).astype(np.float64)
    rows = []
    for azimuth in -np.pi + 2 * np.pi * (np.arange(PLACES) + 0.5) / PLACES:
        for elevation in np.pi / 2 * (np.arange(PLACES) + 0.5) / PLACES:
            flat = np.cos(elevation)
            normal = [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
            x_axis = np.array([1, 0, 0]) - normal[0] * np.array(normal)
            x, y = offsets @ x_axis, offsets @ np.cross(normal, x_axis)
            ring = np.minimum(np.sqrt(np.hypot(x, y)) * 8, 7).astype(int)
            sector = np.minimum((np.arctan2(y, x) + np.pi) / (2 * np.pi) * 16, 15).astype(int)
            rows.append(np.bincount(ring * 16 + sector, minlength=128))
    return np.array(rows) / len(points)


@rows("seed", range(4))
def test_turning_about_z_and_shifting_leaves_the_upright_descriptor_unchanged(seed: int) -> None:
    points, colors = street(10 + seed)
    rng = np.random.default_rng(seed)
    m2dp = fusionslam.m2dp(points, preset="upright")
    cm2dp = fusionslam.cm2dp(points, colors, preset="upright")
    for yaw in (0.1, *rng.uniform(-np.pi, np.pi, 3), np.pi):
        moved = turned(points, yaw, tuple(rng.uniform(-20, 20, 3)))
        assert distance(fusionslam.m2dp(moved, preset="upright"), m2dp) <= 1e-4
        assert distance(fusionslam.cm2dp(moved, colors, preset="upright"), cm2dp) <= 1e-4


@rows("name", SCANS)
def test_turning_a_real_scan_leaves_the_upright_descriptor_unchanged(name: str) -> None:
    points = load_made(name)[0]
    known = fusionslam.m2dp(points, preset="upright")
    for yaw in (0.4, 2.0, -2.9):
        moved = turned(points, yaw, (5, -3, 1))
        assert distance(fusionslam.m2dp(moved, preset="upright"), known) <= 1e-4


@rows("seed", range(3))
def test_the_signature_is_that_of_a_search_of_all_azimuths(seed: int) -> None:
    points = turned(street(20 + seed)[0], 0.7 * seed, (1, 2, 3))
    found = fusionslam.m2dp_signature(points, preset="upright")
    votes = np.abs(found - reference_signature(points)).sum(axis=1) / 2
    assert votes.max() < 0.002  # the search's step of 0.01 degrees moves single points


def test_a_signature_by_hand() -> None:
    """One far point, which is the densest azimuth, and four opposite; four planes, one ring."""
    points = np.array([[10, 0, 1], [-2, 1, 0], [-2, -1, 0], [-3, 2, -1], [-3, -2, 0]], np.float32)
    config = M2dpConfig(preset="upright", azimuths=4, elevations=1, rings=1, sectors=4)
    # The planes' normals are 45 degrees up at azimuths of -135, -45, 45 and 135 degrees; y on a
    # plane is 0.71 y + 0.5 z on the first two and 0.71 y - 0.5 z on the others, x has the sign of
    # x. So the far point is in sector 2 (both positive) of the first two, 1 of the others.
    expected = np.array([[2, 0, 1, 2], [2, 0, 1, 2], [2, 1, 0, 2], [2, 1, 0, 2]]) / 5
    for yaw in (0.0, 1.0, -2.5):
        moved = turned(points, yaw, (7, -4, 2))
        np.testing.assert_allclose(fusionslam.m2dp_signature(moved, config=config), expected)


def test_mirrored_and_tilted_clouds_differ() -> None:
    points, _ = street(30)
    known = fusionslam.m2dp(points, preset="upright")
    mirrored = points * np.array([1, -1, 1], np.float32)
    tilted = points[:, [0, 2, 1]] * np.array([1, -1, 1], np.float32)
    for other in (mirrored, tilted):
        assert distance(fusionslam.m2dp(other, preset="upright"), known) > 0.02
        assert distance(fusionslam.m2dp(other), fusionslam.m2dp(points)) < 1e-4


def test_points_on_a_level_line_have_a_descriptor() -> None:
    line = np.array([[z, 3, 4] for z in range(9)], np.float32)
    assert np.isfinite(fusionslam.m2dp(line, preset="upright")).all()


@rows(
    "name, config, up",
    [
        ("m2dp:upright", DescriptorConfig(), True),
        ("cm2dp", DescriptorConfig(preset="upright"), True),
        ("m2dp", merged(DescriptorConfig(), {"m2dp": {"axes": "upright"}}), True),
        ("m2dp", DescriptorConfig(), False),
        ("m2dp:robust", DescriptorConfig(preset="upright"), False),
        ("shot", DescriptorConfig(preset="upright"), False),
    ],
)
def test_frames_whose_z_is_not_up_are_refused(
    name: str, config: DescriptorConfig, up: bool
) -> None:
    assert needs_up(name, config) == up
    camera = FusionConfig(frame="camera")
    if not up:
        fusionslam.LoopDetector(name, describe=config, fusion=camera)
        return
    with refuses("not-up", "fusion.frame", "camera", error=fusionslam.ConfigError):
        fusionslam.LoopDetector(name, describe=config, fusion=camera)
    pitched = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
    points, _ = street(40, 500)
    with refuses("not-up", "scan"):
        for_clouds(config, name, FusionConfig(), Frame(points=points, robot_from_points=pitched))
    assert for_clouds(config, name, FusionConfig(frame="robot")) == config
