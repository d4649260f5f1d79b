# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated IMUs measure the motion of their axes, with the errors that are stated."""

import numpy as np
import pytest

from fusionslam.base.arrays import Floats
from fusionslam.geometry.se3 import exp
from fusionslam.sim.imu import GRAVITY, simulate_imu
from fusionslam.sim.robot import ImuMount
from rows import rows

CLEAR = {
    name: 0.0
    for name in ("gyro_noise", "gyro_bias", "gyro_walk", "accel_noise", "accel_bias", "accel_walk")
}
MOUNT = exp(np.array([0.5, 0.0, 0.2, 0.3, -0.2, 1.0]))
"""base_from_imu."""


def test_it_measures_turns_and_the_pull_of_a_curve_in_its_own_axes() -> None:
    """A circle of 4 m at 2 m/s: 0.5 rad/s, and 1 m/s^2 inwards at its centre."""

    def base(seconds: Floats) -> Floats:
        return exp(np.outer(seconds, [2.0, 0, 0, 0, 0, 0.5]))

    seconds = np.linspace(1, 5, 9)
    mount = np.eye(4)
    mount[:3, :3] = MOUNT[:3, :3]
    track = simulate_imu(
        lambda t: base(t) @ mount, ImuMount(**CLEAR), seconds, np.random.default_rng(0)
    )
    turned = track.angular @ mount[:3, :3].T
    np.testing.assert_allclose(turned, np.tile([0, 0, 0.5], (9, 1)), atol=1e-6)
    felt = track.linear @ mount[:3, :3].T
    np.testing.assert_allclose(felt, np.tile([0, 1.0, 9.80665], (9, 1)), atol=1e-4)


def still(seconds: Floats) -> Floats:
    return np.tile(MOUNT, (len(seconds), 1, 1))


def test_at_rest_it_measures_gravity_upwards() -> None:
    track = simulate_imu(still, ImuMount(**CLEAR), np.arange(0, 1, 0.005), np.random.default_rng(0))
    assert not track.angular.any()
    np.testing.assert_allclose(
        track.linear @ MOUNT[:3, :3].T, np.tile(GRAVITY, (200, 1)), atol=1e-12
    )


def allan_deviation(values: Floats, rate_hz: float, seconds: float) -> float:
    """Root of half the mean square of differences between means over neighbouring times."""
    count = round(seconds * rate_hz)
    means = values[: len(values) // count * count].reshape(-1, count, values.shape[1]).mean(axis=1)
    return float(np.sqrt((np.diff(means, axis=0) ** 2).mean() / 2))


@rows(
    "changes, field, seconds, stated",
    [
        ({"gyro_noise": 1e-3}, "angular", 0.1, 1e-3 / 0.1**0.5),
        ({"gyro_noise": 1e-3}, "angular", 2.0, 1e-3 / 2**0.5),
        ({"gyro_walk": 1e-3}, "angular", 2.0, 1e-3 * (2 / 3) ** 0.5),
        ({"accel_noise": 1e-2}, "linear", 0.5, 1e-2 / 0.5**0.5),
        ({"accel_walk": 1e-2}, "linear", 5.0, 1e-2 * (5 / 3) ** 0.5),
    ],
)
def test_allan_deviations_are_those_of_the_stated_densities(
    changes: dict[str, float], field: str, seconds: float, stated: float
) -> None:
    mount = ImuMount(**CLEAR | changes, rate_hz=20.0)
    times = np.arange(0, 1000, 0.05)
    values = getattr(simulate_imu(still, mount, times, np.random.default_rng(1)), field)
    assert allan_deviation(values, 20.0, seconds) == pytest.approx(stated, rel=0.1)


def test_biases_are_drawn_once() -> None:
    mount = ImuMount(**CLEAR | {"gyro_bias": 0.1, "accel_bias": 1.0})
    times = np.arange(0, 0.05, 0.005)
    starts = [simulate_imu(still, mount, times, np.random.default_rng(seed)) for seed in range(300)]
    for found, bias in (("angular", 0.1), ("linear", 1.0)):
        drawn = np.array(
            [
                getattr(each, found) - MOUNT[:3, :3].T @ GRAVITY * (found == "linear")
                for each in starts
            ]
        )
        assert np.ptp(drawn, axis=1).max() < 1e-9
        assert drawn[:, 0].std() == pytest.approx(bias, rel=0.1)
