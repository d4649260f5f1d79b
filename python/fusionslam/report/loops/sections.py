# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sections of the report on one source: its curves, and each descriptor's loops."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.evaluation import DescriptorRun, Evaluation, LoopRun, PrecisionRecall, VerifiedRun
from fusionslam.help_texts import counted
from fusionslam.report.loops.frame_pairs import (
    CloudReader,
    ImageReader,
    ScanReader,
    draw_overlay,
    draw_pair,
)
from fusionslam.report.loops.labels import best_of, run_file, run_label, short_labels
from fusionslam.report.loops.outcomes import nearest_of, telling_loops, telling_pairs
from fusionslam.report.loops.plots import draw_curves, draw_distances, draw_trajectory
from fusionslam.report.loops.tables import reasons_table, time_table
from fusionslam.report.page.images import Picture, keep

_PAIR_TEXTS = {
    "best": "Closest correct match",
    "worst": "Closest false match",
    "missed": "Missed revisit, with the earlier place it should have found",
}
_LOOP_TEXTS = {
    "probable": "Most probable loop",
    "improbable": "Least probable loop",
    "opposite": "Loop in the opposite direction",
    "wrong": "Wrong loop",
}


@dataclass(frozen=True)
class Context:
    """Folder of the pictures, protocol that judges the loops, and readers of frames."""

    folder: Path
    protocol: str
    clouds: CloudReader
    images: ImageReader
    scans: ScanReader


def source_part(context: Context, name: str, evaluations: Sequence[Evaluation]) -> dict[str, Any]:
    """Draw everything known about the evaluations of the source called ``name``.

    Returns:
        A source as ``loops.html.j2`` shows it; pictures that would be empty are None.
    """
    source = evaluations[0].run.source
    best = best_of(evaluations, context.protocol)
    return {
        "source": source,
        "name": name,
        "curves": _draw_curves(context, source, evaluations),
        "times": time_table(evaluations),
        "descriptors": [_descriptor_part(context, e, best=e is best) for e in evaluations],
    }


def _draw_curves(
    context: Context, source: str, evaluations: Sequence[Evaluation]
) -> Picture | None:
    labels = short_labels([e.run for e in evaluations])
    curves = {n: e.curves.get(context.protocol) for n, e in zip(labels, evaluations, strict=True)}
    defined = {name: c for name, c in curves.items() if c and c.average_precision is not None}
    if not defined:
        return None
    caption = (
        "Precision over recall as the threshold grows from left to right; up and right is better. "
        "Square: recall at 100 % precision. Dot: maximal F1. Grey: lines of equal F1."
    )
    return keep(context.folder, f"pr_{source}", draw_curves(defined), caption, vector=True)


def _descriptor_part(context: Context, evaluation: Evaluation, *, best: bool) -> dict[str, Any]:
    run, curve = evaluation.run, evaluation.query_curves.get(context.protocol)
    # Without revisits neither picture has anything to show.
    empty = curve is not None and not curve.n_revisits
    return {
        "name": run_label(run),
        "best": best,
        "loops": _describe_loops(evaluation, curve, context.protocol),
        "trajectory": _draw_trajectory(context, evaluation, curve) if curve and not empty else None,
        "distances": None if empty else _draw_distances(context, run, evaluation.window, curve),
        "empty": empty,
        "pairs": _draw_pairs(context, evaluation, curve) if curve else [],
        "overlays": _draw_overlays(context, run, curve),
        "reasons": reasons_table(run) if isinstance(run, VerifiedRun) else None,
    }


