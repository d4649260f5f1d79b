# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Hills lie under all of a world, robots stand on them, and bodies sway as much as is stated."""

import numpy as np
import pytest

from fusionslam.geometry.se3 import log
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sim.motion.riding import Hills, HillsConfig, Sway, SwayConfig
from fusionslam.sim.world import scene_of
from rows import rows
from worlds import EVEN, PLAIN, block, floor

HILLS = Hills(HillsConfig(height_m=2.0, length_m=60.0), 3)
RANDOM = np.random.default_rng(1)


def test_hills_are_as_high_as_is_stated_and_their_slope_is_that_of_their_height() -> None:
    places = RANDOM.uniform(-5000, 5000, (20000, 2))
    assert HILLS.height(places).std() == pytest.approx(2.0, rel=0.05)
    step = 1e-4
    for axis in np.eye(2):
        rise = HILLS.height(places + step * axis) - HILLS.height(places - step * axis)
        np.testing.assert_allclose(rise / (2 * step), HILLS.slope(places) @ axis, atol=1e-6)


def test_a_robot_stands_upright_on_the_slope_and_looks_where_it_did() -> None:
    x, y = RANDOM.uniform(-100, 100, (2, 50))
    flat = ground_poses(x, y, RANDOM.uniform(-3, 3, 50))
    stood = HILLS.stand(flat)
    turns = stood[:, :3, :3]
    np.testing.assert_allclose(
        turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12
    )
    assert np.linalg.det(turns) == pytest.approx(1.0)
    np.testing.assert_allclose(stood[:, 2, 3], HILLS.height(stood[:, :3, 3]))
    # Two steps along the ground are at right angles to what is up.
    slope = HILLS.slope(stood[:, :3, 3])
    for k, along in enumerate(([1.0, 0.0], [0.0, 1.0])):
        step = np.c_[np.tile(along, (50, 1)), slope[:, k]]
        np.testing.assert_allclose(np.einsum("ni,ni->n", step, turns[:, :, 2]), 0, atol=1e-12)
    ahead = turns[:, :2, 0] / np.linalg.norm(turns[:, :2, 0], axis=1, keepdims=True)
    np.testing.assert_allclose(ahead, flat[:, :2, 0], atol=1e-12)
    none = Hills(HillsConfig(), 3)
    assert none.is_flat and none.stand(flat) is flat


def test_a_world_is_split_until_it_bends_and_stays_what_it_is() -> None:
    scene = scene_of([floor(40.0), block("post", (1, 1, 0), (1.2, 1.2, 3))], [PLAIN], EVEN)
    raised = HILLS.raise_scene(scene)
    corners = raised.mesh.triangles.astype(np.float64)
    ground = raised.part == scene.part[0]
    np.testing.assert_allclose(corners[ground, :, 2], HILLS.height(corners[ground]), atol=1e-4)
    middle = corners[ground].mean(axis=1)
    assert np.abs(middle[:, 2] - HILLS.height(middle)).max() < 0.05
    u, v = np.moveaxis(np.diff(corners[ground, :, :2], axis=1), 1, 0)
    assert ((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2).sum() == pytest.approx(80.0**2, rel=1e-6)
    # Colours are where they were: texture coordinates are still linear in x and y.
    rows_, places = raised.mesh.uv[ground].reshape(-1, 2), corners[ground, :, :2].reshape(-1, 2)
    _, residual, rank, _ = np.linalg.lstsq(np.c_[places, np.ones(len(places))], rows_, rcond=None)
    assert rank == 3 and residual.max() < 1e-6
    assert (raised.part == scene.part[-1]).sum() == (scene.part == scene.part[-1]).sum()
    assert Hills(HillsConfig(), 3).raise_scene(scene) is scene


@rows("name, row", [("along_m", 0), ("aside_m", 1), ("heave_m", 2)])
def test_bodies_move_as_far_as_is_stated(name: str, row: int) -> None:
    seconds = np.arange(1.0, 4000.0, 0.37)
    moved = log(Sway(SwayConfig(**{name: 0.2}), 5).at(seconds))
    assert moved[:, row].std() == pytest.approx(0.2, rel=0.05)
    assert not np.delete(moved, row, axis=1).any()


@rows("name, row", [("roll_deg", 3), ("pitch_deg", 4), ("yaw_deg", 5)])
def test_bodies_turn_as_far_as_is_stated(name: str, row: int) -> None:
    seconds = np.arange(1.0, 4000.0, 0.37)
    turned = np.degrees(log(Sway(SwayConfig(**{name: 4.0}), 5).at(seconds)))
    assert turned[:, row].std() == pytest.approx(4.0, rel=0.05)
    np.testing.assert_allclose(np.delete(turned, row, axis=1), 0, atol=1e-9)


def test_sway_begins_gently_and_is_as_quick_as_is_stated() -> None:
    sway = Sway(SwayConfig(roll_deg=5.0, rate_hz=2.0), 1)
    seconds = np.arange(0, 200, 0.01)
    roll = log(sway.at(seconds))[:, 3]
    steps = np.abs(np.diff(roll))
    assert roll[0] == 0 and steps[0] < 0.05 * steps.mean()
    crossings = np.count_nonzero(np.diff(np.sign(roll[100:])) > 0) / 199
    assert 1.0 < crossings < 3.0
    assert Sway(SwayConfig(), 1).is_still
