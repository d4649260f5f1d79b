# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How firmly registered clouds hold each other."""

import numpy as np

from fusionslam.registration.config import RegistrationConfig
from fusionslam.storage.arrays import Floats


def weak_directions(information: Floats, ratio: float) -> Floats:
    """Find the directions, float64 (k, n), that a translation's information (n, n) hardly holds.

    Of the directions in the order of their information, they are those before a jump by ``ratio``.
    """
    strengths, axes = np.linalg.eigh(information)
    jumps = np.flatnonzero(strengths[1:] > ratio * strengths[:-1])
    weak: Floats = axes.T[: jumps[-1] + 1 if jumps.size else 0]
    return weak


def pose_covariance(information: Floats, degenerate: Floats, config: RegistrationConfig) -> Floats:
    """Covariance of a pose, float64 (6, 6), of its information and the directions it hardly holds.

    The information of GICP claims millimetres where errors are centimetres: hence the floor.
    """
    # Nobody is more than half a turn off, or 100 m.
    prior = np.repeat([1 / 100**2, 1 / np.pi**2], 3)
    floor = np.repeat([config.position_sd, np.radians(config.angle_sd)], 3) ** 2
    covariance = np.linalg.inv(information + np.diag(prior)) + np.diag(floor)
    covariance[:3, :3] += config.degenerate_sd**2 * degenerate.T @ degenerate
    return (covariance + covariance.T) / 2
