# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The files beside the report: the figures of metrics.json, and matches.csv."""

import csv
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fusionslam.evaluation import CITATION, Evaluation, summarise_costs
from fusionslam.report.loops.outcomes import MATCH_COLUMNS, match_rows
from fusionslam.storage.files import atomic_path


def metrics_of(evaluation: Evaluation) -> dict[str, Any]:
    """Collect all figures of one run, ready for JSON; each protocol gives its radius and window."""
    run = evaluation.run
    return {
        "dataset": run.dataset,
        "source": run.source,
        "descriptor": run.descriptor,
        "frames": len(run),
        "protocols": {name: curve.metrics() for name, curve in evaluation.curves.items()},
        "top1_by_direction": evaluation.top1_by_direction,
        "published": evaluation.published and {**evaluation.published, "citation": CITATION},
        "costs": asdict(summarise_costs(run)),
        "config": run.config,
    }


def write_matches(path: Path, evaluations: Sequence[Evaluation], protocol: str) -> None:
    """Write one line per matched query; "accepted" is at the threshold of maximal F1."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(MATCH_COLUMNS)
        for evaluation in evaluations:
            writer.writerows(match_rows(evaluation, protocol))
