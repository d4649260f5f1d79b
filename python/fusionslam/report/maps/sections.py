# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sections of the report of maps on one drive, and on each run over it."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.errors import DataError
from fusionslam.evaluation import MapReport
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam.experience_map import quickest_route
from fusionslam.report.maps.aligned_run import Scene, find_denied, scene_of
from fusionslam.report.maps.map_figures import count_noun, draw_map, side_by_side
from fusionslam.report.maps.path_figure import draw_route
from fusionslam.report.maps.plots import draw_activity, draw_errors, draw_views
from fusionslam.report.maps.tables import (
    REFUSALS,
    error_table,
    joins_table,
    look_table,
    loop_table,
    new_views,
    refusals,
    refused_table,
)
from fusionslam.report.maps.times import cost_table, draw_step_times
from fusionslam.report.page.html import file_name, picture_name
from fusionslam.report.page.images import Picture, keep

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Judged = Sequence[tuple[RatSlamRun, MapReport]]
_NOTES = 50
MISSING = {
    "no-look": "There was no look, so there are no views, and nothing corrected the pose cells.",
    "no-view": "Nothing was recognised in any look, so there is no view.",
    "no-node": "The map has no node: odometry and a view are both needed to make the first.",
    "single-node": "The map is a single node: there is nothing to draw.",
    "no-loop": "No loop was closed: the map is dead reckoning, cut into nodes.",
    "no-truth": "The true poses are not known, so there are no errors to show.",
    "no-times": "No step was timed.",
}
"""Sentences that replace pictures without content, by code."""


def drive_part(folder: Path, id: str, name: str, judged: Judged) -> dict[str, Any]:
    """Draw everything known about the runs over one drive; ``id`` is unique on the page.

    Returns:
        A drive as ``maps.html.j2`` shows it. Pictures that would be empty are left out, and
        "words" say why.
    """
    runs, reports = [run for run, _ in judged], [report for _, report in judged]
    labels = run_labels(runs)
    scenes = [scene_of(run, report) for run, report in judged]
    remarks = (
        f"{label}: {why}"
        for label, report in zip(labels, reports, strict=True)
        for why in report.remarks
    )
    return {
        "name": name,
        "id": id,
        "answer": answer(labels, reports),
        "remarks": list(dict.fromkeys(remarks)),
        "errors": error_table(labels, reports),
        "joins": joins_table(labels, scenes),
        "maps": _draw_maps(folder, name, labels, scenes),
        "costs": cost_table(labels, runs),
        "runs": [_run_part(folder, label, one) for label, one in zip(labels, scenes, strict=True)],
    }


def run_file_name(run: RatSlamRun) -> str:
    """Return the name, without suffix, of the file that stores a run."""
    return file_name(run.name, run.views, run.odometry, run.preset)


def run_labels(runs: Sequence[RatSlamRun]) -> list[str]:
    """Label runs by place recognition, plus odometry and preset where they differ."""
    parts = [[run.views, f"odometry {run.odometry}", f"preset {run.preset}"] for run in runs]
    telling = [0] + [i for i in (1, 2) if len({part[i] for part in parts}) > 1]
    return [", ".join(part[i] for i in telling) for part in parts]


def answer(labels: Sequence[str], reports: Sequence[MapReport]) -> str:
    """Compare the best map with dead reckoning in a sentence."""
    known = [
        (one.trajectory.rmse_m, one.dead_reckoning.rmse_m, label)
        for label, one in zip(labels, reports, strict=True)
        if one.trajectory and one.dead_reckoning
    ]
    if not known:
        return "Without true poses the errors of a map are unknown: there are only counts."
    ours, alone, label = min(known, key=lambda figures: figures[0])
    name = f"{label} has the best map: it" if len(known) > 1 else "The map"
    first = f"{name} puts the robot {ours:.2f} m (RMSE) from where it was"
    if ours < alone:
        return f"{first}, dead reckoning {alone:.2f} m."
    return f"{first}, dead reckoning {alone:.2f} m: mapping did not help."


def _draw_maps(folder: Path, name: str, labels: list[str], scenes: list[Scene]) -> Picture | None:
    """Draw all maps at one scale; a single map has its own picture instead."""
    drawn = [pair for pair in zip(labels, scenes, strict=True) if len(pair[1].nodes) > 1]
    if len(drawn) < 2:
        return None
    figure = side_by_side([scene for _, scene in drawn], [label for label, _ in drawn])
    caption = (
        "The maps at one scale, each turned and shifted onto the truth as well as it can be, not "
        "stretched. Marks are the ends of loops."
    )
    return keep(folder, f"ratslam_maps_{picture_name(name)}", figure, caption)


