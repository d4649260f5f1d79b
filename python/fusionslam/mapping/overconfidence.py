# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""By what factor odometry's stated deviations are too small, of loops that agree."""

from collections.abc import Callable, Sequence

import numpy as np

from fusionslam.mapping.edge import Edge
from fusionslam.mapping.edge_errors import chi_squares
from fusionslam.storage.arrays import Floats

MOST = 30.0
"""Factor beyond which loops that contradict odometry are rather false themselves."""

_STEPS = 6
_CLOSE = 0.05  # of the logarithm of the factor


def chi_ratio(
    poses: Floats, odometry: Sequence[Edge], loops: Sequence[Edge], scale: float
) -> float:
    """Sum of all squared errors, of the one to be expected: six degrees of freedom for each loop.

    Args:
        poses: float64 (n, 4, 4), solved with these edges.
        odometry: edges, whose stated deviations are multiplied by ``scale``.
        loops: at least one.
    """
    total = chi_squares(poses, odometry).sum() / scale**2 + chi_squares(poses, loops).sum()
    return float(total / (6 * len(loops)))


def fit_scale(
    solve: Callable[[float], Floats],
    odometry: Sequence[Edge],
    loops: Sequence[Edge],
    most: float,
) -> float:
    """Find the factor on odometry's deviations with which the errors are as large as expected.

    Args:
        solve: gives the poses (n, 4, 4) that fit best for a factor.
        odometry: edges with the stated deviations.
        loops: edges that are believed.
        most: the largest factor that is tried.

    Returns:
        The factor, 1 to ``most``.
    """

    def excess(log_scale: float) -> float:
        scale = float(np.exp(log_scale))
        return float(np.log(chi_ratio(solve(scale), odometry, loops, scale)))

    low, high = 0.0, float(np.log(most))
    above, below = excess(low), excess(high)
    if above <= 0 or below >= 0:
        return float(np.exp(low if above <= 0 else high))
    for _ in range(_STEPS):
        if high - low < _CLOSE:
            break
        # Regula falsi, kept away from the ends so that both close in.
        share = min(max(above / (above - below), 0.15), 0.85)
        middle = low + share * (high - low)
        found = excess(middle)
        if found > 0:
            low, above = middle, found
        else:
            high, below = middle, found
    return float(np.exp(low + above / (above - below) * (high - low)))
