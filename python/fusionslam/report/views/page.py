# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the report of views: the page, its pictures, the files beside it, and the runs."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fusionslam.config import merged, walk
from fusionslam.errors import DataError
from fusionslam.evaluation import (
    RERUN_CITATION,
    VIEW_CITATION,
    ViewReport,
    ViewRule,
    ViewRun,
)
from fusionslam.evaluation.views.rules import view_rule
from fusionslam.report.loops.plots import styled
from fusionslam.report.page.html import about_report, check_extra, environment, file_name
from fusionslam.report.views.exports import write_view_metrics, write_view_rows
from fusionslam.report.views.sections import WorldPart, world_part
from fusionslam.storage.files import atomic_path

RUNS = "views"
"""Folder of the runs, beside the page."""


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
        runs: one per drive and method; those over one drive share a ``world`` and are compared.
            Pictures are made of their images, or else of their clouds, or else of what an
            earlier report in this folder made.
        folder: made if missing. Files of an earlier report there are replaced; its runs under
            other names stay, for ``write_stored_view_report``.
        rule: by which the ids are judged.
        title: None makes one.
        command: what was typed to get here.
        notes: sentences for the head of the page.

    Returns:
        The path of views.html.

    Raises:
        DataError: no runs, a run without scans, two of one name, or the folder cannot be written.
        ConfigError: unknown rule.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    check_extra()
    runs = [runs] if isinstance(runs, ViewRun) else list(runs)
    _check(runs)
    target = Path(folder)
    name, limits = view_rule(rule)
    for run in runs:
        run.save(target / RUNS / f"{file_name(run.world, run.method)}.npz")
    reports = {id(run): run.judged(limits) for run in runs}
    judged = [(run, reports[id(run)]) for run in runs]
    missed: dict[str, None] = {}
    with styled():
        worlds = [
            world_part(target, target / RUNS, f"{number}", world, group, missed)
            for number, (world, group) in enumerate(_by_world(judged).items())
        ]
    about = about_report(", ".join(part.name for part in worlds), command, _configs(runs))
    about |= {"title": title, "notes": list(notes), "rule": name}
    about["limits"] = limits.model_dump(mode="json")
    write_view_metrics(target / "views.json", judged, about)
    write_view_rows(target / "views.csv", judged)
    lines = [*notes, *(f"Pictures of scans are missing: {why}." for why in [*missed][:1])]
    page = _page(worlds, about, limits, len(runs), lines)
    with atomic_path(target / "views.html") as temporary:
        temporary.write_text(page, encoding="utf-8")
    return target / "views.html"


def has_view_runs(folder: str | os.PathLike[str]) -> bool:
    """Whether a folder holds runs that ``write_view_report`` stored."""
    return any(_run_files(Path(folder)))


def load_view_runs(folder: str | os.PathLike[str]) -> list[ViewRun]:
    """The runs that ``write_view_report`` stored in a folder, by world and method.

    Raises:
        DataError: there is none, or one is damaged; the message names it.
    """
    runs = [ViewRun.load(path) for path in _run_files(Path(folder))]
    if not runs:
        raise DataError(f"{folder}: no view runs in {Path(folder) / RUNS}")
    return runs


def write_stored_view_report(
    folder: str | os.PathLike[str], output: str | os.PathLike[str] | None = None
) -> Path:
    """Write the report once more from the runs and previews that a folder holds.

    Args:
        folder: what ``write_view_report`` wrote.
        output: folder of the new report; None for the same.

    Raises:
        DataError: no runs, or something there is damaged.
    """
    source, target = Path(folder), Path(output or folder)
    runs = load_view_runs(source)
    about = _about_before(source / "views.json")
    if target.resolve() != source.resolve():
        for path in (source / RUNS).glob("*.previews"):
            with atomic_path(target / RUNS / path.name) as temporary:
                temporary.write_bytes(path.read_bytes())
    return write_view_report(
        _as_before(runs, about),
        target,
        rule=merged(ViewRule(), about.get("limits", {})),
        title=about.get("title"),
        command=about.get("command", ""),
        notes=about.get("notes", []),
    )


def _about_before(path: Path) -> dict[str, Any]:
    """What views.json says, nothing if it is not there."""
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    if not isinstance(about, dict):
        raise DataError(f"{path}: expected an object")
    return about


def _as_before(runs: list[ViewRun], about: Mapping[str, Any]) -> list[ViewRun]:
    """Runs in the order that they had; new ones last."""
    names = [(run.get("world"), run.get("method")) for run in about.get("runs", [])]
    return sorted(
        runs,
        key=lambda run: (
            names.index((run.world, run.method)) if (run.world, run.method) in names else len(names)
        ),
    )


def _run_files(folder: Path) -> list[Path]:
    return sorted((folder / RUNS).glob("*.npz"))


def _check(runs: Sequence[ViewRun]) -> None:
    if not runs:
        raise DataError("report: there are no view runs to write about")
    names = [file_name(run.world, run.method) for run in runs]
    for run, name in zip(runs, names, strict=True):
        if not len(run):
            raise DataError(f"report: the run {run.world} / {run.method} has no scans")
        if names.count(name) > 1:
            raise DataError(f"report: two runs are called {run.world} / {run.method}")


def _by_world(
    judged: Sequence[tuple[ViewRun, ViewReport]],
) -> dict[str, list[tuple[ViewRun, ViewReport]]]:
    groups: dict[str, list[tuple[ViewRun, ViewReport]]] = {}
    for run, report in judged:
        groups.setdefault(run.world, []).append((run, report))
    return groups


def _configs(runs: Sequence[ViewRun]) -> dict[str, Any]:
    return {f"{run.world} / {run.method}": run.config for run in runs if run.config}


def _page(
    worlds: Sequence[WorldPart],
    about: Mapping[str, Any],
    limits: ViewRule,
    count: int,
    notes: Sequence[str],
) -> str:
    return (
        environment()
        .get_template("views.html.j2")
        .render(
            title=about["title"] or f"Views recognised in {about['dataset']}",
            runs=count,
            worlds=worlds,
            rule_name=about["rule"],
            about=about,
            notes=notes,
            citation=VIEW_CITATION,
            rerun=RERUN_CITATION,
            limits=[_limit(name, value, field) for name, value, field in walk(limits)],
            config=json.dumps(about["config"], indent=2),
        )
    )


def _limit(name: str, value: float, field: Any) -> tuple[str, str, str]:
    return name, f"{value:g} {field.json_schema_extra['unit']}", field.description
