# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What candidates say of where the robot is: which agree, how much looks alike, densities."""

import math

import numpy as np
from numpy.typing import NDArray

from fusionslam.geometry.se2 import Pose, find_near
from fusionslam.storage.arrays import Floats

_SAME_M, _SAME_RAD = 0.5, 0.3
"""Candidates whose poses of the robot are this near each other say the same."""
_ALIKE = 0.5
"""Probability from which on a place counts as a look-alike."""


def agree(poses: Floats, pose: Pose) -> NDArray[np.bool_]:
    """Which poses of the robot are one of them, for all that alignments can tell."""
    return find_near(poses, pose, _SAME_M, _SAME_RAD)


def count_look_alikes(poses: Floats, probabilities: Floats) -> tuple[Floats, Floats]:
    """How much elsewhere looks like the scan.

    Views of one place, which put the robot at the same pose, count once.

    Returns:
        For each candidate, float64 (n,), the sum of the probabilities of others; and the poses of
        those that are likely, float64 (k, 3).
    """
    left, leaders = np.ones(len(poses), bool), []
    for index in np.argsort(-probabilities, kind="stable"):
        if left[index]:
            leaders.append(index)
            left &= ~agree(poses, poses[index])
    alike = np.full(len(poses), probabilities[leaders].sum())
    for leader in leaders:
        alike[agree(poses, poses[leader])] -= probabilities[leader]
    likely = [leader for leader in leaders if probabilities[leader] >= _ALIKE]
    return alike.clip(0), poses[likely]


def density(error_m: float, error_rad: float, sd_m: float, sd_rad: float) -> float:
    """Of a normal distribution over positions and headings, per square metre and radian."""
    square = (error_m / sd_m) ** 2 + (error_rad / sd_rad) ** 2
    return math.exp(-square / 2) / (math.tau * math.sqrt(math.tau) * sd_m**2 * sd_rad)
