# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the report: the page, its pictures and the files beside it."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.base.csv_files import write_csv
from fusionslam.base.texts import counted
from fusionslam.datasets.pose_files import write_poses_tum
from fusionslam.evaluation import (
    CITATION,
    COMMON_RULES,
    PROTOCOLS,
    DescriptorRun,
    Evaluation,
    LoopRun,
    PrecisionRecall,
    VerifiedRun,
)
from fusionslam.evaluation.loops.evaluation import check_judged
from fusionslam.evaluation.loops.protocols import DEFAULTS
from fusionslam.report.loops.comparison import (
    comparison_table,
    draw_costs,
    pair_up,
    write_comparison,
)
from fusionslam.report.loops.exports import MATCH_COLUMNS, list_matches, metrics_of
from fusionslam.report.loops.frame_pairs import (
    CloudReader,
    ImageReader,
    ScanReader,
    draw_overlay,
    draw_pair,
)
from fusionslam.report.loops.labels import (
    best_of,
    by_rank,
    run_file,
    run_label,
    short_labels,
    winner,
)
from fusionslam.report.loops.outcomes import nearest_of, telling_loops, telling_pairs
from fusionslam.report.loops.plots import draw_curves, draw_distances, draw_trajectory
from fusionslam.report.loops.tables import peers_table, reasons_table, summary_table, time_table
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import (
    about_report,
    check_extra,
    check_runs,
    write_figures,
    write_page,
)
from fusionslam.report.page.images import Picture, forgive, keep
from fusionslam.report.place_maps import MapLead

MAP_PAGE = "map.html"
"""Page of the map of the same drive, beside the report."""
_PAIR_TEXTS = {
    "best": "Closest correct match",
    "worst": "Closest false match",
    "missed": "Missed revisit, with the earlier place it should have found",
}
_LOOP_TEXTS = {
    "probable": "Most probable loop",
    "improbable": "Least probable loop",
    "opposite": "Loop in the opposite direction",
    "wrong": "Wrong loop",
}


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
    runs = [evaluation.run for evaluation in evaluations]
    labels = [f"{run.source} / {run.name}" for run in runs]
    check_runs(runs, labels, labels)
    check_judged(evaluations, protocol)
    target = Path(folder)
    groups = by_rank(evaluations, protocol)
    evaluations = [evaluation for group in groups.values() for evaluation in group]
    missed: dict[str, None] = {}
    # A frame may be in several pairs, and all sections of a source show the same frames.
    readers = cache(forgive(clouds, missed)), cache(forgive(images, missed))
    scan_reader = cache(forgive(scans, missed))
    context = _Context(target, protocol, *readers, scan_reader)
    about = about_report(dataset_name, command, config)
    with use_style():
        sources = [context.source_part(name, group) for name, group in groups.items()]
        compared = pair_up(evaluations)
        costs = draw_costs([compared], protocol) if len(compared) > 1 else None
        picture = keep(target, "accuracy_cost", costs, vector=True)
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


def _remarks(evaluations: Sequence[Evaluation], missed: Sequence[str]) -> Iterator[str]:
    """Yield remarks on what the report lacks and why."""
    skipped = {number: why for e in evaluations for number, why in e.run.skipped.items()}
    if skipped:
        frames = ", ".join(f"{number} ({why})" for number, why in sorted(skipped.items()))
        yield f"{counted(len(skipped), 'frame')} that cannot be described left out: {frames}."
    if missed:
        yield f"Pictures of frames are missing: {missed[0]}."


