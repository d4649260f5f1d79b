# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the report of maps: the page, its pictures, the figures, and the runs."""

import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.base.argument_types import checked
from fusionslam.base.texts import counted
from fusionslam.errors import DataError
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam.experience_map import quickest_route
from fusionslam.report.maps.aligned_run import Scene, find_denied, new_views, scene_of
from fusionslam.report.maps.map_figures import draw_map, draw_route, side_by_side
from fusionslam.report.maps.plots import draw_activity, draw_errors, draw_step_times, draw_views
from fusionslam.report.maps.tables import (
    MOST,
    REFUSALS,
    config_table,
    cost_table,
    error_table,
    joins_table,
    look_table,
    loop_table,
    refusals,
    refused_table,
)
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import (
    about_report,
    check_extra,
    check_runs,
    file_name,
    group_by,
    picture_name,
    write_figures,
    write_page,
)
from fusionslam.report.page.images import Picture, keep

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RUNS = "ratslam"
"""Folder of the stored runs, beside the page."""
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

Judged = Sequence[tuple[RatSlamRun, MapReport]]


@checked
def write_ratslam_report(
    folder: str | os.PathLike[str],
    runs: RatSlamRun | Sequence[RatSlamRun],
    reports: MapReport | Sequence[MapReport] | None = None,
    *,
    title: str | None = None,
    command: str = "",
    notes: Sequence[str] = (),
) -> Path:
    """Write ratslam.html, which opens offline, its pictures and figures, and the runs.

    Args:
        folder: created if missing. Files of an earlier report there are replaced; its runs under
            other names are kept.
        runs: runs over the same drive share a ``name`` and are compared.
        reports: reports on the runs; None computes them.
        title: None derives one.
        command: the command line that produced the runs.
        notes: sentences at the top of the page.

    Returns:
        The path of ratslam.html.

    Raises:
        DataError: no runs, a run without steps, two with one name, not one report per run, values
            that cannot be judged, or the folder cannot be written.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    check_extra()
    runs = [runs] if isinstance(runs, RatSlamRun) else list(runs)
    labels = [" / ".join((run.name, run.views, run.odometry, run.preset)) for run in runs]
    files = [file_name(run.name, run.views, run.odometry, run.preset) for run in runs]
    check_runs(runs, labels, files)
    given = [reports] if isinstance(reports, MapReport) else reports
    reports = [judge_map(run) for run in runs] if given is None else list(given)
    if len(reports) != len(runs):
        problem = f"report: {len(reports)} reports of {len(runs)} runs, expected one of each"
        raise DataError(problem, code="counts-differ")
    target = Path(folder)
    for run, file in zip(runs, files, strict=True):
        run.save(target / RUNS / f"{file}.npz")
    judged = zip(runs, reports, strict=True)
    groups = group_by(judged, lambda pair: pair[0].name)
    with use_style():
        drives = [_drive_part(target, name, group) for name, group in groups.items()]
    config = {label: dict(run.config) for label, run in zip(labels, runs, strict=True)}
    config = {label: values for label, values in config.items() if values}
    about = about_report(", ".join(groups), command, config)
    about |= {"title": title, "notes": list(notes)}
    write_figures(target / "ratslam.json", about, [report.metrics() for report in reports])
    return write_page(
        target / "ratslam.html",
        "maps.html.j2",
        about,
        title=title or f"Maps of {about['dataset']}",
        notes=notes,
        drives=drives,
        runs=len(runs),
        rule=reports[0].rule,
        most=MOST,
        config=config_table(labels, runs),
    )


def _drive_part(folder: Path, name: str, judged: Judged) -> dict[str, Any]:
    """Draw everything known about the runs over one drive, as ``maps.html.j2`` shows it.

    Pictures that would be empty are left out, and "words" say why.
    """
    runs, reports = [run for run, _ in judged], [report for _, report in judged]
    labels = run_labels(runs)
    scenes = [scene_of(run, report) for run, report in judged]
    named = list(zip(labels, scenes, strict=True))
    remarks = (f"{label}: {why}" for label, scene in named for why in scene.report.remarks)
    # A single map has its own picture.
    maps = [(label, scene) for label, scene in named if len(scene.nodes) > 1]
    beside = len(maps) > 1 and side_by_side([scene for _, scene in maps], [one for one, _ in maps])
    return {
        "name": name,
        "answer": answer(labels, reports),
        "remarks": list(dict.fromkeys(remarks)),
        "errors": error_table(labels, reports),
        "joins": joins_table(labels, scenes),
        "maps": keep(folder, f"ratslam_maps_{picture_name(name)}", beside or None),
        "costs": cost_table(labels, runs),
        "runs": [
            {
                "name": label,
                "sentence": summarise_run(scene),
                "words": [MISSING[code] for code in _list_missing(scene)],
                "pictures": _draw_pictures(folder, scene),
                "has_truth": scene.truth is not None,
                "marks": [
                    kind
                    for kind, loops in (
                        ("right", scene.right),
                        ("false", scene.false),
                        ("refused", find_denied(scene.run)),
                    )
                    if loops.any()
                ],
                "loops": loop_table(scene),
                "refused": refused_table(scene),
                "looks": look_table(scene.run),
                "notes": scene.run.notes[:_NOTES],
                "more_notes": len(scene.run.notes) - _NOTES,
            }
            for label, scene in named
        ],
    }


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


def summarise_run(scene: Scene) -> str:
    """Describe steps, views, nodes and loops of a run; steps as the report counts them."""
    run, report = scene.run, scene.report
    span = f"{report.seconds:.1f} s and {counted(report.steps, 'step')} from the first node on"
    views = counted(int(new_views(run.view_ids[run.is_view]).sum()), "view")
    made = f"{counted(len(run.nodes), 'node')} and {counted(len(run.links), 'link')}"
    loops = counted(scene.loop_count, "loop")
    judged = report.false_loops is not None and scene.loops.any()
    verdict = f", {int(scene.false.sum())} of them false" if judged else ""
    refused = f"{counted(len(run.refused), 'loop')} refused"
    became = Counter(refusals(scene))
    verdicts = [f"{became[kind]} {kind}" for kind in REFUSALS if became[kind]]
    refused += f" ({', '.join(verdicts)})" if verdicts else ""
    return (
        f"{span}, {counted(report.looks, 'look')}; {views}, {made}; "
        f"{loops} closed{verdict}; {refused}."
    )


def _list_missing(scene: Scene) -> list[str]:
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


def _draw_pictures(folder: Path, scene: Scene) -> dict[str, Picture]:
    """Draw all pictures of a run that have content; "way" is from its last node to the first."""
    run, route = scene.run, None
    if len(run.nodes) > 1 and run.node_ids[-1] > 0:
        with suppress(DataError):  # a stored map may consist of disconnected parts
            route = quickest_route(run.links, len(run.nodes), int(run.node_ids[-1]), 0)
    drawn: dict[str, Figure | None] = {
        "map": draw_map(scene) if len(run.nodes) > 1 else None,
        "errors": draw_errors(scene),
        "views": draw_views(scene),
        "cells": draw_activity(run),
        "way": draw_route(scene, route) if route else None,
        "times": draw_step_times(run),
    }
    name = picture_name(run.name, run.views, run.odometry, run.preset)
    kept = {kind: keep(folder, f"ratslam_{kind}_{name}", one) for kind, one in drawn.items()}
    return {kind: picture for kind, picture in kept.items() if picture is not None}
