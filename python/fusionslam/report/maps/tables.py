# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the report of maps: errors against dead reckoning, and single loops."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import ActionKind
from fusionslam.evaluation import MapReport, PoseErrors
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.report.maps.aligned_run import (
    Scene,
    find_denied,
    measure_misfits,
    measure_offsets,
    near,
)
from fusionslam.report.page.tables import DASH, Cell, Column, Table, build_table
from fusionslam.storage.arrays import Floats, Integers, Mask

MOST = 100
"""Largest number of rows in a table of single events."""
REFUSALS = ("linked later", "false: prevented", "right: lost")
"""Verdicts on refused loops: confirmed by later loops, or kept out of the map."""
_EFFECTS = {
    ActionKind.NONE: "",
    ActionKind.CREATE_NODE: "node made",
    ActionKind.CREATE_EDGE: "arrival at a known node",
}

Event = Mapping[str, Any]
"""A loop, closed or refused: fields of its link or of ``REFUSED``, and those of the columns."""

_ENDS: tuple[Column[Event], ...] = (
    Column("from node", "where the robot was last", "source"),
    Column("to node", "where it arrived", "target"),
)
_JUDGEMENT: tuple[Column[Event], ...] = (
    Column(
        "metres off",
        "the true place of the robot from where the node was made",
        "metres",
        "{:.2f}",
    ),
    Column("degrees off", "the same of its heading", "degrees", "{:.0f}"),
    Column("verdict", "by the view radius", "verdict"),
)
_REFUSED_COLUMNS: tuple[Column[Event], ...] = (
    _ENDS[0],
    Column("to node", "where it would have arrived", "target"),
    Column("misfit m", "between the loop and the odometry", "error_m", "{:.2f}"),
    Column("allowed m", "error that the odometry may have", "allowed_m", "{:.2f}"),
    Column("misfit deg", "the same of the heading", "error_rad", "{:.1f}", scale=180 / np.pi),
    Column("allowed deg", "the same of the heading", "allowed_rad", "{:.1f}", scale=180 / np.pi),
    *_JUDGEMENT,
)
_PATH = "every step on the map as it is in the end, RMSE (absolute trajectory error)"
_ERROR_COLUMNS: tuple[Column[Mapping[str, PoseErrors | None]], ...] = (
    Column(
        "nodes, m",
        "nodes in the end against where the robot truly was when it made them, RMSE",
        "nodes.rmse_m",
        "{:.3f}",
        min,
    ),
    Column("path, m", _PATH, "path.rmse_m", "{:.3f}", min),
    Column("path, largest m", "the largest error of a step", "path.max_m", "{:.3f}", min),
    Column("heading, deg", "of every step, RMSE", "path.heading_rmse_deg", "{:.2f}", min),
    Column("live, m", "every step as the map was then, RMSE", "live.rmse_m", "{:.3f}", min),
)
_TRUTH_COLUMNS: tuple[Column[Scene], ...] = (
    Column(
        "right loops",
        "links of loops that join places near each other",
        "report.near_loop_link_share",
        "{:.1%}",
        max,
    ),
    Column(
        "linked revisits",
        "looks from where an older look was that the map joins with it",
        "report.linked_revisit_share",
        "{:.1%}",
        max,
    ),
    Column(
        "false arrivals",
        "arrivals at a known node while the robot was elsewhere",
        "report.false_loops",
        best=min,
    ),
    Column("wrongly refused", "refused loops that were right", "report.refused_true", best=min),
)
_MAP_COLUMNS: tuple[Column[Scene], ...] = (
    Column(
        "loops", "links made by an arrival at a known node", lambda scene: int(scene.loops.sum())
    ),
    Column("arrivals", "arrivals at a known node", "report.loops"),
    Column("refused", "loops that did not fit the odometry", "report.refused"),
    Column("nodes", "of the map in the end", "report.node_count"),
    Column("links", "of the map in the end", "report.link_count"),
    Column(
        "misfit of links, m",
        "places of targets by their links, against the final map, RMS",
        lambda scene: _compute_misfit(scene),
        "{:.3f}",
    ),
)


