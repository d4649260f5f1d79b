# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The files beside the report: the figures of metrics.json, and matches.csv."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from fusionslam.evaluation import CITATION, Evaluation
from fusionslam.evaluation.loops.judge import metres_between
from fusionslam.report.loops.outcomes import judge_queries, nearest_of

MATCH_COLUMNS = (
    "source",
    "descriptor",
    "query",
    "match",
    "distance",
    "accepted",
    "correct",
    "metres",
    "query_stamp_ns",
    "match_stamp_ns",
)


def metrics_of(evaluation: Evaluation) -> dict[str, Any]:
    """Collect all figures of one run, ready for JSON; each protocol gives its radius and window."""
    run = evaluation.run
    return {
        "dataset": run.dataset,
        "source": run.source,
        "descriptor": run.descriptor,
        "preset": run.preset,
        "frames": len(run),
        "protocols": {name: curve.metrics() for name, curve in evaluation.curves.items()},
        "top1_by_direction": evaluation.top1_by_direction,
        "published": evaluation.published and {**evaluation.published, "citation": CITATION},
        "costs": asdict(evaluation.costs),
        "config": run.config,
    }


def list_matches(evaluation: Evaluation, protocol: str) -> Iterator[tuple[object, ...]]:
    """Yield one row per query that has a candidate, as MATCH_COLUMNS; frames by number.

    "accepted" is at the threshold of maximal F1. Without ground truth the judgements (accepted,
    correct, metres) are empty.
    """
    run, nearest = evaluation.run, nearest_of(evaluation, protocol)
    if nearest is None:
        return
    curve = evaluation.curves.get(protocol)
    accepted = judge_queries(curve).accepted if curve else None
    for query in np.flatnonzero(nearest[0] >= 0):
        match = nearest[0][query]
        judged: tuple[object, ...] = ("", "", "")
        if curve is not None and accepted is not None and run.positions is not None:
            metres = float(metres_between(run.positions[query], run.positions[match]))
            judged = (int(accepted[query]), int(curve.correct[query]), f"{metres:.3f}")
        yield (
            run.source,
            run.name,
            run.numbers[query],
            run.numbers[match],
            f"{nearest[1][query]:.9g}",
            *judged,
            run.stamps_ns[query],
            run.stamps_ns[match],
        )
