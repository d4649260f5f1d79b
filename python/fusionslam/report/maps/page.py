# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the report of maps: the page, its pictures, the figures, and the runs."""

import os
from collections.abc import Sequence
from pathlib import Path

from fusionslam.argument_types import checked
from fusionslam.errors import DataError
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.report.maps.config_table import config_table
from fusionslam.report.maps.sections import drive_part, run_file_name
from fusionslam.report.maps.tables import MOST
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import (
    about_report,
    check_extra,
    check_runs,
    group_by,
    write_figures,
    write_page,
)

RUNS = "ratslam"
"""Folder of the stored runs, beside the page."""

Judged = list[tuple[RatSlamRun, MapReport]]


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
    judged = _pair_with_reports(runs, reports)
    target = Path(folder)
    labels = [_label(run) for run, _ in judged]
    for run, _ in judged:
        run.save(target / RUNS / f"{run_file_name(run)}.npz")
    with use_style():
        drives = [
            drive_part(target, f"{number}", name, group)
            for number, (name, group) in enumerate(
                group_by(judged, lambda pair: pair[0].name).items()
            )
        ]
    config = {_label(run): dict(run.config) for run, _ in judged if run.config}
    about = about_report(", ".join(drive["name"] for drive in drives), command, config)
    about |= {"title": title, "notes": list(notes)}
    write_figures(target / "ratslam.json", about, [report.metrics() for _, report in judged])
    return write_page(
        target / "ratslam.html",
        "maps.html.j2",
        about,
        title=title or f"Maps of {about['dataset']}",
        notes=notes,
        drives=drives,
        runs=len(judged),
        rule=judged[0][1].rule,
        most=MOST,
        config=config_table(labels, [run for run, _ in judged]),
    )


def _pair_with_reports(
    runs: RatSlamRun | Sequence[RatSlamRun], reports: MapReport | Sequence[MapReport] | None
) -> Judged:
    """Pair runs with their reports; raises DataError if no page can be written."""
    runs = [runs] if isinstance(runs, RatSlamRun) else list(runs)
    check_runs(runs, [_label(run) for run in runs], [run_file_name(run) for run in runs])
    given = [reports] if isinstance(reports, MapReport) else reports
    judged = [judge_map(run) for run in runs] if given is None else list(given)
    if len(judged) != len(runs):
        problem = f"report: {len(judged)} reports of {len(runs)} runs, expected one of each"
        raise DataError(problem, code="counts-differ")
    return list(zip(runs, judged, strict=True))


def _label(run: RatSlamRun) -> str:
    return " / ".join((run.name, run.views, run.odometry, run.preset))
