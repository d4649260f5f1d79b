# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated odometry: the truth without errors, and errors of the size that is asked for."""

import numpy as np
import pytest
from numpy.typing import NDArray

from error_codes import has_code
from fusionslam.config import merged
from fusionslam.errors import ConfigError
from fusionslam.geometry.odometry_noise import OdometryConfig, simulate_odometry
from fusionslam.geometry.trajectory import Trajectory
from rows import rows

SEEDS = 100
SPEED, SECONDS = 0.5, 40.0
# A mean of 100 seeds is off by more than 3.5 of its deviations in 1 of 2000 cases; a deviation
# estimated from 100 values has a relative deviation of 1 / sqrt(200) = 7 %.
FAR, LOOSE = 3.5, 0.25


def straight() -> Trajectory:
    t = np.linspace(0, SECONDS, 401)
    return Trajectory(t, 1 + SPEED * t, np.full_like(t, 2.0), np.zeros_like(t))


def spot_turn(angle: float) -> Trajectory:
    t = np.linspace(0, SECONDS, 401)
    return Trajectory(t, np.full_like(t, 1.0), np.full_like(t, 2.0), 0.3 + angle * t / SECONDS)


def curvy() -> Trajectory:
    t = np.arange(3, 23, 1 / 30)
    yaw = 0.2 + np.sin(t)
    steps = 0.5 / 30 * np.stack([np.cos(yaw), np.sin(yaw)])
    x, y = np.cumsum(steps, axis=1)
    return Trajectory(t, x, y, yaw)


def ends(trajectory: Trajectory, rate: float = 30.0, **errors: float) -> NDArray[np.float64]:
    """x, y, yaw reached with each of the seeds, (SEEDS, 3)."""
    found = []
    for seed in range(SEEDS):
        track = simulate_odometry(trajectory, OdometryConfig(seed=seed, **errors), rate)
        turned = track.angular[1:, 2] @ np.diff(track.stamps_ns) / 1e9
        found.append([*track.poses[-1, :2, 3], trajectory.yaw[0] + turned])
    return np.array(found)


def is_near(values: NDArray[np.float64], mean: float, deviation: float) -> bool:
    right = abs(values.mean() - mean) < FAR * deviation / np.sqrt(SEEDS)
    return bool(right and abs(values.std(ddof=1) / deviation - 1) < LOOSE)


def test_without_errors_odometry_is_the_truth_with_the_speeds_of_the_drive() -> None:
    drive = curvy()
    track = simulate_odometry(drive, OdometryConfig(seed=5), 50.0)
    assert np.array_equal(track.poses, drive.at(track.stamps_ns / 1e9))
    assert track.stamps_ns[0] == 3_000_000_000
    assert set(np.diff(track.stamps_ns)) == {20_000_000}
    assert track.stamps_ns[-1] <= drive.seconds[-1] * 1e9 < track.stamps_ns[-1] + 20_000_000
    track = simulate_odometry(curvy(), OdometryConfig(), 30.0)
    assert track.linear.shape == track.angular.shape == (len(track.stamps_ns), 3)
    assert np.allclose(track.linear[:, 0], 0.5, atol=2e-3)
    assert np.abs(track.linear[:, 1]).max() < 0.02
    assert np.array_equal(track.linear[0], track.linear[1])
    middle = (track.stamps_ns[1:] + track.stamps_ns[:-1]) / 2e9
    assert np.allclose(track.angular[1:, 2], np.cos(middle), atol=1e-3)
    assert not track.linear[:, 2].any()
    assert not track.angular[:, :2].any()


@rows("rate", [10.0, 30.0])
def test_noise_of_the_speed_spreads_the_way_forwards_only(rate: float) -> None:
    x, y, yaw = ends(straight(), rate, speed_noise=0.05).T
    assert is_near(x, 1 + SPEED * SECONDS, 0.05 * np.sqrt(SECONDS))
    assert not np.ptp(y) and not np.ptp(yaw)


