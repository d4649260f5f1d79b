# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sections of the report of views on one drive."""

from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.evaluation import ViewReport, ViewRun, rerun_descriptors
from fusionslam.evaluation.views.report import percent
from fusionslam.help_texts import counted
from fusionslam.report.page.html import file_name, picture_name
from fusionslam.report.page.images import Picture, keep, keep_photo
from fusionslam.report.views.exports import scrub_data
from fusionslam.report.views.plots import (
    Judged,
    draw_belief,
    draw_errors,
    draw_path,
    draw_times,
    draw_view_curves,
)
from fusionslam.report.views.previews import MOST, list_needed_rows, previews_of, stamp_key
from fusionslam.report.views.tables import accuracy_table, cost_table, rerun_table, sweep_table
from fusionslam.report.views.thumbnails import side_by_side

_PAIRS, _HELD_BACK = 8, 50
_TIMES = "Wall time of every scan, to make its view and to compare it with all stored ones."


def world_part(
    folder: Path, stored: Path, id: str, world: str, judged: Judged, missed: dict[str, None]
) -> dict[str, Any]:
    """Draw everything known about one drive.

    Args:
        folder, stored: folders of the pictures and of the previews.
        id: identifier, unique on the page.
        world: name of the drive.
        judged: its runs with their reports.
        missed: collects the reasons why scans have no picture.

    Returns:
        A drive as ``views.html.j2`` shows it; pictures that would be empty are None.
    """
    runs, reports = [run for run, _ in judged], [report for _, report in judged]
    name = picture_name(world)
    previews = previews_of(runs, reports, stored / f"{file_name(world)}.previews", missed)
    return {
        "name": world,
        "id": id,
        "sentence": _describe_drive(runs[0], reports[0]),
        "figures": accuracy_table(judged),
        "costs": cost_table(judged),
        "rerun": rerun_table(judged),
        "published": "; ".join(
            f"{row.input.removeprefix('c-M2DP, ')} {percent(row.top1)}"
            for row in rerun_descriptors(world)
        ),
        "curves": _draw_curves(folder, name, judged),
        "sweeps": [
            (run.method, sweep_table(run, run.curve, report.rule))
            for run, report in judged
            if run.curve is not None
        ],
        "errors": _draw_errors(folder, name, judged),
        "times": keep(folder, f"views_times_{name}", draw_times(judged), _TIMES),
        "methods": [
            {
                "name": run.method,
                "loops": _describe_loops(report),
                "wrong": report.false_positives,
                "path": _draw_path(folder, run, report),
                "belief": _draw_belief(folder, run),
                "held_back": _list_held_back(run),
                "pairs": _draw_pairs(folder, run, report, previews),
            }
            for run, report in judged
        ],
        "scrub": _collect_slider_data(judged, previews),
        "left_out": _describe_left_out(judged),
    }


def _describe_drive(run: ViewRun, report: ViewReport) -> str:
    seconds = float(run.stamps[-1] - run.stamps[0])
    length = float(np.hypot(*np.diff(run.poses[:, :2], axis=0).T).sum())
    back = f"{report.revisits} of them come back to where the robot was more than "
    if not report.revisits:
        back = "none of them comes back to where the robot was more than "
    longer = ""
    if not report.revisits:
        longer = " Loops need a longer drive, on which the robot comes back to known places."
    return (
        f"{counted(len(run), 'scan')} in {seconds:.0f} s and {length:.0f} m; "
        f"{back}{report.rule.loop_age:g} s before.{longer}"
    )


def _draw_curves(folder: Path, name: str, judged: Judged) -> Picture | None:
    caption = (
        "Precision over recall as the threshold changes; up and right is better. Dots: the "
        "thresholds in use. Which scenes are stored depends on the threshold, so curves may turn "
        "back. Grey: programs without a sensor, which have recall but no loop recall."
    )
    return keep(folder, f"views_pr_{name}", draw_view_curves(judged), caption)


