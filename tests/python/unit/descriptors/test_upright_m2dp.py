# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the preset "upright" of M2DP and c-M2DP promises."""

import math

import numpy as np
from numpy.typing import NDArray

import fusionslam
from clouds import Points, distance, load_made, seen_after_turn, street
from fusionslam import DescriptorConfig, Frame, FusionConfig, M2dpConfig
from fusionslam.config import merged
from fusionslam.descriptors import for_clouds, needs_up
from refusals import refuses
from rows import rows

SCANS = ("circle_100", "town_040", "town_150", "town_300")
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
