# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How far edges are from where poses have their nodes."""

from collections.abc import Sequence

import numpy as np

from fusionslam.geometry.se3 import inverse, log
from fusionslam.mapping.edge import Edge
from fusionslam.storage.arrays import Floats

CHI2_99 = 16.811893829770927
"""scipy.stats.chi2.ppf(.99, 6), without its import."""
CHI2_999 = 22.457744484825323


def chi_squares(poses: Floats, edges: Sequence[Edge]) -> Floats:
    """float64 (m): squared errors of edges in units of their covariances, of nodes' poses."""
    ends = np.array([[edge.a, edge.b] for edge in edges], np.int64).reshape(-1, 2)
    return weigh_errors(measurement_errors(poses[ends], edges), edges)


def measurement_errors(poses: Floats, edges: Sequence[Edge]) -> Floats:
    """Small motions from where edges have their nodes b to where these are.

    Args:
        poses: float64 (m, 2, 4, 4), of the nodes a and b of each edge.
        edges: m of them.

    Returns:
        float64 (m, 6).
    """
    if not edges:
        return np.empty((0, 6))
    measured = np.array([edge.pose for edge in edges])
    return log(inverse(measured) @ inverse(poses[:, 0]) @ poses[:, 1])


def weigh_errors(errors: Floats, edges: Sequence[Edge]) -> Floats:
    """float64 (m): squares of errors (m, 6) in units of the edges' covariances."""
    if not edges:
        return np.empty(0)
    covariances = np.array([edge.covariance for edge in edges])
    weighted = np.linalg.solve(covariances, errors[..., None])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", errors, weighted))
