# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables that compare view recognition methods: for terminals, as Markdown and as JSON."""

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.evaluation import (
    RERUN_CITATION,
    VIEW_CITATION,
    ViewReport,
    rerun_views,
)
from fusionslam.pipelines.compare_views import ViewResult
from fusionslam.pipelines.drives import FRAMES
from fusionslam.report.page.tables import Column, Table, build_table
from fusionslam.storage.archive import save_json
from fusionslam.storage.files import atomic_path

FORMAT = "fusionslam.view_bench.1"
Value = Callable[[ViewResult], float | None]
Group = tuple[str, list[ViewResult]]

LEGEND = (
    "acc.: accuracy by the paper's rule, author: by the author's (72 and 7.2 degrees), thesis: as "
    "published (author's rule, world coordinates), re-run: the originals measured again (paper's "
    "rule), in %. loop R, loop P: loop recall and loop precision, in %. FP m, max: distances of "
    "false positives. bytes: of a view as stored. build, match: mean ms a scan, to make a view and "
    "to compare it with all stored ones; pair: with one of them."
)


def groups(results: Sequence[ViewResult]) -> list[Group]:
    """Group the results by drive and frame, with a heading each."""
    found = groupby(results, key=lambda result: (result.drive, result.frame, result.scans))
    return [
        (f"{drive}, {frame}: {scans} scans", list(rows)) for (drive, frame, scans), rows in found
    ]


def accuracy_table(results: Sequence[ViewResult]) -> Table:
    """One row per method: its recognition and published figures; fits 80 columns."""
    return build_table(_accuracy_columns(), results, _label)


def cost_table(results: Sequence[ViewResult]) -> Table:
    """One row per method: bytes and milliseconds, and published figures."""
    return build_table(_cost_columns(), results, _label)


def notes(results: Sequence[ViewResult]) -> list[str]:
    """List the reasons for empty rows, one line each."""
    lines = (f"{r.drive}: {r.title}: {r.note}" for r in results if r.note)
    return list(dict.fromkeys(lines))


def markdown(results: Sequence[ViewResult], dropped: Mapping[str, int]) -> str:
    """Format all tables as Markdown.

    Args:
        results: in order of drive, frame and method.
        dropped: number of scans left out because nothing is above the floor, by drive.
    """
    parts = [LEGEND]
    for heading, rows in groups(results):
        frame, drive = rows[0].frame, rows[0].drive
        parts.append(f"## {heading}")
        parts.append(f"{FRAMES[frame].capitalize()}. {_dropped(dropped[drive])}")
        parts += [accuracy_table(rows).markdown(), cost_table(rows).markdown()]
        parts += _elsewhere(rows)
    lines = notes(results)
    if lines:
        parts.append("\n".join(f"- {line}" for line in lines))
    parts.append(f"Thesis: {VIEW_CITATION}.\nRe-run: {RERUN_CITATION}.")
    return "\n\n".join(parts) + "\n"


def write_view_bench(
    folder: Path,
    results: Sequence[ViewResult],
    dropped: Mapping[str, int],
    about: Mapping[str, Any],
) -> None:
    """Write ``views.md`` and ``views_bench.json``. Raises DataError.

    Args:
        folder: created if missing.
        results, dropped: as for ``markdown``.
        about: command, versions and machine.
    """
    with atomic_path(folder / "views.md") as temporary:
        temporary.write_text(
            "# Ways to recognise views\n\n" + markdown(results, dropped), encoding="utf-8"
        )
    content = {
        **about,
        "scans_left_out": dict(dropped),
        "results": [as_json(result) for result in results],
    }
    save_json(folder / "views_bench.json", FORMAT, content, indent=2)


def as_json(result: ViewResult) -> dict[str, Any]:
    """Collect every figure of a result; undefined ones are null."""
    run = result.run
    return {
        "drive": result.drive,
        "frame": result.frame,
        "method": result.method,
        "title": result.title,
        "scans": result.scans,
        "note": result.note,
        "paper": result.paper and result.paper.metrics(),
        "author": result.author and result.author.metrics(),
        "threshold": run.threshold if run else None,
        "bytes_per_view": run.bytes_per_view if run else None,
        "build_ms": _ms("build_seconds")(result),
        "match_ms": _ms("match_seconds")(result),
        "pair_ms": _ms("pair_seconds")(result),
        "config": run.config if run else {},
        "published": result.published and vars(result.published),
        "rerun": result.rerun and vars(result.rerun),
    }


