# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Judge matches against true positions and sweep the threshold over all distances.

Source: Perdomo 2019, sections 3.2 and 4.1.2, as implemented in the author's program. The protocol
chooses the denominator of recall.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.evaluation.loops.nearest_matches import (
    Matches,
    check_causal,
    find_matches,
    validate_descriptors,
    validate_positions,
    validate_truth,
)
from fusionslam.evaluation.loops.precision_recall import PrecisionRecall
from fusionslam.evaluation.loops.protocols import (
    DEFAULTS,
    check_bound,
    find_protocol,
    validate_config,
)
from fusionslam.storage.arrays import Floats, Mask

RANKS = (1, 5, 10)
"""Values of k for recall@k."""


def precision_recall(
    descriptors: NDArray[np.float32],
    positions: ArrayLike,
    *,
    protocol: str = DEFAULTS.protocol,
    radius: float = DEFAULTS.radius,
    window: int = DEFAULTS.window,
    threads: int = 0,
    metric: str = "l2",
) -> PrecisionRecall:
    """Match every frame with its nearest earlier places and judge the matches.

    Args:
        descriptors: float32 (N, D), one row per frame, in order of time.
        positions: (N, 3), true positions in metres, in any fixed frame.
        protocol: "revisit" or "perdomo2019"; those by pose need matches with poses.
        radius: positions closer than this (metres) are the same place.
        window: number of frames before the query that are not candidates.
        threads: number of threads of the search; 0 is one per core.
        metric: "l2", or "scan_context" for descriptors of that kind.

    Raises:
        ShapeError: descriptors or positions of the wrong shape, length or dtype.
        DataError: a value that is not finite.
        ConfigError: unknown protocol or metric, a protocol by pose (code "needs-poses"), radius
            <= 0 or window < 0.
    """
    validate_config(protocol=protocol, radius=radius, window=window)
    check_bound(protocol, has_poses=False)
    descriptors = validate_descriptors(descriptors)
    places = validate_positions(positions, len(descriptors))
    matches = find_matches(descriptors, window=window, k=max(RANKS), threads=threads, metric=metric)
    return evaluate_matches(matches, places, protocol=protocol, radius=radius, window=window)


def evaluate_matches(
    matches: Matches,
    positions: ArrayLike,
    *,
    protocol: str = DEFAULTS.protocol,
    radius: float = DEFAULTS.radius,
    window: int = DEFAULTS.window,
    ranks: Sequence[int] = RANKS,
) -> PrecisionRecall:
    """Judge nearest candidates that are already known.

    Args:
        matches: the candidates of each frame; under a protocol by pose with ``match_from_query``.
        positions: (N, 3), true positions in metres; or (N, 4, 4), true world_from_body, which
            protocols by pose need. The body is that of ``match_from_query``.
        protocol, radius, window: as for precision_recall.
        ranks: values of k for recall@k.

    Raises:
        ShapeError: positions whose shape or length does not fit the matches.
        DataError: a position that is not finite, a pose that is no rotation and translation, or a
            match that the window excludes.
        ConfigError: unknown protocol, one by pose without poses of the matches or true ones (code
            "needs-poses"), radius <= 0 or window < 0.
    """
    config = validate_config(protocol=protocol, radius=radius, window=window)
    places, poses = validate_truth(positions, len(matches))
    check_causal(matches, config.window)
    rule = find_protocol(config.protocol)
    check_bound(rule.name, matches.match_from_query is not None and poses is not None)
    if rule.bound is None or poses is None:
        hits = _hits(matches.indices, places, config.radius)
    else:
        metres, degrees = pose_differences(matches, poses)
        hits = (metres <= rule.bound.metres) & (degrees <= rule.bound.degrees)
    revisit = _revisits(places, config.radius, config.window)
    distances = matches.distances[:, 0].astype(np.float64)
    relevant = rule.relevant(hits[:, 0], revisit)
    return PrecisionRecall(
        **_sweep_thresholds(distances, hits[:, 0], relevant),
        **_compute_ranks(hits, revisit, ranks),
        **config.model_dump(),
        n_queries=len(matches),
        n_revisits=int(revisit.sum()),
        n_correct=int(hits[:, 0].sum()),
        queries=np.arange(len(matches), dtype=np.int64),
        matches=matches.indices[:, 0].copy(),
        distances=distances,
        correct=hits[:, 0].copy(),
        revisit=revisit,
    )