def _draw_errors(folder: Path, name: str, judged: Judged) -> Picture | None:
    caption = (
        "Every false positive: when it happened, and how far from the first scene of its view. "
        "Dashed: from here on the distance alone makes it false; below, it is the angle."
    )
    without = [run.method for run, report in judged if not report.false_positives]
    if without:
        caption += f" No false positive: {', '.join(without)}."
    return keep(folder, f"views_errors_{name}", draw_errors(judged), caption)


def _describe_loops(report: ViewReport) -> str:
    if not report.revisits and not report.loops:
        return "No scan comes back, and none was matched with an old view: there is no loop."
    found = f"{report.found_revisits} of {report.revisits} revisits found"
    if not report.revisits:
        found = "No scan comes back, so loop recall does not exist"
    right = f"{report.correct_loops} of {report.loops} matches with old views are right"
    if not report.loops:
        right = "no scan was matched with an old view, so loop precision does not exist"
    return f"{found}; {right}."


def _draw_belief(folder: Path, run: ViewRun) -> Picture | None:
    caption = (
        "Belief over time: what the scan and odometry say together of where the robot is. An "
        "answer is held back while neither a place nor a new one is probable enough."
    )
    name = picture_name(f"{run.world}_{run.method}")
    return keep(folder, f"views_belief_{name}", draw_belief(run), caption)


def _list_held_back(run: ViewRun) -> list[dict[str, str]]:
    """Scans whose answers were held back: number, seconds and reason; the first ones of many."""
    seconds = run.stamps - run.stamps[:1]
    return [
        {"scan": f"{run.numbers[row]}", "seconds": f"{seconds[row]:.1f}", "why": reason}
        for row, reason in run.held_back[:_HELD_BACK]
    ]


def _draw_path(folder: Path, run: ViewRun, report: ViewReport) -> Picture | None:
    if not report.revisits and not report.loops:
        return None
    caption = (
        "Grey: the path. Green: matches with old views that are right. Red: wrong ones; their "
        "lines lead to the views they were taken for. Orange: revisits that were missed."
    )
    name = f"views_path_{picture_name(run.world, run.method)}"
    return keep(folder, name, draw_path(run, report), caption)


def _draw_pairs(
    folder: Path, run: ViewRun, report: ViewReport, previews: Mapping[int, bytes]
) -> list[Picture]:
    """Draw the false positives with the largest errors, as pictures of both scans."""
    wrong = report.false_positive_indices
    worst = wrong[np.argsort(-report.distances[wrong], kind="stable")]
    pictures: list[Picture] = []
    for row in worst.tolist():
        matched = int(report.matched[row])
        left, right = (previews.get(stamp_key(run.stamps[i])) for i in (row, matched))
        if left is None or right is None or len(pictures) == _PAIRS:
            continue
        caption = (
            f"Scan {run.numbers[row]} was taken for scan {run.numbers[matched]}: "
            f"{report.distances[row]:.2f} m and {report.angles[row]:.0f}° apart."
        )
        name = f"views_false_{picture_name(run.world, run.method)}_{run.numbers[row]}"
        pictures.append(keep_photo(folder, name, side_by_side(left, right), caption))
    return pictures


def _collect_slider_data(judged: Judged, previews: Mapping[int, bytes]) -> dict[str, Any]:
    shown = {
        stamp_key(run.stamps[row])
        for run, report in judged
        for row in list_needed_rows(run, report)
    }
    return {
        "runs": [scrub_data(run, report, previews) for run, report in judged],
        "previews": {
            str(key): b64encode(data).decode("ascii")
            for key, data in previews.items()
            if key in shown
        },
    }


def _describe_left_out(judged: Judged) -> str:
    longest = max(len(run) for run, _ in judged)
    if longest <= MOST:
        return ""
    return (
        f"Of {longest} scans at most {MOST} are shown: false positives, the farthest first, and "
        "scans at even steps."
    )
