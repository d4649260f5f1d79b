# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Outcome of each query at one threshold: the data of the pictures and matches.csv."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Mask
from fusionslam.evaluation import DescriptorRun, Evaluation, LoopRun, PrecisionRecall, VerifiedRun
from fusionslam.evaluation.loops.nearest_matches import metres_between, pairwise_distances

_OPPOSITE_DEG = 135.0
_MOST_WRONG = 3


@dataclass(frozen=True)
class Pair:
    """Two frames of a run that are, or should have been, matched as the same place.

    Attributes:
        kind: "best", "worst" or "missed".
        query, match: rows of the run.
        distance: descriptor distance; of verified loops 1 - probability, NaN of "missed".
        metres: distance of the true positions.
    """

    kind: str
    query: int
    match: int
    distance: float
    metres: float


@dataclass(frozen=True, eq=False)
class Outcome:
    """Loops at one threshold: bool (N,) each, one entry per query."""

    accepted: Mask
    true: Mask
    false: Mask
    missed: Mask


def judge_queries(run: LoopRun, curve: PrecisionRecall) -> Outcome:
    """Find which loops are accepted and right, and which revisits are missed.

    Those of descriptors are accepted by the threshold of maximal F1, verified ones by the detector.
    """
    if isinstance(run, VerifiedRun):
        accepted = run.accepted
    else:
        accepted = curve.accepted(curve.max_f1_threshold)
    return Outcome(
        accepted=accepted,
        true=accepted & curve.correct,
        false=accepted & ~curve.correct,
        missed=curve.revisit & ~accepted,
    )


def nearest_of(
    evaluation: Evaluation, protocol: str
) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Nearest candidates and their distances, (N,) each; None without a search."""
    curve = evaluation.query_curves.get(protocol)
    if curve is not None:
        return curve.matches, curve.distances
    if evaluation.matches is None:
        return None
    found = evaluation.matches
    return found.indices[:, 0], found.distances[:, 0].astype(np.float64)


def telling_pairs(run: LoopRun, curve: PrecisionRecall) -> list[Pair]:
    """Select the closest correct match, the closest false one, and the nearest miss.

    The miss is the rejected revisit whose nearest candidate came closest to the threshold; it is
    shown with the earlier place it should have found, the nearest one in metres.
    """
    matched = curve.matches >= 0
    chosen = (
        ("best", matched & curve.correct),
        ("worst", matched & ~curve.correct),
        ("missed", judge_queries(run, curve).missed & matched),
    )
    return [
        _pair(run, curve, kind, int(np.argmin(np.where(mask, curve.distances, np.inf))))
        for kind, mask in chosen
        if mask.any()
    ]


def telling_loops(run: VerifiedRun, curve: PrecisionRecall | None) -> dict[int, str]:
    """Select accepted loops to be shown: row of the query -> kind, each loop once.

    Kinds are "probable" and "improbable", the most and the least probable loop, "opposite", the
    most probable one in the opposite direction, and, where ``curve`` judges them, up to three
    that are "wrong".
    """
    accepted = np.flatnonzero(run.accepted)
    if not len(accepted):
        return {}
    ranked = accepted[np.argsort(-run.probability[accepted], kind="stable")].tolist()
    turned = np.degrees(Rotation.from_matrix(run.match_from_query[ranked, :3, :3]).magnitude())
    opposite = [row for row, angle in zip(ranked, turned, strict=True) if angle > _OPPOSITE_DEG]
    wrong = [] if curve is None else [row for row in ranked if not curve.correct[row]]
    chosen = [(row, "wrong") for row in wrong[:_MOST_WRONG]]
    chosen += [(ranked[0], "probable"), (ranked[-1], "improbable")]
    chosen += [(row, "opposite") for row in opposite if row not in dict(chosen)][:1]
    kinds: dict[int, str] = {}
    for row, kind in chosen:
        kinds.setdefault(row, kind)
    return kinds


def _pair(run: LoopRun, curve: PrecisionRecall, kind: str, query: int) -> Pair:
    places = run.positions
    assert places is not None, "a curve exists only where positions do"
    match, distance = int(curve.matches[query]), float(curve.distances[query])
    if kind == "missed":
        distance = float("nan")
        match = int(np.argmin(metres_between(places[: query - curve.window], places[query])))
    if isinstance(run, DescriptorRun):
        rows = run.descriptors[[query, match]]
        distance = float(pairwise_distances(rows, run.metric)[0, 1])
    return Pair(
        kind=kind,
        query=query,
        match=match,
        distance=distance,
        metres=float(metres_between(places[query], places[match])),
    )