def pose_differences(matches: Matches, poses: Floats) -> tuple[Floats, Floats]:
    """Metres and degrees, float64 (N, k), by which poses of matches differ from the true ones.

    NaN where a match has no pose. ``poses`` are float64 (N, 4, 4), true world_from_body.
    """
    assert matches.match_from_query is not None
    true = np.linalg.inv(poses[matches.indices]) @ poses[:, None]
    difference = matches.match_from_query - true
    # Two rotations the angle a apart differ by sqrt(8) sin(a / 2) in the norm of Frobenius.
    sines = np.linalg.norm(difference[..., :3, :3], axis=(-2, -1)) / np.sqrt(8)
    degrees = np.degrees(2 * np.arcsin(np.minimum(sines, 1)))
    return np.linalg.norm(difference[..., :3, 3], axis=-1), degrees


def metres_between(a: Floats, b: Floats) -> Floats:
    """Euclidean distances of positions (..., 3)."""
    return np.asarray(np.sqrt(((a - b) ** 2).sum(axis=-1)), dtype=np.float64)


def _hits(indices: NDArray[np.int64], places: Floats, radius: float) -> Mask:
    """Bool (N, k): candidates within the radius of their query."""
    near = metres_between(places[:, None], places[indices]) < radius
    return near & (indices >= 0)


def _revisits(places: Floats, radius: float, window: int) -> Mask:
    """Bool (N,): queries with any candidate within the radius."""
    found = np.zeros(len(places), dtype=np.bool_)
    for query in range(window + 1, len(places)):
        found[query] = (metres_between(places[: query - window], places[query]) < radius).any()
    return found


def _sweep_thresholds(distances: Floats, correct: Mask, relevant: Mask) -> dict[str, Any]:
    """Compute the curve over all distinct distances, and the figures read off it.

    A pose may be right where the places are farther apart than the radius: such a match is
    correct, but the recall of revisits does not count it.
    """
    denominator = int(relevant.sum())
    present = np.isfinite(distances)
    thresholds, row = np.unique(distances[present], return_inverse=True)
    accepted = np.cumsum(np.bincount(row, minlength=len(thresholds)))
    right, found = (
        np.cumsum(np.bincount(row[mask[present]], minlength=len(thresholds)))
        for mask in (correct, correct & relevant)
    )
    precision = right / accepted
    recall = found / denominator if denominator else np.full(len(found), np.nan)
    curve = {"thresholds": thresholds, "precision": precision, "recall": recall}
    return curve | (_figures(thresholds, precision, recall) if denominator else _UNDEFINED)


_UNDEFINED = dict.fromkeys(
    (
        "recall_at_full_precision",
        "threshold_at_full_precision",
        "max_f1",
        "max_f1_threshold",
        "average_precision",
    )
)


def _figures(thresholds: Floats, precision: Floats, recall: Floats) -> dict[str, Any]:
    """Read the figures off a curve; thresholds that do not exist are None."""
    f1 = _f1(precision, recall)
    best = float(f1.max(initial=0))
    # A false match stays accepted at all larger thresholds: rows without one are a prefix.
    flawless = int((precision == 1).sum())
    return {
        "recall_at_full_precision": float(recall[flawless - 1]) if flawless else 0.0,
        "threshold_at_full_precision": float(thresholds[flawless - 1]) if flawless else None,
        "max_f1": best,
        "max_f1_threshold": float(thresholds[np.argmax(f1)]) if best > 0 else None,
        "average_precision": float((np.diff(recall, prepend=0) * precision).sum()),
    }


def _f1(precision: Floats, recall: Floats) -> Floats:
    """2 P R / (P + R), 0 where both are 0."""
    total = precision + recall
    return 2 * precision * recall / np.where(total > 0, total, 1)


def _compute_ranks(hits: Mask, revisit: Mask, ranks: Sequence[int]) -> dict[str, Any]:
    """Compute the shares of revisits with a correct candidate among the k nearest."""
    shares = {k: _share(np.any(hits[:, :k], axis=1), revisit) for k in ranks}
    searched = hits.shape[1]
    known = {k: share if k <= searched else None for k, share in shares.items()}
    return {"top1": _share(hits[:, 0], revisit), "recall_at_k": known}


def _share(good: Mask, among: Mask) -> float | None:
    return float(good[among].mean()) if among.any() else None
