# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""By what factor odometry's stated deviations are too small, of loops that agree."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fusionslam.base.arrays import Floats, Integers
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping.edge import Edge, chi_squares, measurement_errors
from fusionslam.mapping.gtsam_extra import Solver

MOST = 30.0
"""Factor beyond which loops that contradict odometry are rather false themselves."""

_STEPS = 8
_CLOSE = 0.03  # of the logarithm of the factor
_DRAWN = 1000  # degrees of freedom that odometry's share is drawn of, at least
_LEAST_LOOPS = 0.1  # factor on loops' deviations: clouds of made places fit exactly


def chi_ratio(poses: Floats, odometry: Sequence[Edge], loops: Sequence[Edge]) -> float:
    """Sum of all squared errors, of the one to be expected: six degrees of freedom for each loop.

    Args:
        poses: float64 (n, 4, 4), solved with these edges.
        odometry: edges with their stated deviations.
        loops: at least one.
    """
    total = chi_squares(poses, odometry).sum() + chi_squares(poses, loops).sum()
    return float(total / (6 * len(loops)))


def fit_scale(
    poses: Floats, odometry: Sequence[Edge], loops: Sequence[Edge], fixed: Integers, most: float
) -> float:
    """Find the factor on odometry's deviations with which its errors are as large as expected.

    Loops have a factor of their own, up to 1: their deviations are stated with a margin, and their
    errors would pass for small ones of odometry. Both are components of variance (Förstner 1979).

    Args:
        poses: float64 (n, 4, 4), near the solution.
        odometry: edges with the stated deviations.
        loops: edges that are believed.
        fixed: int64 (k), nodes that stay.
        most: the largest factor that is tried.

    Returns:
        The factor, 1 to ``most``.
    """
    scale, of_loops = most, 1.0
    for _ in range(_STEPS):
        ratio = scale / of_loops  # the solution depends on it alone
        poses = Solver(poses, odometry, fixed, ratio).solve(loops)
        share = _odometry_share(poses, odometry, loops, fixed, ratio)
        left = max(6 * len(loops) - share, 1.0)
        squares = chi_squares(poses, odometry).sum(), chi_squares(poses, loops).sum()
        former, scale = scale, float(np.clip(np.sqrt(squares[0] / share), 1.0, most))
        of_loops = float(np.clip(np.sqrt(squares[1] / left), _LEAST_LOOPS, 1.0))
        if abs(np.log(scale / former)) < _CLOSE:
            break
    return scale


def _odometry_share(
    poses: Floats, odometry: Sequence[Edge], loops: Sequence[Edge], fixed: Integers, ratio: float
) -> float:
    """Of the six degrees of freedom for each loop, those by which odometry's errors show.

    They are the trace of what is left of errors of odometry once the graph is solved, here of
    random ones (Hutchinson 1990).
    """
    ends = np.array([[edge.a, edge.b] for edge in (*odometry, *loops)])
    exact = inverse(poses[ends[:, 0]]) @ poses[ends[:, 1]]
    firm = [
        replace(edge, pose=pose) for edge, pose in zip(loops, exact[len(odometry) :], strict=True)
    ]
    roots = np.linalg.cholesky([edge.covariance for edge in odometry])
    rng = np.random.default_rng(0)
    draws = -(-_DRAWN // (6 * len(loops)))
    share = 0.0
    for _ in range(draws):
        signs = rng.choice([-1.0, 1.0], (len(odometry), 6, 1))
        off = exact[: len(odometry)] @ exp((roots @ signs)[..., 0])
        drawn = [replace(edge, pose=pose) for edge, pose in zip(odometry, off, strict=True)]
        solved = Solver(poses, drawn, fixed, ratio).solve(firm)
        errors = measurement_errors(solved[ends[: len(odometry)]], drawn)
        share -= float((signs * np.linalg.solve(roots, errors[..., None])).sum())
    return max(share / draws, 1.0)
