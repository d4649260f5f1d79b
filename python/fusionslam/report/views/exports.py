# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The files beside the report of views, and the data of the page's frame slider."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fusionslam.evaluation import ViewReport, ViewRun, baselines, judge_views
from fusionslam.report.views.plots import path_pieces
from fusionslam.report.views.previews import counterparts, list_needed_rows, select_rows, stamp_key

COLUMNS = (
    "world",
    "method",
    "scan",
    "stamp",
    "id",
    "similarity",
    "view_scan",
    "metres",
    "degrees",
    "verdict",
    "revisit",
    "loop",
)


def verdict(report: ViewReport, row: int) -> str:
    """Describe the judgement of a scan in a few words."""
    if report.false_positive[row]:
        return "false positive"
    if report.false_negative[row]:
        return "false negative"
    if report.ids[row] < 0:
        return "no view"
    return "known" if report.matched[row] >= 0 else "new"


def loop_word(report: ViewReport, row: int) -> str:
    """Describe a scan as a loop in a few words; empty if there is none to close."""
    if report.loop[row]:
        return "right loop" if report.loop_correct[row] else "wrong loop"
    return "missed revisit" if report.revisit[row] else ""


def metrics_of(run: ViewRun, report: ViewReport) -> dict[str, Any]:
    without = {
        name: judge_views(ids, run.poses, run.stamps, rule=report.rule).metrics()
        for name, ids in baselines(len(run)).items()
    }
    return {
        "world": run.world,
        "method": run.method,
        "threshold": run.threshold,
        **report.metrics(),
        "bytes_per_view": run.bytes_per_view,
        "baselines": without,
        "curve": run.curve.as_json() if run.curve else None,
        "config": run.config,
    }


def list_scans(run: ViewRun, report: ViewReport) -> Iterator[tuple[object, ...]]:
    """Yield one row per scan, as COLUMNS."""
    for row in range(len(run)):
        matched = int(report.matched[row])
        known = matched >= 0
        yield (
            run.world,
            run.method,
            run.numbers[row],
            f"{run.stamps[row]:.9f}",
            report.ids[row],
            _format_similarity(run, row, "{:.6f}") or "",
            run.numbers[matched] if known else "",
            f"{report.distances[row]:.3f}" if known else "",
            f"{report.angles[row]:.2f}" if known else "",
            verdict(report, row),
            int(report.revisit[row]),
            loop_word(report, row) if report.loop[row] else "",
        )


def scrub_data(run: ViewRun, report: ViewReport, previews: Mapping[int, bytes]) -> dict[str, Any]:
    """Collect the data of the frame slider for one run, in types that JSON can hold.

    ``frames`` are the scans that the page can show. ``i`` of each is its index in ``places``,
    which lists every scan to be drawn; ``v`` is the index of the scan shown beside it
    (``counterparts``), or -1.
    """
    rows = list_needed_rows(run, report)
    where = {row: place for place, row in enumerate(rows)}
    beside = counterparts(run, report)
    keys = {row: stamp_key(run.stamps[row]) for row in rows}
    places = [
        {
            "n": int(run.numbers[row]),
            "t": round(float(run.stamps[row] - run.stamps[0]), 2),
            "p": np.round(run.poses[row], 3).tolist(),
            "k": str(keys[row]) if keys[row] in previews else None,
        }
        for row in rows
    ]
    return {
        "method": run.method,
        "path": [np.round(piece, 2).tolist() for piece in path_pieces(run)],
        "places": places,
        "frames": [
            {"i": where[row], "v": where.get(int(beside[row]), -1), **_judgement(run, report, row)}
            for row in select_rows(report)
        ],
    }


def _judgement(run: ViewRun, report: ViewReport, row: int) -> dict[str, Any]:
    known = report.matched[row] >= 0
    wrongly_new = "negative" if report.false_negative[row] else None
    return {
        "id": int(report.ids[row]),
        "s": _format_similarity(run, row, "{:.3f}"),
        "d": f"{report.distances[row]:.2f} m, {report.angles[row]:.0f}°" if known else None,
        "w": verdict(report, row),
        "false": "positive" if report.false_positive[row] else wrongly_new,
        "l": loop_word(report, row),
        "right": bool(report.loop_correct[row]) if report.loop[row] else None,
    }


def _format_similarity(run: ViewRun, row: int, show: str) -> str | None:
    known = run.similarities is not None and np.isfinite(run.similarities[row])
    return show.format(run.similarities[row]) if known else None  # type: ignore[index]
