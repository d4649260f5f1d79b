# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How firmly registered clouds hold each other."""

import numpy as np

from fusionslam.base.arrays import Floats, Points
from fusionslam.registration.config import RegistrationConfig


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


def motion_covariance(moved: Floats, points: Points) -> Floats:
    """Covariance, float64 (6, 6), of a cloud's pose that is measured on the move.

    A point that is measured t after the stamp lies off by the motion v t since then, for small
    motions. Where all that holds a pose was measured at t, the pose is off by v t. Which direction
    holds it is unknown, so t is uniform between the first point, off by a = v t0, and the last, off
    by b = v t1: the mean square is (a a' + b b' + (a b' + b a') / 2) / 3. A turn by 6 degrees from
    the stamp on makes 3.5 degrees of it.

    A turn also bends the cloud. If all directions hold the pose alike, with walls at the distance
    r, the points at angle s of the circle go sideways by r turn s / 2 pi, in the mean over the
    circle by r turn / 2 pi across the axis: the position is off by that.

    Args:
        moved: float64 (2, 6): a and b, as ``ScanMotion.within`` returns them.
        points: float32 (N, 3), metres, of the cloud; may be empty.
    """
    first, last = moved
    both = np.outer(first, last)
    spread: Floats = (np.outer(first, first) + np.outer(last, last) + (both + both.T) / 2) / 3
    if len(points):
        turn = last[3:] - first[3:]
        reach = float(np.median(np.linalg.norm(points, axis=1)))
        across = turn @ turn * np.eye(3) - np.outer(turn, turn)
        spread[:3, :3] += across * (reach / (2 * np.pi)) ** 2
    return spread
