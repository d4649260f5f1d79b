# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of the report of maps: figures against dead reckoning, costs, loops one by one."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusionslam.evaluation import MapReport, PoseErrors
from fusionslam.ratslam.actions import ActionKind
from fusionslam.ratslam.run_record import RatSlamRun
from fusionslam.report.ratslam_scene import Scene, offs, steps_at
from fusionslam.report.tables import Cell, Column, Table, filled

MOST = 100
"""Rows of a table of single events that a page shows."""
_NONE = "\N{EN DASH}"

Best = Callable[[Sequence[float]], float]


@dataclass(frozen=True)
class MapRow:
    """What stands in a row of the table of figures: a map, or the odometry that it was made of."""

    label: str
    nodes: PoseErrors | None
    path: PoseErrors | None
    live: PoseErrors | None
    report: MapReport | None = None


def map_table(labels: Sequence[str], reports: Sequence[MapReport]) -> Table:
    """Every map, and every odometry that maps were made of as dead reckoning."""
    rows = [
        MapRow(f"dead reckoning, odometry {name}", *known) for name, known in _odometry(reports)
    ]
    for label, one in zip(labels, reports, strict=True):
        rows.append(MapRow(label, one.nodes, one.trajectory, one.live, one))
    columns = _error_columns() if any(row.path for row in rows) else []
    return filled([*columns, *_map_columns(bool(columns))], rows, lambda row: row.label)


def _odometry(
    reports: Sequence[MapReport],
) -> list[tuple[str, tuple[PoseErrors | None, PoseErrors | None, PoseErrors | None]]]:
    """Dead reckoning under each name of an odometry: when nodes were made, always, always."""
    first: dict[str, MapReport] = {}
    for report in reports:
        if report.dead_reckoning is not None:
            first.setdefault(report.odometry, report)
    return [
        (name, (one.nodes_by_odometry, one.dead_reckoning, one.dead_reckoning))
        for name, one in first.items()
    ]


def _error_columns() -> list[Column[MapRow]]:
    def of(part: str, figure: str) -> Callable[[MapRow], float | None]:
        return lambda row: getattr(getattr(row, part), figure, None)

    nodes = "nodes in the end against where the robot truly was when it made them, RMSE"
    path = "every step on the map as it is in the end, RMSE (absolute trajectory error)"
    return [
        Column("nodes m", nodes, of("nodes", "rmse_m"), "{:.3f}", min),
        Column("path m", path, of("path", "rmse_m"), "{:.3f}", min),
        Column("max m", "the largest error of a step", of("path", "max_m"), "{:.3f}", min),
        Column("heading deg", "of every step, RMSE", of("path", "heading_rmse_deg"), "{:.2f}", min),
        Column(
            "live m", "every step as the map was then, RMSE", of("live", "rmse_m"), "{:.3f}", min
        ),
    ]


def _map_columns(judged: bool) -> list[Column[MapRow]]:
    topology = [
        _of(
            "near_loop_link_share",
            "right loops",
            "links of loops that join places near each other",
            "{:.1%}",
            max,
        ),
        _of(
            "linked_revisit_share",
            "linked revisits",
            "looks from where an older look was that the map joins with it",
            "{:.1%}",
            max,
        ),
        _of(
            "false_loops",
            "false arrivals",
            "arrivals at a known node while the robot was elsewhere",
            "{:.0f}",
            min,
        ),
        _of("refused_true", "wrongly refused", "refused loops that were right", "{:.0f}"),
    ]
    counts = [
        _of("loop_links", "loops", "links made by an arrival at a known node", "{:.0f}"),
        _of("loops", "arrivals", "arrivals at a known node", "{:.0f}"),
        _of("refused", "refused", "loops that did not fit the odometry", "{:.0f}"),
        _of("node_count", "nodes", "of the map in the end", "{:.0f}"),
        _of("link_count", "links", "of the map in the end", "{:.0f}"),
    ]
    return [*topology, *counts] if judged else counts[1:]


def _of(name: str, title: str, hint: str, show: str, best: Best | None = None) -> Column[MapRow]:
    return Column(title, hint, lambda row: getattr(row.report, name, None), show, best)


