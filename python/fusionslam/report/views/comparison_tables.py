# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables that compare view recognition methods: for terminals, as Markdown and as JSON."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from fusionslam.base.archive import save_json
from fusionslam.base.files import write_file
from fusionslam.evaluation import RERUN_CITATION, VIEW_CITATION, rerun_views
from fusionslam.pipelines.compare_views import ViewResult
from fusionslam.pipelines.drives import FRAMES
from fusionslam.report.page.tables import Table, build_table, columns_of

FORMAT = "fusionslam.view_bench.1"

LEGEND = (
    "acc.: accuracy by the paper's rule, author: by the author's (72 and 7.2 degrees), thesis: as "
    "published (author's rule, world coordinates), re-run: the originals measured again (paper's "
    "rule), in %. loop R, loop P: loop recall and loop precision, in %. FP m, max: distances of "
    "false positives. bytes: of a view as stored. build, match: mean ms a scan, to make a view and "
    "to compare it with all stored ones; pair: with one of them."
)


def groups(results: Sequence[ViewResult]) -> list[tuple[str, list[ViewResult]]]:
    """Group the results by drive and frame, with a heading each."""
    found = groupby(results, key=lambda result: (result.drive, result.frame, result.scans))
    return [
        (f"{drive}, {frame}: {scans} scans", list(rows)) for (drive, frame, scans), rows in found
    ]


def accuracy_table(results: Sequence[ViewResult]) -> Table:
    """One row per method: its recognition and published figures; fits 80 columns."""
    return build_table(
        columns_of("views_bench.accuracy"), results, [result.title for result in results]
    )


def cost_table(results: Sequence[ViewResult]) -> Table:
    """One row per method: bytes and milliseconds, and published figures."""
    return build_table(
        columns_of("views_bench.costs"), results, [result.title for result in results]
    )


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
        left_out = "Every scan holds something above the floor."
        if count := dropped[drive]:
            left_out = (
                f"{count} more scans hold nothing above the floor and are left out of every row."
            )
        parts.append(f"{FRAMES[frame].capitalize()}. {left_out}")
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
    write_file(folder / "views.md", "# Ways to recognise views\n\n" + markdown(results, dropped))
    content = {
        **about,
        "scans_left_out": dict(dropped),
        "results": [as_json(result) for result in results],
    }
    save_json(folder / "views_bench.json", FORMAT, content, indent=2)


def as_json(result: ViewResult) -> dict[str, Any]:
    """Collect every figure of a result; undefined ones are null."""
    measured = ("threshold", "bytes_per_view", "build_ms", "match_ms", "pair_ms")
    named = ("drive", "frame", "method", "title", "scans", "note")
    return {
        **{name: getattr(result, name) for name in named},
        "paper": result.paper and result.paper.metrics(),
        "author": result.author and result.author.metrics(),
        **{name: getattr(result.run, name, None) for name in measured},
        "config": result.run.config if result.run else {},
        "published": result.published and vars(result.published),
        "rerun": result.rerun and vars(result.rerun),
    }


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
