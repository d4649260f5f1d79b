# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""bev_spectrum against numpy's FFT, and what shifts and turns of a cloud change."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import cells_cloud, walls
from fusionslam import (
    BevSpectrumConfig,
    Cloud,
    ConfigError,
    DescriptorConfig,
    FusionConfig,
)
from fusionslam.config import merged
from fusionslam.descriptors import (
    for_clouds,
    for_sequence,
    length_of,
    with_fitted,
    without_fitted,
)
from places import turn
from rows import rows

DIRECTIONS, FREQUENCIES, LAYERS = 60, 24, 3
CELL, HEIGHT = 2.0, 2.0
Floats = NDArray[np.float32]


def random_cloud(seed: int, reach: int = 12) -> Floats:
    """Points away from borders of cells and layers."""
    return cells_cloud(seed, CELL, reach, np.array([-0.5, 1.0, 2.2, 5.0]) - HEIGHT)


def reference(points: Floats, cell: float = CELL, height: float = HEIGHT) -> NDArray[np.float64]:
    """Point by point and sample by sample: directions x (layers, frequencies)."""
    images = np.zeros((LAYERS, 128, 128))
    for x, y, z in points.astype(np.float64):
        above = (z + height) / cell
        if above > 0.25 and math.hypot(x, y) / cell < 27.5:
            layer = 2 if above > 1.5 else 1 if above > 0.75 else 0
            images[layer, math.floor(x / cell), math.floor(y / cell)] = 1
    frequency = np.fft.fftfreq(128)
    blur = np.exp(-2 * (math.pi * 0.7) ** 2 * (frequency[:, None] ** 2 + frequency**2))
    spectra = np.log1p(np.abs(np.fft.fft2(images)) * blur)
    found = np.zeros((DIRECTIONS, LAYERS, FREQUENCIES))
    for direction in range(DIRECTIONS):
        for k in range(1, FREQUENCIES + 1):
            u = 2 * k * math.cos(math.pi * direction / DIRECTIONS)
            v = 2 * k * math.sin(math.pi * direction / DIRECTIONS)
            i, j = math.floor(u), math.floor(v)
            corners = spectra[:, [i, i + 1]][:, :, [j, j + 1]]
            found[direction, :, k - 1] = (
                np.array([i + 1 - u, u - i]) @ corners @ np.array([j + 1 - v, v - j])
            )
    flat = (found - found.mean(axis=0)).reshape(DIRECTIONS, -1)
    return flat / np.linalg.norm(flat, axis=1, keepdims=True)


def columns(descriptor: Floats) -> NDArray[np.float64]:
    return descriptor.reshape(DIRECTIONS, -1).astype(np.float64)


@rows("seed", range(2))
def test_it_is_the_log_spectrum_over_direction(seed: int) -> None:
    points = random_cloud(seed, reach=20)  # corners beyond 27.5 cells are left out
    found = fusionslam.bev_spectrum(points)
    assert found.dtype == np.float32
    assert found.shape == (4320,)
    np.testing.assert_allclose(columns(found), reference(points), atol=2e-5)
    smaller = BevSpectrumConfig(cell=0.4, height=0.2)
    in_rooms = (points * 0.2).astype(np.float32)
    expected = reference(in_rooms, 0.4, 0.2)
    np.testing.assert_allclose(
        columns(fusionslam.bev_spectrum(in_rooms, config=smaller)), expected, atol=2e-5
    )


def test_two_posts_interfere_as_by_hand() -> None:
    """Of two cells d apart along x, the amplitude at k periods in 64 cells is 2 |cos(pi k d / 64)|
    along x and 2 along y, times the blur's."""
    distance = 7
    posts = np.array([[1, 1, -1], [1 + CELL * distance, 1, -1]], np.float32)
    found = columns(fusionslam.bev_spectrum(posts)).reshape(DIRECTIONS, LAYERS, FREQUENCIES)
    assert (found[:, 1:] == 0).all()
    k = np.arange(1, FREQUENCIES + 1)
    blur = np.exp(-2 * (math.pi * 0.7 * k / 64) ** 2)
    along_x = np.log1p(2 * np.abs(np.cos(math.pi * k * distance / 64)) * blur)
    along_y = np.log1p(2 * blur)
    # The mean over directions is unknown here; it cancels in the difference of two columns, each
    # times its unknown length.
    lengths = np.linalg.lstsq(
        np.column_stack([found[0, 0], -found[30, 0]]), along_x - along_y, rcond=None
    )[0]
    difference = lengths[0] * found[0, 0] - lengths[1] * found[30, 0]
    np.testing.assert_allclose(difference, along_x - along_y, atol=1e-5)


@rows("shift", [(1, 0), (-4, 7), (8, 8)])
def test_a_shift_by_whole_cells_changes_nothing(shift: tuple[int, int]) -> None:
    points = random_cloud(5)
    moved = points + np.array([CELL * shift[0], CELL * shift[1], 0], np.float32)
    np.testing.assert_allclose(
        fusionslam.bev_spectrum(moved), fusionslam.bev_spectrum(points), atol=2e-5
    )


@rows("quarters", [1, 2, 3])
def test_quarter_turns_shift_the_directions(quarters: int) -> None:
    points = random_cloud(6)
    known = columns(fusionslam.bev_spectrum(points))
    turned = columns(fusionslam.bev_spectrum(turn(points, 90 * quarters)))
    np.testing.assert_allclose(turned, np.roll(known, 30 * quarters, axis=0), atol=2e-5)


