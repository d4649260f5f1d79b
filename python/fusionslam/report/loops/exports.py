# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The files beside the report: the figures of metrics.json, and matches.csv."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.evaluation import CITATION, Evaluation, VerifiedRun
from fusionslam.evaluation.loops.judge import pose_differences
from fusionslam.evaluation.loops.nearest_matches import metres_between
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
    "probability",
    "overlap",
    "pose_error_m",
    "pose_error_deg",
)


def metrics_of(evaluation: Evaluation) -> dict[str, Any]:
    """Collect all figures of one run, ready for JSON; each protocol gives its radius and window."""
    run = evaluation.run
    return {
        "dataset": run.dataset,
        "source": run.source,
        "descriptor": run.descriptor,
        "preset": run.preset,
        "verified": isinstance(run, VerifiedRun),
        "frames": len(run),
        "protocols": {name: curve.metrics() for name, curve in evaluation.curves.items()},
        "by_direction": {
            protocol: {kind: asdict(figures) for kind, figures in found.items()}
            for protocol, found in evaluation.by_direction.items()
        },
        "accepted": {name: asdict(found) for name, found in evaluation.accepted.items()},
        "published": evaluation.published and {**evaluation.published, "citation": CITATION},
        "peers": [asdict(peer) for peer in evaluation.peers],
        "costs": asdict(evaluation.costs),
        "config": run.config,
    }


def list_matches(evaluation: Evaluation, protocol: str) -> Iterator[tuple[object, ...]]:
    """Yield one row per query that has a candidate, as MATCH_COLUMNS; frames by number.

    "accepted" is at the threshold of maximal F1; of verified loops it is what the detector
    accepted, and they alone have a probability, an overlap and errors of their poses; one that only
    another descriptor found has no distance. Without ground truth all judgements are empty but what
    a detector accepted.
    """
    run, nearest = evaluation.run, nearest_of(evaluation, protocol)
    if nearest is None:
        return
    curve = evaluation.query_curves.get(protocol)
    matches, distances = nearest
    accepted, about_poses = None, None
    if isinstance(run, VerifiedRun):
        distances, accepted, about_poses = run.distance, run.accepted, _about_poses(run)
    elif curve is not None:
        accepted = judge_queries(run, curve).accepted
    for query in np.flatnonzero(matches >= 0):
        match = matches[query]
        judged: tuple[object, ...] = ("", "")
        if curve is not None and run.positions is not None:
            metres = float(metres_between(run.positions[query], run.positions[match]))
            judged = (int(curve.correct[query]), f"{metres:.3f}")
        yield (
            run.source,
            run.name,
            run.numbers[query],
            run.numbers[match],
            f"{distances[query]:.9g}" if np.isfinite(distances[query]) else "",
            "" if accepted is None else int(accepted[query]),
            *judged,
            run.stamps_ns[query],
            run.stamps_ns[match],
            *(("",) * 4 if about_poses is None else about_poses[query]),
        )


def _about_poses(run: VerifiedRun) -> list[tuple[str, ...]]:
    """The last four columns of each query; a value that is not known is empty."""
    matches = run.matches
    errors: tuple[Floats, ...] = (np.full((len(run), 1), np.nan),) * 2
    if run.poses is not None and matches.match_from_query is not None:
        errors = pose_differences(matches, run.poses)
    columns = (run.probability, run.overlap, *(each[:, 0] for each in errors))
    return [
        tuple("" if np.isnan(value) else f"{value:.4g}" for value in row)
        for row in zip(*columns, strict=True)
    ]