def _describe_loops(evaluation: Evaluation, curve: PrecisionRecall | None, protocol: str) -> str:
    if curve is not None:
        found = evaluation.accepted.get(protocol)
        if found is not None:
            return (
                f"{counted(curve.n_queries, 'query')}, {curve.n_revisits} of them revisits: "
                f"{counted(found.loops, 'loop')} accepted, {found.wrong} of them wrong."
            )
        revisits = f"{curve.n_revisits} of them revisits" if curve.n_revisits else "no revisit"
        return f"{curve.explain(curve.max_f1_threshold)} ({revisits})."
    nearest = nearest_of(evaluation, protocol)
    if nearest is None:
        return "No ground truth and no search: there are no loops to show."
    listed = int((nearest[0] >= 0).sum())
    pairs = evaluation.curves.get(protocol)
    if pairs is not None:
        return (
            f"{pairs.counts}: these are judged. matches.csv lists the nearest candidates of "
            f"{listed} frames, unjudged."
        )
    if isinstance(evaluation.run, VerifiedRun):
        loops = counted(int(evaluation.run.accepted.sum()), "loop")
        return f"No ground truth: {loops} accepted, unjudged; matches.csv lists {listed} matches."
    return (
        f"No ground truth: matches.csv lists the nearest candidates of {listed} frames, unjudged."
    )


def _draw_trajectory(
    context: Context, evaluation: Evaluation, curve: PrecisionRecall
) -> Picture | None:
    run, threshold = evaluation.run, curve.max_f1_threshold
    at = "No threshold accepts a correct match"
    if isinstance(run, VerifiedRun):
        at = "Loops that the detector accepted"
    elif threshold is not None:
        at = f"Loops at the threshold of maximal F1, {threshold:.4g}"
    caption = (
        f"{at}. Green: correct. Red: false; its line leads to the place it was taken for. "
        "Orange: revisits that were missed. Grey: the path."
    )
    name = f"trajectory_{run_file(run)}"
    return keep(context.folder, name, draw_trajectory(run, curve), caption)


def _draw_distances(
    context: Context, run: LoopRun, window: int, curve: PrecisionRecall | None
) -> Picture | None:
    if not isinstance(run, DescriptorRun):
        return None
    figure = draw_distances(run, window, curve.radius if curve else None)
    caption = (
        "Each row is a query, each column an earlier frame. Dark: the descriptors are alike; "
        f"revisits show as dark lines. Grey band: the {window} frames that are no candidates."
    )
    if curve:
        caption += " Right: the true distances; red places should be dark on the left."
    return keep(context.folder, f"distances_{run_file(run)}", figure, caption)


def _draw_overlays(context: Context, run: LoopRun, curve: PrecisionRecall | None) -> list[Picture]:
    pictures: list[Picture] = []
    if not isinstance(run, VerifiedRun):
        return pictures
    for query, kind in telling_loops(run, curve).items():
        figure = draw_overlay(run, query, context.scans)
        apart = np.linalg.norm(run.match_from_query[query, :3, 3])
        caption = (
            f"{_LOOP_TEXTS[kind]}: frames {run.numbers[query]} and "
            f"{run.numbers[run.match[query]]}, overlap {run.overlap[query]:.2f}, probability "
            f"{run.probability[query]:.4g}, {apart:.1f} m apart. Points above the ground, from "
            "above: left as if both frames had been recorded at one place, right with the loop's "
            "pose."
        )
        name = f"registered_{run_file(run)}_{run.numbers[query]}"
        if picture := keep(context.folder, name, figure, caption, photo=True):
            pictures.append(picture)
    return pictures


def _draw_pairs(context: Context, evaluation: Evaluation, curve: PrecisionRecall) -> list[Picture]:
    run, pictures = evaluation.run, []
    for pair in telling_pairs(run, curve):
        figure = draw_pair(run, pair, context.clouds, context.images)
        how_alike = f"descriptors {pair.distance:.4g} apart, "
        if isinstance(run, VerifiedRun):
            known = np.isfinite(pair.distance)
            how_alike = f"probability {1 - pair.distance:.4g}, " if known else ""
        caption = (
            f"{_PAIR_TEXTS[pair.kind]}: {how_alike}places {pair.metres:.1f} m apart. Clouds from "
            "above, both at one scale."
        )
        name = f"pairs_{run_file(run)}_{pair.kind}"
        if picture := keep(context.folder, name, figure, caption, photo=True):
            pictures.append(picture)
    return pictures
