# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the report: the page, its pictures and the files beside it."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam._files import atomic_path
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.evaluation import CITATION, COMMON_RULES, PROTOCOLS, Evaluation, protocol_named
from fusionslam.evaluation.protocols import DEFAULTS
from fusionslam.report.exports import write_matches, write_metrics, write_tum
from fusionslam.report.machine import machine, versions
from fusionslam.report.pairs import CloudReader, ImageReader, forgiving
from fusionslam.report.plots import styled
from fusionslam.report.sections import Context, SourcePart, source_part
from fusionslam.report.tables import summary_table
from fusionslam.report.words import by_rank, winner

if TYPE_CHECKING:
    from jinja2 import Environment


def write_report(
    evaluations: Sequence[Evaluation],
    folder: str | os.PathLike[str],
    *,
    dataset_name: str,
    command: str,
    config: Mapping[str, Any],
    clouds: CloudReader | None = None,
    images: ImageReader | None = None,
    protocol: str = DEFAULTS.protocol,
    title: str | None = None,
    notes: Sequence[str] = (),
) -> Path:
    """Write report.html, which opens offline, and its pictures, metrics, loops and poses.

    Args:
        evaluations: one per source and descriptor.
        folder: made if missing. Files of an earlier report there are replaced.
        dataset_name: for the title.
        command: what was typed to get here.
        config: the configuration in force, as JSON can hold it.
        clouds: (source, frame of the dataset) -> the cloud that was described.
        images: (source, frame of the dataset) -> uint8 (H, W, 3) RGB or (H, W).
        protocol: by which loops are judged; the others appear in metrics.json.
        title: None makes one of the dataset's name.
        notes: sentences for the head of the page.

    Returns:
        The path of report.html.

    Raises:
        DataError: no evaluations, or the folder cannot be written.
        ConfigError: no evaluation was made under this protocol.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    check_extra()
    _check(evaluations, protocol)
    target = Path(folder)
    groups = by_rank(evaluations, protocol)
    evaluations = [evaluation for group in groups.values() for evaluation in group]
    missed: dict[str, None] = {}
    context = Context(target, protocol, forgiving(clouds, missed), forgiving(images, missed))
    about = about_report(dataset_name, command, config)
    with styled():
        sources = [source_part(context, name, group) for name, group in groups.items()]
    write_metrics(target / "metrics.json", evaluations, about)
    write_matches(target / "matches.csv", evaluations, protocol)
    write_tum(target / "poses_tum.txt", _with_poses(evaluations).run)
    notes = [*notes, *_remarks(evaluations, [*missed])]
    page = _page(
        evaluations,
        protocol,
        about,
        sources,
        title or f"Place recognition on {dataset_name}",
        notes,
    )
    with atomic_path(target / "report.html") as temporary:
        temporary.write_text(page, encoding="utf-8")
    return target / "report.html"


def check_extra() -> None:
    """Raise FusionSlamError if what reports need is not installed."""
    for module in ("jinja2", "matplotlib"):
        if find_spec(module) is None:
            raise FusionSlamError("the report needs: pip install 'fusionslam[report]'")


def _check(evaluations: Sequence[Evaluation], protocol: str) -> None:
    if not evaluations:
        raise DataError("report: there are no evaluations to write about")
    for run in (evaluation.run for evaluation in evaluations):
        if not len(run):
            raise DataError(f"report: the run {run.source} / {run.descriptor} has no frames")
    protocol_named(protocol)
    known = {name for evaluation in evaluations for name in evaluation.curves}
    if known and protocol not in known:
        names = ", ".join(sorted(known))
        raise ConfigError(f"report: nothing was judged under {protocol!r}, only under {names}")


def about_report(dataset: str, command: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """What every report says of itself: data, command, date, versions, machine."""
    return {
        "dataset": dataset,
        "command": command,
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "versions": versions(),
        "machine": machine(),
        "config": dict(config),
    }


def _remarks(evaluations: Sequence[Evaluation], missed: Sequence[str]) -> Iterator[str]:
    """What a reader would otherwise look for in vain."""
    skipped = {number: why for e in evaluations for number, why in e.run.skipped.items()}
    if skipped:
        frames = ", ".join(f"{number} ({why})" for number, why in sorted(skipped.items()))
        yield f"{len(skipped)} frames were left out because they cannot be described: {frames}."
    if missed:
        yield f"Pictures of frames are missing: {missed[0]}."


def _with_poses(evaluations: Sequence[Evaluation]) -> Evaluation:
    """The first evaluation that has ground truth, else the first."""
    return next((e for e in evaluations if e.run.poses is not None), evaluations[0])


def environment() -> "Environment":
    """The templates of reports; an unknown name in one is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("fusionslam", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _page(
    evaluations: Sequence[Evaluation],
    protocol: str,
    about: dict[str, Any],
    sources: list[SourcePart],
    title: str,
    notes: Sequence[str],
) -> str:
    curves = (e.curves.get(protocol) for e in evaluations)
    return (
        environment()
        .get_template("template.html.j2")
        .render(
            title=title,
            winner=winner(evaluations, protocol),
            notes=notes,
            about=about,
            config=json.dumps(about["config"], indent=2),
            summary=summary_table(evaluations, protocol),
            sources=sources,
            judged=next((curve for curve in curves if curve), None),
            rules=COMMON_RULES,
            protocols=PROTOCOLS.values(),
            citation=CITATION if any(e.published for e in evaluations) else None,
            frames=max(len(e.run) for e in evaluations),
        )
    )
