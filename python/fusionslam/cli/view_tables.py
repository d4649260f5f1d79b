# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of results that tune, bench views and the views commands print, and their files."""

import json
import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.files import write_file
from fusionslam.base.machine import machine, versions
from fusionslam.base.progress import Step
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import print_figures, print_table
from fusionslam.evaluation import ViewJudge, ViewReport, baselines
from fusionslam.evaluation.views.rules import VIEW_RULES, explain_no_revisit
from fusionslam.pipelines.compare_views import ViewResult
from fusionslam.pipelines.drives import FRAMES, Drive
from fusionslam.pipelines.results import delete_page
from fusionslam.pipelines.views import MatchRun
from fusionslam.report.views.comparison_tables import (
    LEGEND,
    accuracy_table,
    cost_table,
    groups,
    notes,
    write_view_bench,
)
from fusionslam.views.scene_set import SceneSet

HEADS = ("accuracy", "loop recall", "loop precision", "views")


def figures(report: ViewReport) -> list[str]:
    """Return a run's cells under ``HEADS``."""
    shares = (report.accuracy, report.loop_recall, report.loop_precision)
    texts = ["none" if share is None else f"{100 * share:.1f} %" for share in shares]
    return [*texts, str(report.views)]


def curve_row(curve: Any, name: str, threshold: float | None) -> list[str]:
    """Return a row of the table of thresholds; cells are empty if there is no such threshold."""
    if threshold is None:
        return [name, "none", *("" for _ in HEADS)]
    row = curve.at(threshold)
    names = ("accuracy", "loop_recall", "loop_precision")
    texts = ["none" if row[key] is None else f"{100 * row[key]:.1f} %" for key in names]
    return [name, f"{threshold:.4g}", *texts, f"{row['views']:.0f}"]


def print_run(run: MatchRun, report: ViewReport | None) -> None:
    """Print a matcher's results and costs, and its accuracy if there is ground truth."""
    stats = run.stats
    times = [
        1000 * float(np.median(each)) if len(each) else 0.0
        for each in (run.build_seconds, run.match_seconds)
    ]
    belief = ""
    if run.follows_odometry:
        belief = (
            f"\nweighed by odometry: {stats.ambiguous} ambiguous, {stats.by_odometry} at a place "
            f"that the scan did not show, {counted(stats.revised, 'answer')} revised later"
        )
    print(
        f"{counted(stats.processed, 'scan')}: {stats.matched} matched, "
        f"{counted(stats.new, 'place')}, {stats.nothing} with nothing to recognise, "
        f"{stats.single} with a single object{belief}\n"
        f"{counted(stats.stored, 'view')} stored, {stats.bytes_per_view:.0f} bytes each, "
        f"{stats.dropped} dropped; building {times[0]:.3f} ms, matching {times[1]:.3f} ms (medians)"
    )
    if report is None:
        print("no true poses: the ids are not judged (--gt names a file of poses)")
        return
    rows = [["these matches", *figures(report)], *without_sensor(run.scenes, report.rule_name)]
    print_table(["method", *HEADS], rows)
    print_limits(run.scenes, report.rule_name)


def print_limits(scenes: SceneSet, rule_name: str) -> None:
    """Print what counts as a loop under a rule, or that no scan comes back."""
    rule, poses = VIEW_RULES[rule_name], scenes.true_poses()
    if ViewJudge(poses, scenes.seconds, rule=rule).revisit.any():
        print(
            f"rule {rule_name}: loops are right within {rule.loop_distance:g} m and "
            f"{rule.loop_angle:.3g} deg"
        )
    else:
        by_car = ViewJudge(poses, scenes.seconds, rule="car").revisit
        print(explain_no_revisit(rule, int(by_car.sum())))


def without_sensor(scenes: SceneSet, rule: str) -> list[list[str]]:
    """Return the rows of the baselines without a sensor: accuracy alone says little."""
    judge = ViewJudge(scenes.true_poses(), scenes.seconds, rule=rule)
    ids = baselines(len(scenes))
    return [[name, *figures(judge.judge(given))] for name, given in ids.items()]


def save_figures(path: Path, run: MatchRun, values: dict[str, Any], command: str) -> None:
    """Write a matcher's counts and configuration as JSON."""
    content = {
        "scenes": run.scenes.name,
        "command": command,
        "threshold": run.threshold,
        "stats": {**asdict(run.stats), "bytes_per_view": run.stats.bytes_per_view},
        "views": values,
    }
    write_file(path, json.dumps(content, indent=1))


def write_bench(
    output: Path,
    drives: Sequence[Drive],
    results: Sequence[ViewResult],
    step: Step,
    *,
    no_report: bool = False,
) -> list[Path]:
    """Write Markdown, JSON and one page per frame; return the paths of the pages."""
    about = {"command": opt.command_line(), "versions": versions(), "machine": machine()}
    write_view_bench(output, results, {drive.name: drive.dropped for drive in drives}, about)
    frames = list(dict.fromkeys(result.frame for result in results))
    pages = [output / "views.md"]
    if no_report:
        for folder in (output, *(output / frame for frame in FRAMES)):
            delete_page(folder, "views")
        return pages
    from fusionslam.report.views.page import write_view_report

    for number, frame in enumerate(frames):
        step("writing the reports", number, len(frames))
        runs = [r.run for r in results if r.frame == frame and r.run is not None]
        if runs:
            folder = output if len(frames) == 1 else output / frame
            pages.append(write_view_report(runs, folder, command=opt.command_line()))
    step("writing the reports", len(frames), len(frames))
    return pages


def print_bench(drives: Sequence[Drive], results: Sequence[ViewResult]) -> None:
    """Print the tables, in 80 columns."""
    for heading, rows in groups(results):
        print_figures(heading, accuracy_table(rows))
        print_figures("", cost_table(rows))
        print()
    lines = [LEGEND]
    lines += [
        f"{drive.name}: {counted(drive.dropped, 'scan')} without anything above the floor left out"
        for drive in drives
        if drive.dropped
    ]
    for line in [*lines, *notes(results)]:
        print(textwrap.fill(line, 80, subsequent_indent="  "))