def _label(result: ViewResult) -> str:
    return result.title


def _dropped(count: int) -> str:
    if not count:
        return "Every scan holds something above the floor."
    return f"{count} more scans hold nothing above the floor and are left out of every row."


def _accuracy_columns() -> list[Column[ViewResult]]:
    return [
        Column("acc.", "accuracy, paper's rule, %", _of("paper", "accuracy", 100), "{:.1f}"),
        Column("author", "accuracy, author's rule, %", _of("author", "accuracy", 100), "{:.1f}"),
        Column("thesis", "accuracy as published, %", _published("accuracy", 100), "{:.1f}"),
        Column("re-run", "accuracy measured again, %", _rerun("accuracy"), "{:.1f}"),
        Column("loop R", "loop recall, %", _of("paper", "loop_recall", 100), "{:.1f}", max),
        Column("re-run", "loop recall measured again, %", _rerun("loop_recall"), "{:.0f}"),
        Column("loop P", "loop precision, %", _of("paper", "loop_precision", 100), "{:.1f}", max),
        Column(
            "FP m", "false positives, mean", _of("paper", "mean_false_positive_distance"), "{:.2f}"
        ),
        Column("max", "the farthest", _of("paper", "max_false_positive_distance"), "{:.2f}"),
    ]


def _cost_columns() -> list[Column[ViewResult]]:
    return [
        Column("views", "stored", _of("paper", "views"), "{:.0f}"),
        Column("thesis", "as published", _published("views"), "{:.0f}"),
        Column("bytes", "of a view", lambda r: r.run and r.run.bytes_per_view, "{:.0f}", min),
        Column("thesis", "as published", _published("view_bytes"), "{:.0f}"),
        Column("build", "ms to make a view, mean", _ms("build_seconds"), "{:.1f}", min),
        Column("thesis", "as published, ms", _published("build_ms"), "{:.1f}"),
        Column("match", "ms against all stored views, mean", _ms("match_seconds"), "{:.3f}", min),
        Column("pair", "ms against one of them, mean", _ms("pair_seconds"), "{:.4f}"),
        Column("thesis", "as published, ms", _published("match_ms"), "{:.3f}"),
    ]


def _of(rule: str, name: str, scale: float = 1) -> Value:
    def value(result: ViewResult) -> float | None:
        report: ViewReport | None = getattr(result, rule)
        found = None if report is None else getattr(report, name)
        return None if found is None else found * scale

    return value


def _published(name: str, scale: float = 1) -> Value:
    return lambda r: None if r.published is None else getattr(r.published, name) * scale


def _rerun(name: str) -> Value:
    def value(result: ViewResult) -> float | None:
        found = None if result.rerun is None else getattr(result.rerun, name)
        return None if found is None else found * 100

    return value


def _ms(name: str) -> Value:
    def value(result: ViewResult) -> float | None:
        spent = None if result.run is None else getattr(result.run, name)
        known = np.empty(0) if spent is None else spent[np.isfinite(spent)]
        return float(known.mean() * 1e3) if known.size else None

    return value


def _elsewhere(rows: Sequence[ViewResult]) -> list[str]:
    """List figures measured again in the same world that no row contains."""
    world = next((found.world for r in rows if (found := r.published or r.rerun)), "")
    beside = {r.rerun.input for r in rows if r.rerun}
    others = [figures for figures in rerun_views(world) if figures.input not in beside]
    if not others:
        return []
    lines = [
        f"- {figures.input}: accuracy {100 * figures.accuracy:.1f} %"
        + (f", loop recall {100 * figures.loop_recall:.0f} %" if figures.loop_recall else "")
        for figures in others
    ]
    return ["Measured again there, too:\n" + "\n".join(lines)]