def cost_table(labels: Sequence[str], runs: Sequence[RatSlamRun]) -> Table | None:
    """What steps took; None where nothing was timed."""
    if not any((run.step_seconds > 0).any() for run in runs):
        return None
    named = list(zip(labels, runs, strict=True))

    def column(title: str, hint: str, value: Callable[[RatSlamRun], float | None]) -> Any:
        return Column(title, hint, lambda pair: value(pair[1]), "{:.3g}")

    columns = [
        column("looking ms", "to recognise a view, median of the looks", lambda r: _ms(r, 0)),
        column("pose cells ms", "median of the steps", lambda r: _ms(r, 1)),
        column("map ms", "median of the steps that change it", lambda r: _ms(r, 2)),
        column("all ms", "median step, all together", lambda r: _ms(r)),
        column("p95 ms", "all together, 95th percentile", lambda r: _ms(r, share=95)),
        column("times real time", "how much faster than the data come in", _speed),
    ]
    return filled(columns, named, lambda pair: pair[0])


def _ms(run: RatSlamRun, stage: int | None = None, share: float = 50) -> float | None:
    """A percentile of what those steps took that had something to do; None of nothing."""
    if stage is None:
        times = run.step_seconds.sum(axis=1)
    else:
        busy = (run.is_view, np.ones(len(run), bool), run.actions[:, 0] != ActionKind.NONE)[stage]
        times = run.step_seconds[busy, stage]
    return float(np.percentile(times, share) * 1e3) if times.any() else None


def _speed(run: RatSlamRun) -> float | None:
    spent = float(run.step_seconds.sum())
    return float(run.seconds[-1]) / spent if spent > 0 and run.seconds[-1] > 0 else None


def loop_table(scene: Scene) -> Table | None:
    """When loops were closed, between which nodes, and whether rightly; None without a loop."""
    rows = np.flatnonzero(scene.loops)
    if not rows.size:
        return None
    rows = rows[np.argsort(scene.made[rows], kind="stable")][:MOST]
    run, links = scene.run, scene.run.links[rows]
    metres, degrees = offs(run, scene.made[rows], links["target"])
    verdicts = np.where(scene.false[rows], "false", "right")
    heads = [
        ("from node", "where the robot was last"),
        ("to node", "where it arrived"),
        ("metres off", "the true place of the robot from where the node was made"),
        ("degrees off", "the same of its heading"),
        ("", "by the view radius"),
    ]
    events = zip(run.seconds[scene.made[rows]], links, metres, degrees, verdicts, strict=True)
    return Table(
        heads,
        [
            _event(s, link, (m, "{:.2f}"), (d, "{:.0f}"), "" if np.isnan(m) else verdict)
            for s, link, m, d, verdict in events
        ],
    )


def refused_table(run: RatSlamRun) -> Table | None:
    """Loops that were refused, with what did not fit; None if there are none."""
    refused = run.refused[:MOST]
    if not len(refused):
        return None
    steps = steps_at(run, refused["stamp_ns"])
    metres, degrees = offs(run, steps, refused["target"])
    heads = [
        ("from node", "where the robot was last"),
        ("to node", "which it was not allowed to arrive at"),
        ("misfit m", "between the loop and the odometry"),
        ("allowed m", "what the odometry may be off by"),
        ("misfit deg", "the same of the heading"),
        ("allowed deg", "the same of the heading"),
        ("metres off", "the true place of the robot from where the node was made"),
        ("degrees off", "the same of its heading"),
    ]
    shown = []
    for one, m, d in zip(refused, metres, degrees, strict=True):
        seconds = (one["stamp_ns"] - run.stamps_ns[0]) / 1e9
        angles = np.degrees([one["error_rad"], one["allowed_rad"]])
        fits = [(one["error_m"], "{:.2f}"), (one["allowed_m"], "{:.2f}")]
        fits += [(angle, "{:.1f}") for angle in angles]
        shown.append(_event(seconds, one, *fits, (m, "{:.2f}"), (d, "{:.0f}")))
    return Table(heads, shown)


def _event(seconds: float, link: Any, *figures: tuple[float, str] | str) -> tuple[str, list[Cell]]:
    """A row: when, from which node to which, and numbers, a dash for those that are not known."""
    cells = [Cell(str(link["source"])), Cell(str(link["target"]))]
    for figure in figures:
        if isinstance(figure, str):
            cells.append(Cell(figure))
        else:
            value, show = figure
            cells.append(Cell(show.format(value) if np.isfinite(value) else _NONE))
    return f"{seconds:.1f} s", cells


def reason_table(run: RatSlamRun) -> Table | None:
    """What was said of views, numbers left out, most frequent first; None without a view."""
    said = Counter(re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", sentence) for sentence in run.why)
    if not said:
        return None
    rows = [(sentence, [Cell(str(count))]) for sentence, count in said.most_common(20)]
    return Table([("views", "how many")], rows)