@rows("rate", [10.0, 30.0])
def test_noise_of_the_turn_rate_spreads_the_heading_and_then_the_way(rate: float) -> None:
    noise = 0.01
    x, y, yaw = ends(straight(), rate, turn_noise=noise).T
    assert is_near(yaw, 0.0, noise * np.sqrt(SECONDS))
    # y' = v sin(heading), the heading a Brownian motion: an integral with variance v^2 s^2 T^3 / 3.
    assert is_near(y, 2.0, SPEED * noise * np.sqrt(SECONDS**3 / 3))
    # E cos(heading) = exp(-s^2 t / 2), integrated over the way.
    expected = 1 + SPEED * (1 - np.exp(-(noise**2) * SECONDS / 2)) / (noise**2 / 2)
    # 1 - cos(heading) is about heading^2 / 2: the integral has variance v^2 s^4 T^4 / 12.
    assert abs(x.mean() - expected) < FAR * SPEED * noise**2 * SECONDS**2 / np.sqrt(12 * SEEDS)


def test_turning_on_the_spot_moves_nothing_and_factors_go_with_noise() -> None:
    x, y, yaw = ends(spot_turn(4 * np.pi), turn_noise=0.03).T
    assert is_near(yaw, 0.3 + 4 * np.pi, 0.03 * np.sqrt(SECONDS))
    assert not np.ptp(x) and not np.ptp(y)
    errors = {"scale": 1.05, "rotation_scale": 0.9, "speed_noise": 0.02, "turn_noise": 0.03}
    _, _, yaw = ends(spot_turn(4 * np.pi), **errors).T
    assert is_near(yaw, 0.3 + 0.9 * 4 * np.pi, 0.03 * np.sqrt(SECONDS))
    x, y, _ = ends(straight(), **{**errors, "turn_noise": 0.0}).T
    assert is_near(x, 1 + 1.05 * SPEED * SECONDS, 0.02 * np.sqrt(SECONDS))
    assert not np.ptp(y)


def test_factors_turn_a_circle_into_a_larger_arc() -> None:
    t = np.linspace(0, 2 * np.pi, 2001)
    circle = Trajectory(t, np.sin(t), 1 - np.cos(t), t)
    end = simulate_odometry(circle, OdometryConfig(scale=1.2, rotation_scale=0.75), 100.0)
    angle = 0.75 * end.stamps_ns[-1] / 1e9
    radius = 1.2 / 0.75
    expected = [radius * np.sin(angle), radius * (1 - np.cos(angle))]
    assert np.allclose(end.poses[-1, :2, 3], expected, atol=1e-3)


def test_the_seed_decides_the_noise() -> None:
    config = OdometryConfig(seed=3, speed_noise=0.1, turn_noise=0.1)
    first, again = (simulate_odometry(curvy(), config, 30.0) for _ in range(2))
    assert np.array_equal(first.poses, again.poses)
    other = simulate_odometry(curvy(), merged(config, {"seed": 4}), 30.0)
    assert not np.array_equal(first.poses, other.poses)
    assert np.array_equal(first.poses[0], curvy().at([3.0])[0])


@rows("rate", [0.0, -1.0, float("nan"), float("inf"), 0.01])
def test_rates_without_sense_are_refused(rate: float) -> None:
    with pytest.raises(ConfigError, check=has_code("out-of-range", "rate_hz", str(rate))):
        simulate_odometry(curvy(), OdometryConfig(), rate)


def test_errors_without_sense_are_refused() -> None:
    with pytest.raises(ConfigError, match="speed_noise"):
        merged(OdometryConfig(), {"speed_noise": -0.1})
    unknown = has_code("unknown-key", "rotation_scal")
    with pytest.raises(ConfigError, match="'rotation_scale'", check=unknown):
        merged(OdometryConfig(), {"rotation_scal": 1.1})
