# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the report of maps: errors against dead reckoning, and single loops."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusionslam._core import ActionKind
from fusionslam.evaluation import MapReport, PoseErrors
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.report.maps.aligned_run import Scene, denied, link_misfits, near, offs
from fusionslam.report.page.tables import Cell, Column, Table, build_table
from fusionslam.storage.arrays import Integers, Mask

MOST = 100
"""Largest number of rows in a table of single events."""
REFUSALS = ("linked later", "false: prevented", "right: lost")
"""Verdicts on refused loops: confirmed by later loops, or kept out of the map."""
_NONE = "\N{EN DASH}"
_EFFECTS = {
    ActionKind.NONE: "",
    ActionKind.CREATE_NODE: "node made",
    ActionKind.CREATE_EDGE: "arrival at a known node",
}

Best = Callable[[Sequence[float]], float]
Named = tuple[str, Scene]


@dataclass(frozen=True)
class MapRow:
    """A row of the table of errors: a map, or the odometry that it was made from."""

    label: str
    nodes: PoseErrors | None
    path: PoseErrors | None
    live: PoseErrors | None


def error_table(labels: Sequence[str], reports: Sequence[MapReport]) -> Table | None:
    """Build the table of errors of every map and every odometry; None without ground truth."""
    rows = [MapRow(f"dead reckoning: {name}", *known) for name, known in _odometry(reports)]
    for label, one in zip(labels, reports, strict=True):
        rows.append(MapRow(label, one.nodes, one.trajectory, one.live))
    if not any(row.path for row in rows):
        return None
    return build_table(_error_columns(), rows, lambda row: row.label)


def _odometry(
    reports: Sequence[MapReport],
) -> list[tuple[str, tuple[PoseErrors | None, PoseErrors | None, PoseErrors | None]]]:
    """Dead reckoning by odometry name: errors at node creation, at all steps, at all steps."""
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
        Column("nodes, m", nodes, of("nodes", "rmse_m"), "{:.3f}", min),
        Column("path, m", path, of("path", "rmse_m"), "{:.3f}", min),
        Column(
            "path, largest m", "the largest error of a step", of("path", "max_m"), "{:.3f}", min
        ),
        Column(
            "heading, deg", "of every step, RMSE", of("path", "heading_rmse_deg"), "{:.2f}", min
        ),
        Column(
            "live, m", "every step as the map was then, RMSE", of("live", "rmse_m"), "{:.3f}", min
        ),
    ]


def joins_table(labels: Sequence[str], scenes: Sequence[Scene]) -> Table:
    """Build the table of each map's size, its links, and how well they fit together."""
    columns = _map_columns()
    if any(scene.report.near_links is not None for scene in scenes):
        columns = [*_truth_columns(), *columns]
    return build_table(columns, list(zip(labels, scenes, strict=True)), lambda pair: pair[0])


def _truth_columns() -> list[Column[Named]]:
    near = "links of loops that join places near each other"
    linked = "looks from where an older look was that the map joins with it"
    false = "arrivals at a known node while the robot was elsewhere"
    return [
        _of("near_loop_link_share", "right loops", near, "{:.1%}", max),
        _of("linked_revisit_share", "linked revisits", linked, "{:.1%}", max),
        _of("false_loops", "false arrivals", false, "{:.0f}", min),
        _of("refused_true", "wrongly refused", "refused loops that were right", "{:.0f}", min),
    ]


def _map_columns() -> list[Column[Named]]:
    made = "links made by an arrival at a known node"
    misfit = "where links say their targets are, against the map in the end, RMS: what is left"
    return [
        Column("loops", made, lambda pair: float(pair[1].loops.sum()), "{:.0f}"),
        _of("loops", "arrivals", "arrivals at a known node", "{:.0f}"),
        _of("refused", "refused", "loops that did not fit the odometry", "{:.0f}"),
        _of("node_count", "nodes", "of the map in the end", "{:.0f}"),
        _of("link_count", "links", "of the map in the end", "{:.0f}"),
        Column("misfit of links, m", misfit, lambda pair: _misfit(pair[1]), "{:.3f}"),
    ]


def _misfit(scene: Scene) -> float | None:
    apart = link_misfits(scene.run)
    return float(np.sqrt((apart**2).mean())) if apart.size else None


def _of(name: str, title: str, hint: str, show: str, best: Best | None = None) -> Column[Named]:
    return Column(title, hint, lambda pair: getattr(pair[1].report, name), show, best)