@dataclass(frozen=True)
class _Context:
    """Folder of the pictures, protocol that judges the loops, and readers of frames."""

    folder: Path
    protocol: str
    clouds: CloudReader
    images: ImageReader
    scans: ScanReader

    def source_part(self, name: str, evaluations: Sequence[Evaluation]) -> dict[str, Any]:
        """Draw everything known about the evaluations of the source called ``name``.

        Returns:
            A source as ``loops.html.j2`` shows it; pictures that would be empty are None.
        """
        source = evaluations[0].run.source
        best = best_of(evaluations, self.protocol)
        labels = short_labels([e.run for e in evaluations])
        curves = {n: e.curves.get(self.protocol) for n, e in zip(labels, evaluations, strict=True)}
        defined = {name: c for name, c in curves.items() if c and c.average_precision is not None}
        figure = draw_curves(defined) if defined else None
        return {
            "source": source,
            "name": name,
            "curves": keep(self.folder, f"pr_{source}", figure, vector=True),
            "times": time_table(evaluations),
            "descriptors": [self._descriptor_part(e, best=e is best) for e in evaluations],
        }

    def _descriptor_part(self, evaluation: Evaluation, *, best: bool) -> dict[str, Any]:
        run, curve = evaluation.run, evaluation.query_curves.get(self.protocol)
        proven = run if isinstance(run, VerifiedRun) else None
        # Without revisits neither path nor distances have anything to show.
        empty = curve is not None and not curve.n_revisits
        path = draw_trajectory(run, curve) if curve and not empty else None
        distances = None
        if isinstance(run, DescriptorRun) and not empty:
            distances = draw_distances(run, evaluation.window, curve.radius if curve else None)
        return {
            "name": run_label(run),
            "best": best,
            "loops": self._describe_loops(evaluation, curve),
            "verified": proven is not None,
            "curve": curve,
            "window": evaluation.window,
            "trajectory": keep(self.folder, f"trajectory_{run_file(run)}", path),
            "distances": keep(self.folder, f"distances_{run_file(run)}", distances),
            "empty": empty,
            "pairs": self._draw_pairs(run, curve) if curve else [],
            "overlays": self._draw_overlays(proven, curve) if proven else [],
            "reasons": reasons_table(proven) if proven else None,
        }

    def _describe_loops(self, evaluation: Evaluation, curve: PrecisionRecall | None) -> str:
        if curve is not None:
            found = evaluation.accepted.get(self.protocol)
            if found is not None:
                return (
                    f"{counted(curve.n_queries, 'query')}, {curve.n_revisits} of them revisits: "
                    f"{counted(found.loops, 'loop')} accepted, {found.wrong} of them wrong."
                )
            revisits = f"{curve.n_revisits} of them revisits" if curve.n_revisits else "no revisit"
            return f"{curve.explain(curve.max_f1_threshold)} ({revisits})."
        nearest = nearest_of(evaluation, self.protocol)
        if nearest is None:
            return "No ground truth and no search: there are no loops to show."
        listed = int((nearest[0] >= 0).sum())
        unjudged = f"matches.csv lists the nearest candidates of {listed} frames, unjudged."
        pairs = evaluation.curves.get(self.protocol)
        if pairs is not None:
            return f"{pairs.counts}: these are judged. {unjudged}"
        if isinstance(evaluation.run, VerifiedRun):
            loops = f"{counted(int(evaluation.run.accepted.sum()), 'loop')} accepted, unjudged"
            return f"No ground truth: {loops}; matches.csv lists {listed} matches."
        return f"No ground truth: {unjudged}"

    def _draw_overlays(self, run: VerifiedRun, curve: PrecisionRecall | None) -> list[Picture]:
        pictures = []
        for query, kind in telling_loops(run, curve).items():
            apart = np.linalg.norm(run.match_from_query[query, :3, 3])
            caption = (
                f"{_LOOP_TEXTS[kind]}: frames {run.numbers[query]} and "
                f"{run.numbers[run.match[query]]}, overlap {run.overlap[query]:.2f}, probability "
                f"{run.probability[query]:.4g}, {apart:.1f} m apart. Points above the ground, from "
                "above: left as if both frames had been recorded at one place, right with the "
                "loop's pose."
            )
            name = f"registered_{run_file(run)}_{run.numbers[query]}"
            figure = draw_overlay(run, query, self.scans)
            pictures.append(keep(self.folder, name, figure, caption, photo=True))
        return [picture for picture in pictures if picture]

    def _draw_pairs(self, run: LoopRun, curve: PrecisionRecall) -> list[Picture]:
        pictures = []
        for pair in telling_pairs(run, curve):
            how_alike = f"descriptors {pair.distance:.4g} apart, "
            if isinstance(run, VerifiedRun):
                known = np.isfinite(pair.distance)
                how_alike = f"probability {1 - pair.distance:.4g}, " if known else ""
            caption = (
                f"{_PAIR_TEXTS[pair.kind]}: {how_alike}places {pair.metres:.1f} m apart. Clouds "
                "from above, both at one scale."
            )
            name = f"pairs_{run_file(run)}_{pair.kind}"
            figure = draw_pair(run, pair, self.clouds, self.images)
            pictures.append(keep(self.folder, name, figure, caption, photo=True))
        return [picture for picture in pictures if picture]
