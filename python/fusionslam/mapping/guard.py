# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Whether evidence that loops did not provide agrees with them: steps that clouds measured.

Clouds of neighbouring keyframes measure the same steps as odometry. If a loop is right and odometry
is off, they have moved the way between its nodes towards it. If odometry is right, they have not.
The likelihood ratio of both decides (Neyman and Pearson 1933).
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fusionslam._core import OdometryTree
from fusionslam.base.arrays import Floats
from fusionslam.geometry.se3 import exp, inverse, log
from fusionslam.mapping.edge import CHI2_999, Edge, measurement_errors
from fusionslam.registration.result import Refusal

_FEWEST = 10
"""Loops that tell how good odometry is."""
_MARGIN = 2.0
"""On the squared error of the worst of them."""
_BEST = 0.1
"""Factor on odometry's deviations below which loops do not tell."""
_LEAST = 1e-3
"""Of odometry's variance, that of what steps move."""


def oppose_loops(
    tree: OdometryTree, steps: Mapping[int, Edge], loops: Sequence[Edge], sigmas: float
) -> dict[int, Refusal]:
    """Refuse loops where measured steps speak for odometry and against them.

    Where clouds leave steps open, as along a corridor, they say nothing; nor where odometry is as
    near to a loop as they could have brought it.

    Args:
        tree: odometry.
        steps: measurements of the way from its parent, by node of the tree.
        loops: between nodes of the tree that odometry connects.
        sigmas: by which steps must prefer odometry, standard deviations.

    Returns:
        Reasons by the loops' numbers, code "contradicts-steps" (number: the standard deviations).
    """
    if not (steps and loops):
        return {}
    fused = _fuse(tree, steps)
    ends = [(edge.a, edge.b) for edge in loops]
    driven, corrected = (
        measurement_errors(np.array([[each.pose(a), each.pose(b)] for a, b in ends]), loops)
        for each in (tree, fused)
    )
    before, after = (np.array([each.drift(a, b) for a, b in ends]) for each in (tree, fused))
    # In units of odometry's deviations: what steps leave of them, and what the loop does not know.
    root = np.linalg.cholesky(before)

    def in_units(covariances: Floats) -> Floats:
        return np.linalg.solve(root, np.linalg.solve(root, covariances).mT)

    left, own = in_units(after), in_units(np.array([edge.covariance for edge in loops]))
    error, other = (np.linalg.solve(root, each[..., None]) for each in (driven, corrected))
    taken, told = np.eye(6) - left, np.linalg.inv(np.eye(6) + own)
    moved, expected = error - other, taken @ told @ error
    spread = taken @ left + taken @ (np.eye(6) - told) @ taken + _LEAST * np.eye(6)
    if_driven, if_right = (
        (each.mT @ np.linalg.solve(spread, each))[:, 0, 0] for each in (moved, moved - expected)
    )
    # Steps that fit neither are worse than they state.
    inflation = np.maximum(np.minimum(if_driven, if_right) / 6, 1)
    preferred = np.sqrt(np.maximum(if_right - if_driven, 0) / inflation)
    return {
        edge.number: Refusal(
            "contradicts-steps",
            value,
            f"the steps that clouds measured on the way between agree with odometry, and by "
            f"{value:.3g} standard deviations not with the loop; {sigmas:g} are to be expected",
        )
        for edge, value in zip(loops, preferred.tolist(), strict=True)
        if value > sigmas
    }


def agreeing_scale(tree: OdometryTree, loops: Sequence[Edge]) -> float:
    """Factor, up to 1, on odometry's deviations that all its loops allow.

    Args:
        tree: odometry.
        loops: between nodes of the tree that odometry connects; right or wrong.
    """
    if len(loops) < _FEWEST:
        return 1.0
    poses = np.array([[tree.pose(edge.a), tree.pose(edge.b)] for edge in loops])
    errors = measurement_errors(poses, loops)
    spread = np.array([tree.drift(edge.a, edge.b) + edge.covariance for edge in loops])
    squares = np.einsum("ni,ni->n", errors, np.linalg.solve(spread, errors[..., None])[..., 0])
    return float(np.clip(np.sqrt(_MARGIN * squares.max() / 6), _BEST, 1))


def _fuse(tree: OdometryTree, steps: Mapping[int, Edge]) -> OdometryTree:
    """Odometry by its own steps and the measured ones together; not where both contradict."""
    parents = np.array([tree.parent(node) for node in range(len(tree))])
    poses = tree.poses
    driven = inverse(poses[parents]) @ poses
    drifts = np.array([tree.drift(parent, node) for node, parent in enumerate(parents.tolist())])
    measured = np.array([*steps])
    stated = np.array([steps[node].covariance for node in measured.tolist()])
    errors = log(inverse(driven[measured]) @ np.array([steps[k].pose for k in measured.tolist()]))
    gains = drifts[measured] @ np.linalg.inv(drifts[measured] + stated)
    both = errors[:, None] @ np.linalg.solve(drifts[measured] + stated, errors[..., None])
    fits = both[:, 0, 0] <= CHI2_999
    measured, gains = measured[fits], gains[fits]
    driven[measured] = driven[measured] @ exp((gains @ errors[fits][..., None])[..., 0])
    drifts[measured] -= gains @ drifts[measured]
    fused = OdometryTree()
    for node, parent in enumerate(parents.tolist()):
        if node == parent:
            fused.add_root(poses[node])
        else:
            drift = (drifts[node] + drifts[node].T) / 2
            fused.add(parent, driven[node], drift)
    return fused
