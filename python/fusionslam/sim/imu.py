# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What an inertial measurement unit on a moving robot measures."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.geometry.se3 import inverse, log
from fusionslam.sim.robot import ImuMount

GRAVITY = np.array([0.0, 0.0, 9.80665])
"""m/s^2: what an accelerometer at rest measures, in the world."""
STEP_S = 0.01
"""Over which motion is differentiated: ways of robots have corners."""


class ImuTrack(NamedTuple):
    """What an IMU says at N times.

    Attributes:
        angular: float64 (N, 3), rad/s in its axes.
        linear: float64 (N, 3), m/s^2 in its axes, gravity included.
    """

    angular: Floats
    linear: Floats


def simulate_imu(
    poses: Callable[[Floats], Floats], mount: ImuMount, seconds: Floats, rng: np.random.Generator
) -> ImuTrack:
    """Measure turn rates and accelerations.

    White noise of a density d has the standard deviation d sqrt(rate) in each sample, and a bias
    walks by w / sqrt(rate) from sample to sample: the Allan deviation over a time t is
    d / sqrt(t) where noise rules, and w sqrt(t / 3) where the walk does (IEEE Std 952-1997).

    Args:
        poses: world_from_imu, float64 (M, 4, 4), at times (M,).
        mount: rate and errors.
        seconds: float64 (N,), times of the samples; ``poses`` move ``STEP_S`` before and after,
            too.
        rng: source of the errors.
    """
    before, here, after = (poses(seconds + step) for step in (-STEP_S, 0.0, STEP_S))
    angular = log(inverse(before) @ after)[:, 3:] / (2 * STEP_S)
    places = (before[:, :3, 3], here[:, :3, 3], after[:, :3, 3])
    felt = (places[0] - 2 * places[1] + places[2]) / STEP_S**2 + GRAVITY
    linear = np.einsum("nji,nj->ni", here[:, :3, :3], felt)
    root = np.sqrt(mount.rate_hz)
    errors = (
        (mount.gyro_noise, mount.gyro_bias, mount.gyro_walk),
        (mount.accel_noise, mount.accel_bias, mount.accel_walk),
    )
    measured = []
    for true, (noise, bias, walk) in zip((angular, linear), errors, strict=True):
        walked = np.cumsum(rng.standard_normal(true.shape), axis=0) * walk / root
        start = bias * rng.standard_normal(3)
        measured.append(true + start + walked + noise * root * rng.standard_normal(true.shape))
    return ImuTrack(*measured)
