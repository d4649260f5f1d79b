# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the report of views: the page, its pictures, the files beside it, and the runs."""

import os
from base64 import b64encode
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.archive import load_json
from fusionslam.base.argument_types import checked
from fusionslam.base.csv_files import write_csv
from fusionslam.base.files import atomic_path
from fusionslam.base.texts import counted
from fusionslam.config import merged, unit_of, walk
from fusionslam.errors import DataError
from fusionslam.evaluation import (
    RERUN_CITATION,
    VIEW_CITATION,
    ViewReport,
    ViewRule,
    ViewRun,
    rerun_descriptors,
)
from fusionslam.evaluation.views.report import percent
from fusionslam.evaluation.views.rules import view_rule
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
from fusionslam.report.page.images import Picture, keep, keep_photo
from fusionslam.report.views.exports import COLUMNS, list_scans, metrics_of, scrub_data
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

RUNS = "views"
"""Folder of the stored runs, beside the page."""
_PAIRS, _HELD_BACK = 8, 50


@checked
def write_view_report(
    runs: ViewRun | Sequence[ViewRun],
    folder: str | os.PathLike[str],
    *,
    rule: str | ViewRule = "paper",
    title: str | None = None,
    command: str = "",
    notes: Sequence[str] = (),
) -> Path:
    """Write views.html, which opens offline, its pictures and figures, and the runs.

    Args:
        runs: one per drive and method; runs over the same drive share a ``world`` and are
            compared. Pictures come from their images, else from their clouds, else from an earlier
            report in this folder.
        folder: created if missing. Files of an earlier report there are replaced; its runs under
            other names are kept for ``write_stored_view_report``.
        rule: rule that judges the ids.
        title: None derives one.
        command: the command line that produced the runs.
        notes: sentences at the top of the page.

    Returns:
        The path of views.html.

    Raises:
        DataError: no runs, a run without scans, two with one name, or the folder cannot be written.
        ConfigError: unknown rule.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    check_extra()
    runs = [runs] if isinstance(runs, ViewRun) else list(runs)
    files = [file_name(run.world, run.method) for run in runs]
    check_runs(runs, [f"{run.world} / {run.method}" for run in runs], files)
    target = Path(folder)
    name, limits = view_rule(rule)
    for run, file in zip(runs, files, strict=True):
        run.save(target / RUNS / f"{file}.npz")
    judged = [(run, run.judge(limits)) for run in runs]
    missed: dict[str, None] = {}
    groups = group_by(judged, lambda pair: pair[0].world)
    with use_style():
        worlds = [_world_part(target, world, group, missed) for world, group in groups.items()]
    configs = {f"{run.world} / {run.method}": run.config for run in runs if run.config}
    about = about_report(", ".join(groups), command, configs)
    about |= {"title": title, "notes": list(notes), "rule": name}
    about["limits"] = limits.model_dump(mode="json")
    write_figures(target / "views.json", about, [metrics_of(*pair) for pair in judged])
    scans = (row for pair in judged for row in list_scans(*pair))
    write_csv(target / "views.csv", COLUMNS, scans)
    return write_page(
        target / "views.html",
        "views.html.j2",
        about,
        title=title or f"Views recognised in {about['dataset']}",
        notes=[*notes, *(f"Pictures of scans are missing: {why}." for why in [*missed][:1])],
        runs=len(runs),
        worlds=worlds,
        rule_name=name,
        citation=VIEW_CITATION,
        rerun=RERUN_CITATION,
        limits=[
            (key, f"{value:g} {unit_of(field)}", field.description)
            for key, value, field in walk(limits)
        ],
        most=MOST,
    )


def _world_part(
    folder: Path, world: str, judged: Judged, missed: dict[str, None]
) -> dict[str, Any]:
    """Draw everything known about one drive, as ``views.html.j2`` shows it.

    Pictures that would be empty are None.

    Args:
        folder: of the page.
        world: name of the drive.
        judged: its runs with their reports.
        missed: collects the reasons why scans have no picture.
    """
    first, report = judged[0]
    name = picture_name(world)
    previews = previews_of(judged, folder / RUNS / f"{file_name(world)}.previews", missed)
    return {
        "name": world,
        "scans": counted(len(first), "scan"),
        "seconds": float(first.stamps[-1] - first.stamps[0]),
        "metres": float(np.hypot(*np.diff(first.poses[:, :2], axis=0).T).sum()),
        "report": report,
        "figures": accuracy_table(judged),
        "costs": cost_table(judged),
        "rerun": rerun_table(judged),
        "published": "; ".join(
            f"{row.input.removeprefix('c-M2DP, ')} {percent(row.top1)}"
            for row in rerun_descriptors(world)
        ),
        "curves": keep(folder, f"views_pr_{name}", draw_view_curves(judged)),
        "sweeps": [
            (run.method, sweep_table(run, run.curve, report.rule))
            for run, report in judged
            if run.curve is not None
        ],
        "errors": keep(folder, f"views_errors_{name}", draw_errors(judged)),
        "faultless": [run.method for run, report in judged if not report.false_positives],
        "times": keep(folder, f"views_times_{name}", draw_times(judged)),
        "methods": [_method_part(folder, run, report, previews) for run, report in judged],
        "scrub": {
            "runs": [scrub_data(run, report, previews) for run, report in judged],
            "previews": _embed(judged, previews),
        },
        "longest": max(len(run) for run, _ in judged),
    }


def _method_part(
    folder: Path, run: ViewRun, report: ViewReport, previews: Mapping[int, bytes]
) -> dict[str, Any]:
    """Draw the loops of a run, its belief, and the false positives that are farthest off."""
    name = picture_name(run.world, run.method)
    has_loops = bool(report.revisits or report.loops)
    belief = f"views_belief_{picture_name(f'{run.world}_{run.method}')}"
    seconds = run.stamps - run.stamps[:1]
    wrong = report.false_positive_indices
    pairs: list[Picture] = []
    for row in wrong[np.argsort(-report.distances[wrong], kind="stable")].tolist():
        matched = int(report.matched[row])
        left, right = (previews.get(stamp_key(run.stamps[i])) for i in (row, matched))
        if left is None or right is None or len(pairs) == _PAIRS:
            continue
        caption = (
            f"Scan {run.numbers[row]} was taken for scan {run.numbers[matched]}: "
            f"{report.distances[row]:.2f} m and {report.angles[row]:.0f}° apart."
        )
        file = f"views_false_{name}_{run.numbers[row]}"
        pairs.append(keep_photo(folder, file, side_by_side(left, right), caption))
    return {
        "name": run.method,
        "report": report,
        "path": keep(folder, f"views_path_{name}", draw_path(run, report) if has_loops else None),
        "belief": keep(folder, belief, draw_belief(run)),
        "held_back": [
            {"scan": f"{run.numbers[row]}", "seconds": f"{seconds[row]:.1f}", "why": reason}
            for row, reason in run.held_back[:_HELD_BACK]
        ],
        "pairs": pairs,
    }


def _embed(judged: Judged, previews: Mapping[int, bytes]) -> dict[str, str]:
    """Return the previews that the page shows, by key, in base 64."""
    shown = {
        stamp_key(run.stamps[row])
        for run, report in judged
        for row in list_needed_rows(run, report)
    }
    return {
        str(key): b64encode(data).decode("ascii") for key, data in previews.items() if key in shown
    }


@checked
def has_view_runs(folder: str | os.PathLike[str]) -> bool:
    """Return whether a folder holds runs that ``write_view_report`` stored."""
    return any(_run_files(Path(folder)))


@checked
def load_view_runs(folder: str | os.PathLike[str]) -> list[ViewRun]:
    """Load the runs that ``write_view_report`` stored in a folder, by world and method.

    Raises:
        DataError: there is none, or one is damaged; the message names it.
    """
    runs = [ViewRun.load(path) for path in _run_files(Path(folder))]
    if not runs:
        raise DataError(f"{folder}: no view runs in {Path(folder) / RUNS}", code="no-runs")
    return runs


def _run_files(folder: Path) -> list[Path]:
    return sorted((folder / RUNS).glob("*.npz"))


@checked
def write_stored_view_report(
    folder: str | os.PathLike[str], output: str | os.PathLike[str] | None = None
) -> Path:
    """Write the report again from the runs and previews stored in a folder.

    Args:
        folder: folder that ``write_view_report`` wrote.
        output: folder of the new report; None for the same.

    Raises:
        DataError: no runs, or something there is damaged.
    """
    source, target = Path(folder), Path(output or folder)
    runs = load_view_runs(source)
    about: dict[str, Any] = {}
    before: list[tuple[str, str]] = []
    if (source / "views.json").exists():
        with load_json(source / "views.json", None, "the figures of views.html") as about:
            before = [(run.get("world"), run.get("method")) for run in about.get("runs", [])]
    if target.resolve() != source.resolve():
        for path in (source / RUNS).glob("*.previews"):
            with atomic_path(target / RUNS / path.name) as temporary:
                temporary.write_bytes(path.read_bytes())

    def place(run: ViewRun) -> int:
        """In the order of the earlier page; new runs last."""
        name = (run.world, run.method)
        return before.index(name) if name in before else len(before)

    return write_view_report(
        sorted(runs, key=place),
        target,
        rule=merged(ViewRule(), about.get("limits", {})),
        title=about.get("title"),
        command=about.get("command", ""),
        notes=about.get("notes", []),
    )