def _run_part(folder: Path, label: str, scene: Scene) -> dict[str, Any]:
    run, left_out = scene.run, len(scene.run.notes) - _NOTES
    more = [f"{left_out} more notes are in the stored run."] if left_out > 0 else []
    return {
        "name": label,
        "sentence": summarise_run(scene),
        "words": [MISSING[code] for code in list_missing(scene)],
        "pictures": [*_draw_pictures(folder, scene)],
        "loops": loop_table(scene),
        "refused": refused_table(scene),
        "looks": look_table(run),
        "notes": [*run.notes[:_NOTES], *more],
    }


def summarise_run(scene: Scene) -> str:
    """Describe steps, views, nodes and loops of a run; steps as the report counts them."""
    run, report = scene.run, scene.report
    span = f"{report.seconds:.1f} s and {count_noun(report.steps, 'step')} from the first node on"
    views = count_noun(int(new_views(run.view_ids[run.is_view]).sum()), "view")
    made = f"{count_noun(len(run.nodes), 'node')} and {count_noun(len(run.links), 'link')}"
    loops = count_noun(int(scene.loops.sum()), "loop")
    judged = report.false_loops is not None and scene.loops.any()
    verdict = f", {int(scene.false.sum())} of them false" if judged else ""
    refused = f"{count_noun(len(run.refused), 'loop')} refused"
    became = Counter(refusals(scene))
    told = [f"{became[kind]} {kind}" for kind in REFUSALS if became[kind]]
    refused += f" ({', '.join(told)})" if told else ""
    return (
        f"{span}, {count_noun(report.looks, 'look')}; {views}, {made}; "
        f"{loops} closed{verdict}; {refused}."
    )


def list_missing(scene: Scene) -> list[str]:
    """Return the codes, keys of ``MISSING``, of what a run lacks for its pictures."""
    run = scene.run
    found = []
    if not (run.view_ids >= 0).any():
        found.append("no-view" if run.is_view.any() else "no-look")
    if len(run.nodes) < 2:
        found.append("single-node" if len(run.nodes) else "no-node")
    elif not scene.loops.any():
        found.append("no-loop")
    if run.truth is None:
        found.append("no-truth")
    if not (run.step_seconds > 0).any():
        found.append("no-times")
    return found


def _draw_pictures(folder: Path, scene: Scene) -> list[Picture]:
    """Draw all pictures of a run that have content."""
    run = scene.run
    drawn: dict[str, tuple[Figure | None, str]] = {
        "map": (draw_map(scene) if len(run.nodes) > 1 else None, _describe_map(scene)),
        "errors": (draw_errors(scene), _ERRORS),
        "views": (draw_views(scene), _VIEWS),
        "cells": (draw_activity(run), _CELLS),
        "way": (_draw_way_home(scene), _WAY),
        "times": (draw_step_times(run), _TIMES),
    }
    name = picture_name(run.name, run.views, run.odometry, run.preset)
    kept = [keep(folder, f"ratslam_{kind}_{name}", *shown) for kind, shown in drawn.items()]
    return [picture for picture in kept if picture is not None]


def _draw_way_home(scene: Scene) -> "Figure | None":
    """Draw the path from the robot's final node back to its first; None if there is none."""
    run = scene.run
    if len(run.nodes) < 2 or run.node_ids[-1] <= 0:
        return None
    try:
        route = quickest_route(run.links, len(run.nodes), int(run.node_ids[-1]), 0)
    except DataError:
        # A stored map may consist of disconnected parts.
        return None
    return draw_route(scene, route)


def _describe_map(scene: Scene) -> str:
    """Describe only what the picture shows."""
    known = scene.truth is not None
    marks = (
        (scene.right.any(), "rings, closed rightly" if known else "rings, closed"),
        (scene.false.any(), "crosses, closed while the robot was elsewhere"),
        (
            find_denied(scene.run).any(),
            "triangles and broken lines, refused as they do not fit the odometry",
        ),
    )
    told = "; ".join(words for there, words in marks if there)
    laid = "Map and dead reckoning are each turned and shifted onto the truth, not stretched. "
    loops = f" Marks are the ends of loops: {told}." if told else ""
    return f"{laid if known else ''}Dots are nodes, lines links.{loops}"


_ERRORS = (
    "Distance of each step from the truth. Each line is turned and shifted onto the truth by "
    "itself, so it need not start at 0. The map at the time is the one that the robot could use; "
    "in the end, its past is corrected too."
)
_VIEWS = (
    "Above: the view of each look by its number; a lap that repeats shows as the same line again. "
    "Below, a stroke for each event: the robot makes a node, arrives at a known one, and where "
    "there was no link yet, closes a loop."
)
_CELLS = (
    "Activity of the pose cells, summed over the other two axes; the colours are stretched for "
    "small values. White: the decoded pose. All axes wrap around; a jump is a recognised view that "
    "moved the packet."
)
_WAY = (
    "The quickest way along links, by the time they took, from the last node back to the first. "
    "fusionslam.report.path_figure draws the way between any two nodes."
)
_TIMES = (
    "Milliseconds a step, on a logarithmic scale. Right: only steps that change the map, by how "
    "many nodes it had."
)
