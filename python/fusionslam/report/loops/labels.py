# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Names of sources and runs, their order, and the best one."""

from collections.abc import Collection, Sequence

from fusionslam.evaluation import Evaluation, LoopRun, VerifiedRun
from fusionslam.report.page.html import group_by


def source_name(source: str, sources: Collection[str]) -> str:
    """Return the displayed name of a source, given all sources that are shown."""
    if source == "cloud" and "lidar" in sources:
        return "LiDAR, full circle"
    names = {"lidar": "LiDAR-camera", "stereo": "Stereo", "cloud": "Clouds as they are"}
    return names.get(source, source)


def run_label(run: LoopRun, *, short: bool = False) -> str:
    """Return the descriptor with its preset, if it has one; of verified loops their name.

    ``short`` leaves out which descriptors proposed candidates of verified loops.
    """
    if short and isinstance(run, VerifiedRun):
        return "verified"
    return f"{run.descriptor} {run.preset}" if run.preset else run.name


def short_labels(runs: Sequence[LoopRun]) -> list[str]:
    """Return the short label of each run; the long ones where two runs of a source share one."""
    labels = [run_label(run, short=True) for run in runs]
    if len({(run.source, label) for run, label in zip(runs, labels, strict=True)}) < len(runs):
        return [run_label(run) for run in runs]
    return labels


def run_file(run: LoopRun) -> str:
    """Return the part of a file's name that stands for a run: lidar_cm2dp_author."""
    return f"{run.source}_{run.name}".replace(":", "_").replace(" ", "_")


def by_rank(evaluations: Sequence[Evaluation], protocol: str) -> dict[str, list[Evaluation]]:
    """Group the evaluations by source name, the source with the largest F1 first."""
    groups = group_by(evaluations, lambda evaluation: evaluation.run.source)
    ranked = sorted(groups, key=lambda source: -score(best_of(groups[source], protocol), protocol))
    return {source_name(source, groups): groups[source] for source in ranked}


def best_of(evaluations: Sequence[Evaluation], protocol: str) -> Evaluation:
    """Return the evaluation with the largest F1; the first one on ties or without F1."""
    return max(evaluations, key=lambda evaluation: score(evaluation, protocol))


def score(evaluation: Evaluation, protocol: str) -> float:
    """Return the largest F1; -1 if undefined."""
    curve = evaluation.curves.get(protocol)
    return curve.max_f1 if curve and curve.max_f1 is not None else -1.0


def winner(evaluations: Sequence[Evaluation], protocol: str) -> str | None:
    """Name the best run in a sentence; None if there is nothing to compare."""
    best = best_of(evaluations, protocol)
    if len(evaluations) < 2 or score(best, protocol) <= 0:
        return None
    curve = best.curves[protocol]
    name = source_name(best.run.source, {evaluation.run.source for evaluation in evaluations})
    return (
        f"Best: {name}, {run_label(best.run, short=True)}: max F1 {curve.max_f1:.3f}, "
        f"recall {curve.recall_at_full_precision:.3f} at 100 % precision."
    )