def loop_table(scene: Scene) -> Table | None:
    """Build the table of closed loops: time, nodes, and verdict; None without a loop."""
    rows = np.flatnonzero(scene.loops)
    if not rows.size:
        return None
    rows = rows[np.argsort(scene.made[rows], kind="stable")][:MOST]
    run, links = scene.run, scene.run.links[rows]
    metres, degrees = offs(run, scene.made[rows], links["target"])
    refused = run.actions[scene.made[rows], 0] != ActionKind.CREATE_EDGE
    verdicts = np.where(scene.false[rows], "false", "right").astype(object)
    verdicts[np.isnan(metres)] = _NONE
    verdicts[refused] += ", refused at first"
    heads = [
        ("from node", "where the robot was last"),
        ("to node", "where it arrived"),
        ("metres off", "the true place of the robot from where the node was made"),
        ("degrees off", "the same of its heading"),
        ("verdict", "by the view radius"),
    ]
    events = zip(run.seconds[scene.made[rows]], links, metres, degrees, verdicts, strict=True)
    return Table(
        heads,
        [
            _event(s, link, (m, "{:.2f}"), (d, "{:.0f}"), verdict)
            for s, link, m, d, verdict in events
        ],
    )


def refused_table(scene: Scene) -> Table | None:
    """Build the table of refused loops with their misfit; None if there are none."""
    run, refused = scene.run, scene.run.refused[:MOST]
    if not len(refused):
        return None
    metres, degrees = offs(run, run.steps_at(refused["stamp_ns"]), refused["target"])
    heads = [
        ("from node", "where the robot was last"),
        ("to node", "which it was not allowed to arrive at"),
        ("misfit m", "between the loop and the odometry"),
        ("allowed m", "what the odometry may be off by"),
        ("misfit deg", "the same of the heading"),
        ("allowed deg", "the same of the heading"),
        ("metres off", "the true place of the robot from where the node was made"),
        ("degrees off", "the same of its heading"),
        ("verdict", "by the view radius"),
    ]
    shown = []
    for one, m, d, verdict in zip(refused, metres, degrees, refusals(scene), strict=False):
        seconds = (one["stamp_ns"] - run.stamps_ns[0]) / 1e9
        angles = np.degrees([one["error_rad"], one["allowed_rad"]])
        fits = [(one["error_m"], "{:.2f}"), (one["allowed_m"], "{:.2f}")]
        fits += [(angle, "{:.1f}") for angle in angles]
        shown.append(_event(seconds, one, *fits, (m, "{:.2f}"), (d, "{:.0f}"), verdict))
    return Table(heads, shown)


def refusals(scene: Scene) -> list[str]:
    """Return a verdict of ``REFUSALS`` for each refused loop, or a dash without truth."""
    run = scene.run
    steps = run.steps_at(run.refused["stamp_ns"])
    right = near(run, scene.report, steps, run.refused["target"])
    words = np.select([~denied(run), right == 0, right == 1], [*REFUSALS], _NONE)
    return [str(word) for word in words]


def _event(seconds: float, link: Any, *figures: tuple[float, str] | str) -> tuple[str, list[Cell]]:
    """Build a row: time, source and target node, and figures, with a dash for unknown ones."""
    cells = [Cell(str(link["source"])), Cell(str(link["target"]))]
    for figure in figures:
        if isinstance(figure, str):
            cells.append(Cell(figure))
        else:
            value, show = figure
            cells.append(Cell(show.format(value) if np.isfinite(value) else _NONE))
    return f"{seconds:.1f} s", cells


def look_table(run: RatSlamRun) -> Table | None:
    """Count the looks by their view and its effect on the map, with the first one's reason.

    None without a look.
    """
    looks = np.flatnonzero(run.is_view)
    if not looks.size:
        return None
    ids, refused = run.view_ids[looks], np.isin(run.stamps_ns[looks], run.refused["stamp_ns"])
    views = np.select([ids < 0, new_views(ids)], ["no view", "new view"], "known view")
    effects = [_EFFECTS[ActionKind(kind)] for kind in run.actions[looks, 0].tolist()]
    kinds = [
        ", ".join(filter(None, (str(view), "loop refused" if no else "", effect)))
        for view, no, effect in zip(views, refused, effects, strict=True)
    ]
    rows = [
        (kind, [Cell(str(count)), Cell(run.why[kinds.index(kind)])])
        for kind, count in Counter(kinds).most_common()
    ]
    return Table([("looks", "how many"), ("the first one's reason", "as the run says it")], rows)


def new_views(ids: Integers) -> Mask:
    """Mask of the ids that occur for the first time; -1 is none."""
    new = np.zeros(len(ids), bool)
    new[np.unique(ids, return_index=True)[1]] = True
    return new & (ids >= 0)
