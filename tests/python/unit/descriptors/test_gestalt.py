# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""3D Gestalt descriptors against numpy, shifts and turns."""

import numpy as np
from numpy.typing import NDArray

import fusionslam
from fusionslam import GestaltConfig
from places import make_place, turn
from rows import rows

RADIUS = 5.0
CONFIG = GestaltConfig(radius=RADIUS, keypoints=40)


def blocks(points: np.ndarray, config: GestaltConfig = CONFIG) -> NDArray[np.float64]:
    return fusionslam.gestalt(points, config=config).reshape(-1, 66).astype(np.float64)


def reference(cloud: np.ndarray, keypoint: np.ndarray) -> NDArray[np.float64]:
    offsets = cloud.astype(np.float64) - keypoint
    offsets = offsets[np.hypot(offsets[:, 0], offsets[:, 1]) < RADIUS]
    flat = offsets[:, :2] - offsets[:, :2].mean(axis=0)
    axis = np.linalg.eigh(flat.T @ flat)[1][:, 1]
    axis *= np.sign(((flat @ axis) ** 3).sum())
    azimuth = np.arctan2(offsets[:, 1], offsets[:, 0]) - np.arctan2(axis[1], axis[0])
    sector = (azimuth % (2 * np.pi)) / (2 * np.pi) * 8
    ring = np.hypot(offsets[:, 0], offsets[:, 1]) / RADIUS * 4
    places = np.where(ring > 0, ring.astype(int) * 8 + sector.astype(int), 0)
    found = np.zeros((2, 32))
    for place in np.unique(places):
        heights = offsets[places == place, 2]
        found[:, place] = heights.mean(), heights.var()
    return found.ravel()


def test_blocks_hold_mean_and_variance_of_heights_about_points_of_the_cloud() -> None:
    points = make_place(0).points
    cloud, _, _ = fusionslam.voxel_downsample(points, None, size=CONFIG.leaf)
    agreeing = 0
    for block in blocks(points):
        at = np.flatnonzero((cloud[:, :2] == block[64:].astype(np.float32)).all(axis=1))
        assert len(at) >= 1
        expected = reference(cloud, cloud[at[0]])
        agreeing += np.allclose(block[:64], expected, atol=1e-4)
    # Of the others, a point lies on the border of two sectors.
    assert agreeing >= 36


def test_shifts_change_positions_only() -> None:
    points = make_place(1).points
    shift = np.array([4, -8, 2], np.float32)  # whole cubes
    known, moved = blocks(points), blocks(points + shift)
    np.testing.assert_allclose(moved[:, 64:], known[:, 64:] + shift[:2], atol=1e-3)
    same = np.isclose(moved[:, :64], known[:, :64], atol=1e-2).all(axis=1)
    assert same.mean() > 0.8  # of the others, a point has changed its sector by rounding


@rows("quarters", [1, 2, 3])
def test_quarter_turns_turn_positions_only(quarters: int) -> None:
    points = make_place(2).points
    known, turned = blocks(points), blocks(turn(points, 90 * quarters))
    expected = turn(np.column_stack([known[:, 64:], np.zeros(40)]), 90 * quarters)[:, :2]
    np.testing.assert_allclose(turned[:, 64:], expected, atol=1e-3)
    same = np.isclose(turned[:, :64], known[:, :64], atol=1e-2).all(axis=1)
    assert same.mean() > 0.8


def test_unused_blocks_are_zero_and_come_last() -> None:
    few = make_place(3).points[::40]
    found = blocks(few, GestaltConfig(keypoints=5000, radius=RADIUS, min_points=20))
    used = found.any(axis=1)
    assert 0 < used.sum() < len(few)
    assert (np.sort(used)[::-1] == used).all()


def test_fewer_keypoints_are_the_first_ones() -> None:
    points = make_place(4).points
    few = blocks(points, GestaltConfig(radius=RADIUS, keypoints=7))
    np.testing.assert_array_equal(few, blocks(points)[:7])
