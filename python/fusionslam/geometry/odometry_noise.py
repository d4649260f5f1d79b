# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate odometry: the ground truth motion, with or without errors."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError
from fusionslam.geometry.trajectory import Trajectory, ground_poses


class OdometryConfig(Section):
    """Errors of odometry; none by default.

    Noise is white: its standard deviation is given for one second of driving and grows with the
    square root of time, at any rate. After T seconds it is ``speed_noise * sqrt(T)`` metres for the
    distance forwards and ``turn_noise * sqrt(T)`` radians for the heading.
    """

    scale: float = option(1.0, "factor on every distance", gt=0, le=10)
    rotation_scale: float = option(1.0, "factor on every turn", gt=0, le=10)
    speed_noise: float = option(
        0.0,
        "standard deviation of the forward distance after one second",
        unit="m/sqrt(s)",
        ge=0,
        le=10,
    )
    turn_noise: float = option(
        0.0, "standard deviation of the heading after one second", unit="rad/sqrt(s)", ge=0, le=10
    )
    seed: int = option(0, "decides the noise", ge=0)

    @property
    def neutral(self) -> bool:
        """True if there are no errors."""
        factors = (self.scale, self.rotation_scale)
        return factors == (1, 1) and self.speed_noise == 0 and self.turn_noise == 0


class OdometryTrack(NamedTuple):
    """Odometry at N times.

    Attributes:
        stamps_ns: int64 (N), increasing.
        poses: float64 (N, 4, 4), odom_from_base; the first one is the true world_from_base, so
            that without errors the odometry frame is the world frame.
        linear: float64 (N, 3), m/s in the base's frame, over the step that ends at the stamp (for
            the first stamp: the step that starts there).
        angular: float64 (N, 3), rad/s, likewise.
    """

    stamps_ns: NDArray[np.int64]
    poses: Floats
    linear: Floats
    angular: Floats


def simulate_odometry(
    trajectory: Trajectory,
    config: OdometryConfig,
    rate_hz: float,
    *,
    also_ns: NDArray[np.int64] | None = None,
) -> OdometryTrack:
    """Simulate odometry along a trajectory at ``rate_hz``, from its first pose on.

    ``also_ns``, int64 (m), are further stamps within the trajectory; regular ones within a
    millisecond of them are left out.

    Each step is an arc: the robot turns by half the step's angle, goes straight, and turns by the
    other half. Scale factors and noise change angle and translation, then the steps are chained
    again. Without errors the poses are exactly those of the trajectory.

    Raises:
        ConfigError: the rate is not above 0, or so low that there are fewer than two stamps.
    """
    stamps = _stamps(trajectory, rate_hz)
    if also_ns is not None:
        after = np.searchsorted(also_ns, stamps).clip(1, len(also_ns) - 1)
        away = np.minimum(np.abs(stamps - also_ns[after - 1]), np.abs(stamps - also_ns[after]))
        stamps = np.union1d(stamps[away > 1_000_000], also_ns)
    seconds = stamps / 1e9
    x, y, yaw = trajectory.places(seconds)
    gap = np.diff(seconds)
    turn, way = _steps(x, y, yaw)
    if not config.neutral:
        turn, way = _add_errors(turn, way, gap, config)
        x, y, yaw = _chain_steps(x[0], y[0], yaw[0], turn, way)
    still = np.zeros_like(gap)
    rates = np.stack([way[0] / gap, way[1] / gap, still, still, still, turn / gap], axis=1)
    rates = np.concatenate([rates[:1], rates])  # the first one repeated
    return OdometryTrack(stamps, ground_poses(x, y, yaw), rates[:, :3], rates[:, 3:])


def add_odometry_errors(places: Floats, seconds: Floats, config: OdometryConfig) -> Floats:
    """Simulate odometry at the given poses of a drive.

    Args:
        places: float64 (N, 3), true x, y in metres and yaw in radians, wrapped or not.
        seconds: float64 (N), increasing.
        config: the errors.

    Returns:
        float64 (N, 3) in the frame in which the first pose is the true one; without errors
        ``places``.
    """
    if config.neutral or len(places) < 2:
        return places
    x, y, yaw = places[:, 0], places[:, 1], np.unwrap(places[:, 2])
    turn, way = _add_errors(*_steps(x, y, yaw), np.diff(seconds), config)
    return np.stack(_chain_steps(x[0], y[0], yaw[0], turn, way), axis=1)


def _add_errors(
    turn: Floats, way: Floats, gap: Floats, config: OdometryConfig
) -> tuple[Floats, Floats]:
    """Add errors to angles (N - 1) and translations (2, N - 1) of steps of ``gap`` seconds."""
    rng = np.random.default_rng([config.seed, 0x0D0])
    noise = rng.standard_normal((2, len(gap))) * np.sqrt(gap)
    way = config.scale * way
    way[0] += config.speed_noise * noise[0]
    return config.rotation_scale * turn + config.turn_noise * noise[1], way


def _stamps(trajectory: Trajectory, rate_hz: float) -> NDArray[np.int64]:
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ConfigError(
            f"rate_hz is {rate_hz}, expected more than 0",
            code="out-of-range",
            fields=("rate_hz", str(rate_hz)),
        )
    # A last stamp that rounding puts after the last pose is meant to be at it.
    count = int(np.floor(trajectory.duration_s * rate_hz + 1e-6)) + 1
    if count < 2:
        raise ConfigError(
            f"rate_hz is {rate_hz}: fewer than two stamps in the {trajectory.duration_s:.3f} s "
            "of the trajectory",
            code="out-of-range",
            fields=("rate_hz", str(rate_hz)),
        )
    after = np.round(np.arange(count) / rate_hz * 1e9).astype(np.int64)
    return after + round(float(trajectory.seconds[0]) * 1e9)


def _steps(x: Floats, y: Floats, yaw: Floats) -> tuple[Floats, Floats]:
    """Angles, (N - 1), and translations forwards and to the left, (2, N - 1), between poses.

    Translations are relative to the heading in the middle of the step.
    """
    turn, dx, dy = np.diff(yaw), np.diff(x), np.diff(y)
    c, s = np.cos(yaw[:-1] + turn / 2), np.sin(yaw[:-1] + turn / 2)
    return turn, np.stack([c * dx + s * dy, c * dy - s * dx])


def _chain_steps(
    x: float, y: float, yaw: float, turn: Floats, way: Floats
) -> tuple[Floats, Floats, Floats]:
    """Chain steps from a first pose: x, y, yaw, (N) each."""
    yaws = yaw + np.concatenate([[0.0], np.cumsum(turn)])
    c, s = np.cos(yaws[:-1] + turn / 2), np.sin(yaws[:-1] + turn / 2)
    xs = x + np.concatenate([[0.0], np.cumsum(c * way[0] - s * way[1])])
    ys = y + np.concatenate([[0.0], np.cumsum(s * way[0] + c * way[1])])
    return xs, ys, yaws


DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.01)
