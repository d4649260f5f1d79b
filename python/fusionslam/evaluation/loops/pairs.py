# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Judge pairs of frames by their descriptor distance, in place of nearest candidates.

Source: Kong et al. 2020 (SG_PR), section IV, and Li et al. 2021 (SSC), section IV: all pairs of one
place, and a fixed number of pairs of different places for each of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation.loops.nearest_matches import (
    metres_between,
    validate_descriptors,
    validate_positions,
)
from fusionslam.evaluation.loops.precision_recall import RANKS, PrecisionRecall, sweep_thresholds
from fusionslam.evaluation.loops.protocols import (
    EvaluationConfig,
    Protocol,
    find_protocol,
    validate_config,
)

SEED = 0
"""Of the generator that draws pairs of different places."""


@checked
@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of frames, ascending by query: rows int64 (P,) each, and bool (P,) for one place."""

    queries: Integers
    matches: Integers
    same: Mask


@checked
def evaluate_pairs(
    descriptors: NDArray[np.float32],
    positions: ArrayLike,
    *,
    protocol: str = "ssc",
    radius: float | None = None,
    window: int | None = None,
    threads: int = 0,
    metric: str = "l2",
    seed: int = SEED,
) -> PrecisionRecall:
    """Judge pairs of frames: a threshold accepts those whose descriptors are at most that far.

    A frame with a descriptor of zeros, which describes nothing, is in no accepted pair.

    Args:
        descriptors: float32 (N, D), one row per frame, in order of time.
        positions: (N, 3), true positions in metres, in any fixed frame.
        protocol: one that judges pairs: "ssc".
        radius: positions closer than this (metres) are the same place; None for the protocol's.
        window: pairs of frames that are at most this far apart in time are left out.
        threads: number of threads of the comparison; 0 is one per core.
        metric: of the descriptors, as for ``precision_recall``.
        seed: of the generator that draws pairs of different places.

    Raises:
        ShapeError: descriptors or positions of the wrong shape, length or dtype.
        DataError: a value that is not finite, or no pair of one place (code "no-same-place") or of
            different places (code "no-other-place").
        ConfigError: unknown protocol or metric, a protocol that judges no pairs (code "no-pairs"),
            radius <= 0 or window < 0.
    """
    config = validate_config(protocol=protocol, radius=radius, window=window)
    rows = validate_descriptors(descriptors)
    places = validate_positions(positions, len(rows))
    pairs = sample_pairs(places, find_protocol(config.protocol), config, seed)
    distances = pair_distances(rows, pairs, metric=metric, threads=threads)
    count = int(pairs.same.sum())
    return PrecisionRecall(
        **sweep_thresholds(distances, pairs.same, pairs.same),
        **config.model_dump(),
        top1=None,
        recall_at_k=dict.fromkeys(RANKS),
        n_queries=len(distances),
        n_revisits=count,
        n_correct=count,
        queries=pairs.queries,
        matches=pairs.matches,
        distances=distances,
        correct=pairs.same,
        revisit=pairs.same,
    )


@checked
def sample_pairs(
    places: Floats, protocol: Protocol, config: EvaluationConfig, seed: int = SEED
) -> Pairs:
    """Return all pairs of one place, and those of different places that were drawn.

    Pairs of different places are drawn without repetition, all of them where there are too few.
    Raises DataError and ConfigError as ``evaluate_pairs``.
    """
    rule = protocol.pairs
    if rule is None:
        raise ConfigError(
            f"evaluation.protocol: {protocol.name} judges matches, expected one that judges pairs",
            code="no-pairs",
            fields=("evaluation.protocol", protocol.name),
        )
    near, far = [], []
    for query in range(len(places)):
        metres = metres_between(places[: max(query - config.window, 0)], places[query])
        near.append(np.flatnonzero(metres < config.radius))
        far.append(int(((metres >= config.radius) & (metres > rule.far)).sum()))
    wanted = rule.negatives * sum(map(len, near))
    _check_places(wanted, sum(far), config.radius, rule.far, config.window)
    drawn = np.random.default_rng(seed).choice(
        sum(far), size=min(wanted, sum(far)), replace=False, shuffle=False
    )
    drawn.sort()
    begins = np.concatenate([[0], np.cumsum(far)])
    bounds = np.searchsorted(drawn, begins)
    queries, matches, same = [], [], []
    for query, rows in enumerate(near):
        chosen = drawn[bounds[query] : bounds[query + 1]] - begins[query]
        others = np.empty(0, dtype=np.int64)
        if len(chosen):
            metres = metres_between(places[: query - config.window], places[query])
            others = np.flatnonzero((metres >= config.radius) & (metres > rule.far))[chosen]
        queries.append(np.full(len(rows) + len(others), query))
        matches += [rows, others]
        same += [np.ones(len(rows), dtype=np.bool_), np.zeros(len(others), dtype=np.bool_)]
    return Pairs(np.concatenate(queries), np.concatenate(matches), np.concatenate(same))


def pair_distances(
    descriptors: NDArray[np.float32], pairs: Pairs, *, metric: str = "l2", threads: int = 0
) -> Floats:
    """Return the distances of pairs, float64 (P,); infinity if a descriptor is of zeros."""
    from fusionslam._core import nearest

    distances, described = np.full(len(pairs.queries), np.inf), (descriptors != 0).any(axis=1)
    bounds = np.searchsorted(pairs.queries, np.arange(len(descriptors) + 1))
    for query in np.flatnonzero(np.diff(bounds).astype(bool) & described):
        part = np.arange(bounds[query], bounds[query + 1])
        part = part[described[pairs.matches[part]]]
        if not len(part):
            continue
        others = descriptors[pairs.matches[part]]
        # All of them are wanted: the later frame is the query, as in the search.
        (order,), (found,) = nearest(
            descriptors[query : query + 1], others, k=len(others), threads=threads, metric=metric
        )
        distances[part[order]] = found
    return distances


def _check_places(near: int, far: int, radius: float, least: float, window: int) -> None:
    """Raise DataError unless there are pairs of one place and of different places."""
    if not near:
        raise DataError(
            f"no two frames that are more than {window} frames apart are less than {radius:g} m "
            "apart: expected a drive that returns to a place",
            code="no-same-place",
            fields=(f"{radius:g}", str(window)),
        )
    if not far:
        raise DataError(
            f"no two frames that are more than {window} frames apart are more than {least:g} m "
            "apart: expected a drive past different places",
            code="no-other-place",
            fields=(f"{least:g}", str(window)),
        )
