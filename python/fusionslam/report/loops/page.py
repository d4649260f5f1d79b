# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the report: the page, its pictures and the files beside it."""

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from fusionslam.argument_types import checked
from fusionslam.datasets.pose_files import write_poses_tum
from fusionslam.evaluation import CITATION, COMMON_RULES, PROTOCOLS, Evaluation
from fusionslam.evaluation.loops.evaluation import check_judged
from fusionslam.evaluation.loops.protocols import DEFAULTS
from fusionslam.help_texts import counted
from fusionslam.report.loops.comparison import (
    COSTS_CAPTION,
    comparison_table,
    draw_costs,
    pair_up,
    write_comparison,
)
from fusionslam.report.loops.exports import MATCH_COLUMNS, list_matches, metrics_of
from fusionslam.report.loops.frame_pairs import CloudReader, ImageReader, ScanReader
from fusionslam.report.loops.labels import by_rank, winner
from fusionslam.report.loops.sections import Context, source_part
from fusionslam.report.loops.tables import peers_table, summary_table
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import (
    about_report,
    check_extra,
    check_runs,
    write_figures,
    write_page,
)
from fusionslam.report.page.images import forgive, keep
from fusionslam.report.place_maps import MapLead
from fusionslam.storage.csv_files import write_csv

MAP_PAGE = "map.html"
"""Page of the map of the same drive, beside the report."""


@checked
def write_report(
    evaluations: Sequence[Evaluation],
    folder: str | os.PathLike[str],
    *,
    dataset_name: str,
    command: str,
    config: Mapping[str, Any],
    clouds: CloudReader | None = None,
    images: ImageReader | None = None,
    scans: ScanReader | None = None,
    protocol: str = DEFAULTS.protocol,
    title: str | None = None,
    notes: Sequence[str] = (),
    drive_map: MapLead | None = None,
) -> Path:
    """Write report.html, which opens offline, and its pictures, metrics, loops and poses.

    Args:
        evaluations: one per source and descriptor, or of verified loops.
        folder: created if missing. Files of an earlier report there are replaced.
        dataset_name: for the title.
        command: the command line that produced the runs.
        config: the effective configuration, in types that JSON can hold.
        clouds: (source, frame of the dataset) -> the cloud that was described, or None.
        images: (source, frame of the dataset) -> uint8 (H, W, 3) RGB or (H, W), or None.
        scans: (source, frame of the dataset) -> float32 (N, 3), points above the ground of the
            cloud that was registered, or None.
        protocol: protocol that judges the loops; the others appear in metrics.json.
        title: None derives one from the dataset's name.
        notes: sentences at the top of the page.
        drive_map: what the map of the same drive shows, whose page is beside the report.

    Returns:
        The path of report.html.

    Raises:
        DataError: no evaluations, or the folder cannot be written.
        ConfigError: no evaluation was made under this protocol (``check_judged``).
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    check_extra()
    _check(evaluations, protocol)
    target = Path(folder)
    groups = by_rank(evaluations, protocol)
    evaluations = [evaluation for group in groups.values() for evaluation in group]
    missed: dict[str, None] = {}
    # A frame may be in several pairs, and all sections of a source show the same frames.
    readers = cache(forgive(clouds, missed)), cache(forgive(images, missed))
    scan_reader = cache(forgive(scans, missed))
    context = Context(target, protocol, *readers, scan_reader)
    about = about_report(dataset_name, command, config)
    with use_style():
        sources = [source_part(context, name, group) for name, group in groups.items()]
        compared = pair_up(evaluations)
        costs = draw_costs([compared], protocol) if len(compared) > 1 else None
        picture = keep(target, "accuracy_cost", costs, COSTS_CAPTION, vector=True)
    write_figures(target / "metrics.json", about, [metrics_of(e) for e in evaluations])
    matches = (row for e in evaluations for row in list_matches(e, protocol))
    write_csv(target / "matches.csv", MATCH_COLUMNS, matches)
    if compared:
        write_comparison(target, {dataset_name: compared}, protocol)
    judged_run = next((e.run for e in evaluations if e.run.poses is not None), None)
    if judged_run is not None and judged_run.poses is not None:
        write_poses_tum(target / "poses_tum.txt", judged_run.stamps_ns, judged_run.poses)
    judged = (e.curves.get(protocol) for e in evaluations)
    return write_page(
        target / "report.html",
        "loops.html.j2",
        about,
        title=title or f"Place recognition on {dataset_name}",
        winner=winner(evaluations, protocol),
        notes=[*notes, *_remarks(evaluations, [*missed])],
        summary=summary_table(evaluations, protocol),
        compared=comparison_table(compared, protocol) if len(compared) > 1 else None,
        costs=picture,
        sources=sources,
        judged=next((curve for curve in judged if curve), None),
        rules=COMMON_RULES,
        protocols=PROTOCOLS.values(),
        citation=CITATION if any(e.published for e in evaluations) else None,
        peers=peers_table(evaluations, protocol),
        peer_sources=list(dict.fromkeys(p.source for e in evaluations for p in e.peers)),
        frames=counted(max(len(e.run) for e in evaluations), "frame"),
        drive_map=drive_map,
        map_page=MAP_PAGE,
    )


def _check(evaluations: Sequence[Evaluation], protocol: str) -> None:
    runs = [evaluation.run for evaluation in evaluations]
    labels = [f"{run.source} / {run.name}" for run in runs]
    check_runs(runs, labels, labels)
    check_judged(evaluations, protocol)


def _remarks(evaluations: Sequence[Evaluation], missed: Sequence[str]) -> Iterator[str]:
    """Yield remarks on what the report lacks and why."""
    skipped = {number: why for e in evaluations for number, why in e.run.skipped.items()}
    if skipped:
        frames = ", ".join(f"{number} ({why})" for number, why in sorted(skipped.items()))
        yield f"{counted(len(skipped), 'frame')} that cannot be described left out: {frames}."
    if missed:
        yield f"Pictures of frames are missing: {missed[0]}."