def error_table(labels: Sequence[str], reports: Sequence[MapReport]) -> Table | None:
    """Build the table of errors of every map and every odometry; None without ground truth."""
    rows: dict[str, dict[str, PoseErrors | None]] = {}
    for report in reports:
        if report.dead_reckoning is not None:
            alone = {"path": report.dead_reckoning, "live": report.dead_reckoning}
            nodes = report.nodes_by_odometry
            rows.setdefault(f"dead reckoning: {report.odometry}", {"nodes": nodes, **alone})
    names, errors = [*rows, *labels], [*rows.values()]
    errors += [{"nodes": one.nodes, "path": one.trajectory, "live": one.live} for one in reports]
    if not any(row["path"] for row in errors):
        return None
    return build_table(_ERROR_COLUMNS, errors, names)


def joins_table(labels: Sequence[str], scenes: Sequence[Scene]) -> Table:
    """Build the table of each map's size, its links, and how well they fit together."""
    known = any(scene.report.near_links is not None for scene in scenes)
    return build_table([*(_TRUTH_COLUMNS if known else ()), *_MAP_COLUMNS], scenes, labels)


def _compute_misfit(scene: Scene) -> float | None:
    apart = measure_misfits(scene.run)
    return float(np.sqrt((apart**2).mean())) if apart.size else None


def loop_table(scene: Scene) -> Table | None:
    """Build the table of closed loops: time, nodes, and verdict; None without a loop."""
    rows = np.flatnonzero(scene.loops)
    rows = rows[np.argsort(scene.made[rows], kind="stable")][:MOST]
    run, steps = scene.run, scene.made[rows]
    verdicts = np.where(scene.false[rows], "false", "right").astype(object)
    metres, degrees = measure_offsets(run, steps, run.links["target"][rows])
    verdicts[np.isnan(metres)] = DASH
    verdicts[run.actions[steps, 0] != ActionKind.CREATE_EDGE] += ", refused at first"
    columns, links = [*_ENDS, *_JUDGEMENT], run.links[rows]
    return _table_of_events(columns, links, run.seconds[steps], metres, degrees, verdicts.tolist())


def refused_table(scene: Scene) -> Table | None:
    """Build the table of refused loops with their misfit; None if there are none."""
    run, refused = scene.run, scene.run.refused[:MOST]
    metres, degrees = measure_offsets(run, run.steps_at(refused["stamp_ns"]), refused["target"])
    seconds = (refused["stamp_ns"] - run.stamps_ns[:1]) / 1e9
    return _table_of_events(
        _REFUSED_COLUMNS, refused, seconds, metres, degrees, refusals(scene)[:MOST]
    )


def _table_of_events(
    columns: Sequence[Column[Event]],
    loops: NDArray[np.void],
    seconds: Floats,
    metres: Floats,
    degrees: Floats,
    verdicts: Sequence[str],
) -> Table | None:
    """Build a table of loops with their time; None without one."""
    events = [
        {
            **dict(zip(loops.dtype.names or (), loop.tolist(), strict=True)),
            "metres": far,
            "degrees": turned,
            "verdict": verdict,
        }
        for loop, far, turned, verdict in zip(loops, metres, degrees, verdicts, strict=True)
    ]
    labels = [f"{second:.1f} s" for second in seconds]
    return build_table(columns, events, labels) if events else None


def refusals(scene: Scene) -> list[str]:
    """Return a verdict of ``REFUSALS`` for each refused loop, or a dash without truth."""
    run = scene.run
    steps = run.steps_at(run.refused["stamp_ns"])
    right = near(run, scene.report, steps, run.refused["target"])
    words = np.select([~find_denied(run), right == 0, right == 1], [*REFUSALS], DASH)
    return [str(word) for word in words]


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
