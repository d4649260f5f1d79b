# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What sources and runs are called, in which order they stand, and which one is the best."""

from collections.abc import Collection, Sequence

from fusionslam.evaluation import DescriptorRun, Evaluation

_PRESETS_OF = ("m2dp", "cm2dp")


def source_name(source: str, sources: Collection[str]) -> str:
    """What people call a source, given all sources that are shown."""
    if source == "cloud" and "lidar" in sources:
        return "LiDAR, full circle"
    names = {"lidar": "LiDAR-camera", "stereo": "Stereo", "cloud": "Clouds as they are"}
    return names.get(source, source)


def run_label(run: DescriptorRun) -> str:
    """The descriptor with its preset, where it has one."""
    preset = run.config.get("descriptors", {}).get("preset")
    return (
        f"{run.descriptor} {preset}"
        if preset and run.descriptor in _PRESETS_OF
        else (run.descriptor)
    )


def by_rank(evaluations: Sequence[Evaluation], protocol: str) -> dict[str, list[Evaluation]]:
    """The evaluations by the name of their source, the source with the largest F1 first."""
    groups: dict[str, list[Evaluation]] = {}
    for evaluation in evaluations:
        groups.setdefault(evaluation.run.source, []).append(evaluation)
    ranked = sorted(groups, key=lambda source: -score(best_of(groups[source], protocol), protocol))
    return {source_name(source, groups): groups[source] for source in ranked}


def best_of(evaluations: Sequence[Evaluation], protocol: str) -> Evaluation:
    """The evaluation of the largest F1; of equals, or of none judged, the first."""
    return max(evaluations, key=lambda evaluation: score(evaluation, protocol))


def score(evaluation: Evaluation, protocol: str) -> float:
    """The largest F1; -1 where there is none."""
    curve = evaluation.curves.get(protocol)
    return curve.max_f1 if curve and curve.max_f1 is not None else -1.0


def winner(evaluations: Sequence[Evaluation], protocol: str) -> str | None:
    """The best run in a sentence; None where there is nothing to compare."""
    best = best_of(evaluations, protocol)
    if len(evaluations) < 2 or score(best, protocol) <= 0:
        return None
    curve = best.curves[protocol]
    name = source_name(best.run.source, {evaluation.run.source for evaluation in evaluations})
    return (
        f"Best: {name}, {run_label(best.run)}: max F1 {curve.max_f1:.3f}, "
        f"recall {curve.recall_at_full_precision:.3f} at 100 % precision."
    )