@rows("steps", [1, 7, 20, 45, 59])
def test_turns_and_shifts_of_a_place_are_near_and_the_turn_is_found_twice(steps: int) -> None:
    place = walls(7)
    known = fusionslam.bev_spectrum(place)
    moved = fusionslam.bev_spectrum(turn(place + np.float32([3.3, -2.1, 0]), 3 * steps))
    other = fusionslam.bev_spectrum(walls(8))
    distance, doubled = fusionslam.compare_scan_contexts(moved, known)
    assert distance < 0.3
    assert distance < 0.5 * fusionslam.compare_scan_contexts(other, known)[0]
    # What was turned to the left sees the other turned to the right.
    assert abs(np.angle(np.exp(1j * (doubled + math.radians(6 * steps))))) < math.radians(6.1)


def test_noise_and_missing_points_change_little() -> None:
    rng = np.random.default_rng(9)
    place = walls(10)
    known = fusionslam.bev_spectrum(place)
    kept = place[rng.uniform(size=len(place)) < 0.6]
    noisy = (kept + rng.normal(0, 0.05, kept.shape)).astype(np.float32)
    assert fusionslam.compare_scan_contexts(fusionslam.bev_spectrum(noisy), known)[0] < 0.15
    assert fusionslam.compare_scan_contexts(known, known)[0] < 1e-6


def test_the_ground_and_what_is_far_count_for_nothing() -> None:
    points = random_cloud(11)
    rng = np.random.default_rng(11)
    ground = np.column_stack([rng.uniform(-50, 50, (500, 2)), rng.uniform(-3, -1.55, 500)])
    far = np.column_stack([rng.uniform(40, 90, (50, 2)), rng.uniform(0, 9, 50)])
    whole = np.concatenate([points, ground, far]).astype(np.float32)
    np.testing.assert_array_equal(fusionslam.bev_spectrum(whole), fusionslam.bev_spectrum(points))


def test_one_post_is_a_vector_without_nan() -> None:
    found = fusionslam.bev_spectrum(np.array([[3, 4, 0]], np.float32))
    assert np.isfinite(found).all()


def test_the_options_of_describe_are_those_of_the_function() -> None:
    cloud = Cloud(walls(12))
    config = merged(DescriptorConfig(), {"bev_spectrum": {"cell": 1.0, "height": 1.5}})
    expected = fusionslam.bev_spectrum(cloud.points, config=BevSpectrumConfig(cell=1.0, height=1.5))
    np.testing.assert_array_equal(fusionslam.describe(cloud, "bev_spectrum", config), expected)
    wide = merged(DescriptorConfig(), {"bev_spectrum": {"cell": 1000.0}})
    assert length_of("bev_spectrum", wide) == 4320


def test_the_robots_frame_lies_on_the_ground() -> None:
    robot = FusionConfig(frame="robot")
    chosen = for_clouds(DescriptorConfig(), "bev_spectrum", robot).bev_spectrum
    assert (chosen.height, chosen.cell) == (0, 0.4)
    given = merged(DescriptorConfig(), {"bev_spectrum": {"height": 0.3}})
    assert for_clouds(given, "bev_spectrum", robot).bev_spectrum.height == 0.3
    assert for_clouds(given, "m2dp", robot) == given
    with pytest.raises(ConfigError):
        for_clouds(DescriptorConfig(), "bev_spectrum", FusionConfig(frame="camera"))


@rows("reach, cell", [(2.0, 0.125), (10.0, 0.354), (25.0, 1.0), (40.0, 1.414), (80.0, 2.0)])
def test_cells_and_ground_are_fitted_to_the_first_cloud(reach: float, cell: float) -> None:
    generator = np.random.default_rng(1)
    around = generator.uniform(-1, 1, (40_000, 2))
    around = reach * around[np.hypot(*around.T) < 1]
    heights = generator.normal(-1.7, 0.01, len(around))
    cloud = Cloud(np.column_stack([around, heights]).astype(np.float32))
    fitted = for_sequence(DescriptorConfig(), ["m2dp", "bev_spectrum"], cloud).bev_spectrum
    values = fitted.model_dump()
    assert values["cell"] == pytest.approx(cell, abs=1e-3)
    assert values["height"] == pytest.approx(1.7 + cell / 10, abs=0.06)
    given = merged(DescriptorConfig(), {"bev_spectrum": {"cell": 0.7}})
    kept = for_sequence(given, ["bev_spectrum"], cloud).bev_spectrum.model_dump()
    assert kept == {"cell": 0.7, "height": values["height"]}
    assert for_sequence(given, ["m2dp", "scan_context"], cloud) == given


def test_what_was_fitted_is_taken_over_unless_it_is_given() -> None:
    cloud = Cloud(random_cloud(1))
    stored = for_sequence(DescriptorConfig(), ["shot", "bev_spectrum"], cloud)
    assert with_fitted(DescriptorConfig(), stored) == stored
    given = merged(DescriptorConfig(), {"bev_spectrum": {"height": 1.0}, "normal_radius": 0.3})
    taken = with_fitted(given, stored)
    assert taken.normal_radius == 0.3 and taken.bev_spectrum.model_dump() == {
        "cell": stored.bev_spectrum.model_dump()["cell"],
        "height": 1.0,
    }
    assert without_fitted(taken) == without_fitted(DescriptorConfig())
