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


def edge_errors(poses: Floats, edges: Sequence[Edge]) -> Floats:
    """float64 (m, 6): small motions from where edges have their nodes b to where these are."""
    if not edges:
        return np.empty((0, 6))
    a, b = (np.array([getattr(edge, end) for edge in edges]) for end in "ab")
    measured = np.array([edge.pose for edge in edges])
    return log(inverse(measured) @ inverse(poses[a]) @ poses[b])


def chi_squares(poses: Floats, edges: Sequence[Edge]) -> Floats:
    """float64 (m): squared errors of edges in units of their covariances."""
    if not edges:
        return np.empty(0)
    errors = edge_errors(poses, edges)
    covariances = np.array([edge.covariance for edge in edges])
    weighted = np.linalg.solve(covariances, errors[..., None])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", errors, weighted))
