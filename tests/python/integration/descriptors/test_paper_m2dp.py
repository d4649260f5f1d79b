# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The presets of the papers: a plain NumPy version, and the authors' own programs."""

from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import MADE, Colors, Points, distance, load_made, read_scan, street
from rows import rows


def principal_coordinates(points: Points) -> NDArray[np.float64]:
    centred = points.astype(np.float64) - points.astype(np.float64).mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    axes = vectors[:, ::-1].T
    largest = np.abs(axes).argmax(axis=1)
    return centred @ (axes * np.sign(axes[range(3), largest])[:, None]).T


def numpy_signature(
    points: Points,
    colors: Colors | None = None,
    *,
    azimuths: int = 4,
    elevations: int = 16,
    rings: int = 8,
    sectors: int = 16,
    color_bins: int = 16,
) -> NDArray[np.float64]:
    cloud = principal_coordinates(points)
    ring_edges = np.linspace(0, np.sqrt(np.linalg.norm(cloud, axis=1).max()), rings + 1) ** 2
    sector_edges = np.linspace(-np.pi, np.pi, sectors + 1)
    rows = []
    for azimuth in np.linspace(-np.pi / 2, np.pi / 2, azimuths):
        for elevation in np.linspace(0, np.pi / 2, elevations):
            flat = np.cos(elevation)
            normal = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
            x_axis = np.array([1.0, 0, 0]) - normal[0] * normal
            x, y = cloud @ x_axis, cloud @ np.cross(normal, x_axis)
            angle = np.where((x == 0) & (y == 0), 0, np.arctan2(y, x))
            ring = np.searchsorted(ring_edges[1:-1], np.sqrt(x * x + y * y), side="right")
            sector = np.searchsorted(sector_edges[1:-1], angle, side="right")
            blocks = [np.bincount(ring * sectors + sector, minlength=rings * sectors)]
            if colors is not None:
                shade = np.floor(colors / (255 / color_bins + 0.001)).astype(int)
                blocks += [
                    np.bincount(ring * color_bins + shade[:, c], minlength=rings * color_bins)
                    for c in range(3)
                ]
            rows.append(np.concatenate(blocks) / len(points))
    return np.array(rows)


def numpy_descriptor(signature: NDArray[np.float64]) -> NDArray[np.float64]:
    u, _, vt = np.linalg.svd(signature)
    return np.concatenate([u[:, 0], vt[0]]) * (1 if u[:, 0].sum() >= 0 else -1)


def votes_that_differ(a: NDArray[np.float64], b: NDArray[np.float64], points: int) -> int:
    """Votes in another bin; a vote that only one of the two has counts as half of one."""
    return round(float(np.abs(a - b).sum() * points)) // 2


CONFIGURATIONS: list[dict[str, int]] = [
    {},
    {"azimuths": 3, "elevations": 5},
    {"rings": 5, "sectors": 12},
    {"rings": 1, "sectors": 7},
    {"rings": 3, "sectors": 1},
    {"azimuths": 6, "elevations": 8, "rings": 10, "sectors": 9, "color_bins": 8},
]


@rows("sizes, seed", product(CONFIGURATIONS, [1, 2]))
def test_the_paper_preset_is_what_a_plain_numpy_version_gives(
    sizes: dict[str, int], seed: int
) -> None:
    points, colors = street(seed, 800)
    config = fusionslam.M2dpConfig(preset="paper", **sizes)
    for shades in (None, colors):
        expected = numpy_signature(points, shades, **sizes)
        if shades is None:
            signature = fusionslam.m2dp_signature(points, config=config)
            descriptor = fusionslam.m2dp(points, config=config)
        else:
            signature = fusionslam.cm2dp_signature(points, shades, config=config)
            descriptor = fusionslam.cm2dp(points, shades, config=config)
        assert signature.shape == expected.shape
        assert votes_that_differ(signature, expected, len(points)) <= 1
        assert distance(descriptor, numpy_descriptor(expected)) <= 1e-4


def test_a_signature_row_counts_every_point_once_for_shape_and_once_a_channel() -> None:
    points, colors = street(3, 800)
    signature = fusionslam.cm2dp_signature(points, colors, preset="paper")
    shape, *channels = np.split(signature, 4, axis=1)
    assert np.allclose(shape.sum(axis=1), 1)
    for channel in channels:
        assert np.allclose(
            channel.reshape(64, 8, 16).sum(axis=2), shape.reshape(64, 8, 16).sum(axis=2)
        )


def test_the_paper_preset_gives_what_the_matlab_program_gives_for_a_kitti_scan(
    test_data: Path,
) -> None:
    scan = read_scan(test_data / "kitti/sequences/00/velodyne/000000.bin")
    expected = np.load(test_data / "reference/m2dp/kitti00_000000_signature_64x128.npy")
    signature = fusionslam.m2dp_signature(scan, preset="paper")
    assert signature.shape == (64, 128) and signature.dtype == np.float64
    assert votes_that_differ(signature, expected, len(scan)) <= 64
    values = np.linalg.svd(signature, compute_uv=False)[:4]
    published = [1.17769527464, 0.722186925664, 0.371539746471, 0.360755386843]
    assert values == pytest.approx(published, abs=1e-6)
    descriptor = np.load(test_data / "reference/m2dp/kitti00_000000_descriptor_192.npy")
    for preset in ("paper", "author"):
        found = fusionslam.m2dp(scan, preset=preset)
        assert min(distance(found, descriptor), distance(found, -descriptor)) <= 1e-4


@rows("name", ["town_040", "town_150"])
def test_the_author_preset_moves_at_most_64_votes_and_leaves_out_the_last_point(name: str) -> None:
    points = load_made(name)[0]
    expected = np.load(MADE / "m2dp_matlab.npz")[f"{name}_signature"]
    signature = fusionslam.m2dp_signature(points, preset="author")
    missing = (expected.sum(axis=1) - signature.sum(axis=1)) * len(points)
    assert missing == pytest.approx(np.ones(64), abs=1e-6)
    differing = round(float(np.abs(signature - expected).sum() * len(points)))
    assert (differing - 64) / 2 <= 64  # float axes move votes at edges


def test_without_a_radius_shot_takes_five_times_the_resolution() -> None:
    points, colors = street(4, 1000)
    radius = 5 * fusionslam.cloud_resolution(points)
    for call in (fusionslam.shot, partial(fusionslam.cshot, colors=colors)):
        expected = call(points, normal_radius=radius)
        assert np.array_equal(call(points), expected)
        assert np.array_equal(call(points, normal_radius=None), expected)
