# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the report of views: the page, its pictures, the files beside it, and the runs."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fusionslam.argument_types import checked
from fusionslam.config import merged, walk
from fusionslam.errors import DataError
from fusionslam.evaluation import RERUN_CITATION, VIEW_CITATION, ViewRule, ViewRun
from fusionslam.evaluation.views.rules import view_rule
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import (
    about_report,
    check_extra,
    check_runs,
    file_name,
    group_by,
    write_figures,
    write_page,
)
from fusionslam.report.views.exports import COLUMNS, list_scans, metrics_of
from fusionslam.report.views.sections import world_part
from fusionslam.storage.archive import load_json
from fusionslam.storage.csv_files import write_csv
from fusionslam.storage.files import atomic_path

RUNS = "views"
"""Folder of the stored runs, beside the page."""


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
    with use_style():
        worlds = [
            world_part(target, target / RUNS, f"{number}", world, group, missed)
            for number, (world, group) in enumerate(
                group_by(judged, lambda pair: pair[0].world).items()
            )
        ]
    configs = {f"{run.world} / {run.method}": run.config for run in runs if run.config}
    about = about_report(", ".join(part["name"] for part in worlds), command, configs)
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
        limits=[_describe_limit(key, value, field) for key, value, field in walk(limits)],
    )


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
    about = _load_about(source / "views.json")
    if target.resolve() != source.resolve():
        for path in (source / RUNS).glob("*.previews"):
            with atomic_path(target / RUNS / path.name) as temporary:
                temporary.write_bytes(path.read_bytes())
    return write_view_report(
        _sort_as_before(runs, about),
        target,
        rule=merged(ViewRule(), about.get("limits", {})),
        title=about.get("title"),
        command=about.get("command", ""),
        notes=about.get("notes", []),
    )


def _load_about(path: Path) -> dict[str, Any]:
    """Return the header of views.json, empty if the file is missing."""
    if not path.exists():
        return {}
    with load_json(path, None, "the figures of views.html") as about:
        return about


def _sort_as_before(runs: list[ViewRun], about: Mapping[str, Any]) -> list[ViewRun]:
    """Sort runs in their earlier order; new ones last."""
    names = [(run.get("world"), run.get("method")) for run in about.get("runs", [])]
    return sorted(
        runs,
        key=lambda run: (
            names.index((run.world, run.method)) if (run.world, run.method) in names else len(names)
        ),
    )


def _run_files(folder: Path) -> list[Path]:
    return sorted((folder / RUNS).glob("*.npz"))


def _describe_limit(name: str, value: float, field: Any) -> tuple[str, str, str]:
    return name, f"{value:g} {field.json_schema_extra['unit']}", field.description
