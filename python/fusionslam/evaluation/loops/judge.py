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

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Mask
from fusionslam.evaluation.loops.nearest_matches import (
    Matches,
    check_causal,
    find_matches,
    metres_between,
    validate_descriptors,
    validate_positions,
    validate_truth,
)
from fusionslam.evaluation.loops.pairs import evaluate_pairs
from fusionslam.evaluation.loops.precision_recall import RANKS, PrecisionRecall, sweep_thresholds
from fusionslam.evaluation.loops.protocols import (
    DEFAULTS,
    check_bound,
    check_matches,
    find_protocol,
    validate_config,
)


@checked
def precision_recall(
    descriptors: NDArray[np.float32],
    positions: ArrayLike,
    *,
    protocol: str = DEFAULTS.protocol,
    radius: float | None = None,
    window: int | None = None,
    threads: int = 0,
    metric: str = "l2",
) -> PrecisionRecall:
    """Match every frame with its nearest earlier places and judge the matches.

    Args:
        descriptors: float32 (N, D), one row per frame, in order of time.
        positions: (N, 3), true positions in metres, in any fixed frame.
        protocol: name of one that judges places or pairs; those by pose need matches with poses.
        radius: positions closer than this (metres) are the same place; None for the protocol's.
        window: number of frames before the query that are not candidates; None for the protocol's.
        threads: number of threads of the search; 0 is one per core.
        metric: how descriptors are compared, one of ``fusionslam.metric_names()``.

    Raises:
        ShapeError: descriptors or positions of the wrong shape, length or dtype.
        DataError: a value that is not finite; of a protocol that judges pairs, also as
            ``evaluate_pairs``.
        ConfigError: unknown protocol or metric, a protocol by pose (code "needs-poses"), radius
            <= 0 or window < 0.
    """
    config = validate_config(protocol=protocol, radius=radius, window=window)
    check_bound(protocol, has_poses=False)
    values: dict[str, Any] = {**config.model_dump(), "threads": threads, "metric": metric}
    if find_protocol(protocol).pairs is not None:
        return evaluate_pairs(descriptors, positions, **values)
    rows = validate_descriptors(descriptors)
    places = validate_positions(positions, len(rows))
    matches = find_matches(rows, window=config.window, k=max(RANKS), threads=threads, metric=metric)
    return evaluate_matches(matches, places, **config.model_dump())


@checked
def evaluate_matches(
    matches: Matches,
    positions: ArrayLike,
    *,
    protocol: str = DEFAULTS.protocol,
    radius: float | None = None,
    window: int | None = None,
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
            "needs-poses"), one that judges pairs (code "needs-descriptors"), radius <= 0 or window
            < 0.
    """
    config = validate_config(protocol=protocol, radius=radius, window=window)
    check_matches(config.protocol)
    places, poses = validate_truth(positions, len(matches))
    check_causal(matches, config.window)
    rule = find_protocol(config.protocol)
    check_bound(rule.name, matches.match_from_query is not None and poses is not None)
    if rule.bound is None or poses is None:
        near = metres_between(places[:, None], places[matches.indices]) < config.radius
        hits = near & (matches.indices >= 0)
    else:
        metres, degrees = pose_differences(matches, poses)
        hits = (metres <= rule.bound.metres) & (degrees <= rule.bound.degrees)
    revisit = np.zeros(len(places), dtype=np.bool_)
    for query in range(config.window + 1, len(places)):
        apart = metres_between(places[: query - config.window], places[query])
        revisit[query] = (apart < config.radius).any()
    distances = matches.distances[:, 0].astype(np.float64)
    relevant = rule.relevant(hits[:, 0], revisit)
    return PrecisionRecall(
        **sweep_thresholds(distances, hits[:, 0], relevant),
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


def _compute_ranks(hits: Mask, revisit: Mask, ranks: Sequence[int]) -> dict[str, Any]:
    """Compute the shares of revisits with a correct candidate among the k nearest."""
    shares = {k: _share(np.any(hits[:, :k], axis=1), revisit) for k in ranks}
    searched = hits.shape[1]
    known = {k: share if k <= searched else None for k, share in shares.items()}
    return {"top1": _share(hits[:, 0], revisit), "recall_at_k": known}


def _share(good: Mask, among: Mask) -> float | None:
    return float(good[among].mean()) if among.any() else None
