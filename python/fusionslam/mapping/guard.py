# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Whether evidence that loops did not provide agrees with them: steps that clouds measured.

Clouds of neighbouring keyframes measure the same steps as odometry. If a loop is right, they move
the way between its nodes from where odometry has it towards the loop. If it is false, they move it
as odometry's own error asks for. The ratio of both likelihoods decides (Neyman and Pearson 1933).
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
_BETTER = 1 / 3
"""Factor on odometry's deviations from which on they are as stated."""
_BEST = 0.1
"""Factor on odometry's deviations below which loops do not tell."""
_ROUNDING = 1e-12
"""Of the sum of odometry's variances, so that the smallest stays positive."""
_EXACT = 1e-3
"""Least factor on the deviations of loops: made ones may be exact."""
_CHI2_HALF = 5.35
"""Median of chi square, six degrees of freedom."""
_LEAST = 1e-3
"""Of odometry's variance, that of what steps move."""


def oppose_loops(
    tree: OdometryTree, steps: Mapping[int, Edge], loops: Sequence[Edge], sigmas: float
) -> dict[int, Refusal]:
    """Refuse loops that measured steps speak against.

    Where clouds leave steps open, as along a corridor, they say nothing.

    Args:
        tree: odometry.
        steps: measurements of the way from its parent, by node of the tree.
        loops: between nodes of the tree that odometry connects.
        sigmas: by which they must speak against a loop, standard deviations.

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
    least = _ROUNDING * np.trace(before, axis1=1, axis2=2)
    root = np.linalg.cholesky(before + least[:, None, None] * np.eye(6))

    def in_units(covariances: Floats) -> Floats:
        return np.linalg.solve(root, np.linalg.solve(root, covariances).mT)

    left, own = in_units(after), in_units(np.array([edge.covariance for edge in loops]))
    error, other = (np.linalg.solve(root, each[..., None]) for each in (driven, corrected))
    taken, told = np.eye(6) - left, np.linalg.inv(np.eye(6) + own)
    moved, expected = error - other, taken @ told @ error
    # What steps move is known to what they leave, and to what is open of odometry's error: what the
    # loop does not know if it is right, else all of it.
    stepped = taken @ left + _LEAST * np.eye(6)
    if_right = stepped + taken @ (np.eye(6) - told) @ taken
    if_false = stepped + taken @ taken
    squares = [
        (each.mT @ np.linalg.solve(spread, each))[:, 0, 0]
        for each, spread in ((moved - expected, if_right), (moved, if_false))
    ]
    sharper = np.linalg.slogdet(if_false)[1] - np.linalg.slogdet(if_right)[1]
    # Steps that fit neither are worse than they state.
    inflation = np.maximum(np.minimum(*squares) / 6, 1)
    against = np.sqrt(np.maximum((squares[0] - squares[1]) / inflation - sharper, 0))
    return {
        edge.number: Refusal(
            "contradicts-steps",
            value,
            f"the steps that clouds measured on the way between speak against it by {value:.3g} "
            f"standard deviations, {sigmas:g} are to be expected",
        )
        for edge, value in zip(loops, against.tolist(), strict=True)
        if value > sigmas
    }


def agreeing_scale(tree: OdometryTree, loops: Sequence[Edge]) -> float:
    """Factor, up to 1, on odometry's deviations that all its loops allow.

    Within a factor of three stated deviations are believed. Of loops that are better than they
    state, too, it is the factor beside theirs, which the differences between the errors of one and
    the next tell, as odometry's are alike there. Between sparse loops they are not: then loops pass
    for as good as they state.

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
    order = np.lexsort(([edge.a for edge in loops], [edge.b for edge in loops]))
    apart = np.diff(errors[order], axis=0)
    own = 2 * np.array([edge.covariance for edge in loops])[order[1:]]
    noise = np.einsum("ni,ni->n", apart, np.linalg.solve(own, apart[..., None])[..., 0])
    of_loops = np.clip(np.sqrt(np.median(noise) / _CHI2_HALF), _EXACT, 1)
    scale = np.sqrt(_MARGIN * squares.max() / 6) / of_loops
    return float(np.clip(scale, _BEST, 1)) if scale < _BETTER else 1.0


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
