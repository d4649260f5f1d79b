# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the report: the page, its pictures and the files beside it."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation import CITATION, COMMON_RULES, PROTOCOLS, Evaluation, protocol_named
from fusionslam.evaluation.loops.protocols import DEFAULTS
from fusionslam.report.loops.exports import write_matches, write_metrics, write_tum
from fusionslam.report.loops.frame_pairs import CloudReader, ImageReader, forgiving
from fusionslam.report.loops.labels import by_rank, winner
from fusionslam.report.loops.plots import styled
from fusionslam.report.loops.sections import Context, SourcePart, source_part
from fusionslam.report.loops.tables import summary_table
from fusionslam.storage.files import atomic_path

if TYPE_CHECKING:
    pass
from fusionslam.report.page.html import about_report, check_extra, environment


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
