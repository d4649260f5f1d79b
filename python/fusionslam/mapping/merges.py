# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Edges between sessions: which of them agree with each other."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.geometry.se3 import adjoint, inverse, log
from fusionslam.mapping.edge import CHI2_99, Edge, reverse

FEWEST_MERGES = 3
"""Edges between two sessions that must agree with each other before these are joined."""

_MEASURED = ("pose", "covariance")
_MOST_COMPARED = 100  # edges between two sessions; spread over all of them

Drift = Callable[[int, int], Floats]
"""Covariance (6, 6) of odometry between two nodes of one session."""


class Joined(NamedTuple):
    """Sessions that were moved to each other.

    Attributes:
        poses: float64 (n, 4, 4), of all nodes.
        parts: int64 (n), the first node of each node's part.
        agreeing: for two sessions, by their first nodes: how many edges agree with each other.
    """

    poses: Floats
    parts: Integers
    agreeing: dict[tuple[int, int], int]


def join_sessions(poses: Floats, sessions: Integers, edges: Iterable[Edge], drift: Drift) -> Joined:
    """Move sessions to each other that ``FEWEST_MERGES`` edges connect that agree, or a person."""
    between = defaultdict(list)
    for edge in edges:
        between[session_pair(edge, sessions)].append(edge)
    groups = {
        pair: [each for each in some if each.is_by_hand]
        or _largest_group(some, poses, sessions, drift)
        for pair, some in between.items()
    }
    parts, poses = sessions.copy(), poses.copy()
    for group in sorted(groups.values(), key=len, reverse=True):
        edge = min(group, key=lambda each: float(np.trace(each.covariance)))
        first, other = parts[edge.a], parts[edge.b]
        is_enough = len(group) >= FEWEST_MERGES or edge.is_by_hand
        if not is_enough or first == other:
            continue
        move = poses[edge.a] @ edge.pose @ inverse(poses[edge.b])
        if other < first:
            first, other, move = other, first, inverse(move)
        poses[parts == other] = move @ poses[parts == other]
        parts[parts == other] = first
    return Joined(poses, parts, {pair: len(group) for pair, group in groups.items()})


def session_pair(edge: Edge, sessions: Integers) -> tuple[int, int]:
    """The sessions of an edge's nodes, the earlier one first."""
    ends = int(sessions[edge.a]), int(sessions[edge.b])
    return min(ends), max(ends)


def _largest_group(
    edges: Sequence[Edge], poses: Floats, sessions: Integers, drift: Drift
) -> list[Edge]:
    """The largest group of edges that agree with one another, found greedily from each of them."""
    spread = np.unique(np.linspace(0, len(edges) - 1, _MOST_COMPARED).astype(int))
    some = [edges[k] for k in spread]
    # As if they led from the earlier session to the later one.
    witnesses = [e if sessions[e.a] < sessions[e.b] else reverse(e) for e in some]
    agree = np.zeros((len(some), len(some)), np.bool_)
    for i, one in enumerate(witnesses):
        agree[i, :i] = agree[:i, i] = _agree(poses, one, witnesses[:i], drift)
    order = np.argsort(-agree.sum(axis=1), kind="stable").tolist()
    best: list[int] = []
    for first in order:
        group = [first]
        for i in order:
            if i != first and agree[i, group].all():
                group.append(i)
        best = max(best, group, key=len)
    return [some[i] for i in best]


def _agree(poses: Floats, one: Edge, others: Sequence[Edge], drift: Drift) -> Mask:
    """Bool (m): whether the way around an edge and each other one closes.

    That is pairwise consistency (Mangelson et al. 2018). Edges with a common node are no two
    witnesses.
    """
    if not others:
        return np.zeros(0, np.bool_)
    a, b = np.array([other.a for other in others]), np.array([other.b for other in others])
    pose, covariance = (np.array([getattr(o, name) for o in others]) for name in _MEASURED)
    back = inverse(poses[b]) @ poses[one.b]
    error = log(inverse(one.pose) @ inverse(poses[one.a]) @ poses[a] @ pose @ back)
    spread = one.covariance + np.array([drift(other, one.b) for other in b.tolist()])
    along = np.array([drift(one.a, other) for other in a.tolist()])
    for moved, added in ((back, covariance), (pose @ back, along)):
        carry = adjoint(inverse(moved))
        spread += carry @ added @ carry.transpose(0, 2, 1)
    square = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[..., None])[..., 0])
    return np.asarray((a != one.a) & (b != one.b) & (square <= CHI2_99))
