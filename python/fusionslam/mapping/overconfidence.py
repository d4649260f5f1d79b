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


def fit_scale(
    solve: Callable[[float], Floats], odometry: Sequence[Edge], loops: Sequence[Edge]
) -> float | None:
    """Find the factor on odometry's deviations with which the errors are as large as expected.

    The squared errors of all edges, in units of their covariances, then sum up to their number of
    degrees of freedom: six for each loop.

    Args:
        solve: gives the poses (n, 4, 4) that fit the loops best for a factor.
        odometry: edges with the stated deviations.
        loops: edges that are believed if odometry is not.

    Returns:
        The factor, 1 to ``MOST``; None if it is larger.
    """
    expected = 6 * len(loops)

    def excess(log_scale: float) -> float:
        scale = float(np.exp(log_scale))
        poses = solve(scale)
        total = chi_squares(poses, odometry).sum() / scale**2 + chi_squares(poses, loops).sum()
        return float(np.log(total / expected))

    low, high = 0.0, float(np.log(MOST))
    above, below = excess(low), excess(high)
    if below > 0:
        return None
    if above <= 0:
        return 1.0
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
