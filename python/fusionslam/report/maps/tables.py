# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the report of maps: errors, single loops, times, configurations."""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import ActionKind
from fusionslam.base.arrays import Floats
from fusionslam.config import flatten, unit_of, walk
from fusionslam.evaluation import MapReport, PoseErrors
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam.slam import RatSlamConfig
from fusionslam.report.maps.aligned_run import (
    DrawnTime,
    Scene,
    find_denied,
    measure_offsets,
    near,
    new_views,
)
from fusionslam.report.page.tables import DASH, Column, Table, build_table, columns_of

MOST = 100
"""Largest number of rows in a table of single events."""
REFUSALS = ("linked later", "false: prevented", "right: lost")
"""Verdicts on refused loops: confirmed by later loops, or kept out of the map."""
STAGES = ("looking", "pose cells", "map")
"""Names of the columns of ``step_seconds``."""
_BUSY = ("steps that looked", "steps that moved or looked", "steps that changed the map")
_EFFECTS = {
    ActionKind.NONE: "",
    ActionKind.CREATE_NODE: "node made",
    ActionKind.CREATE_EDGE: "arrival at a known node",
}

Event = Mapping[str, Any]
"""A loop, closed or refused: fields of its link or of ``REFUSED``, and those of the columns."""


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
    return build_table(columns_of("maps.errors"), errors, names)


def joins_table(labels: Sequence[str], scenes: Sequence[Scene]) -> Table:
    """Build the table of each map's size, its links, and how well they fit together."""
    known = any(scene.report.near_links is not None for scene in scenes)
    truth = columns_of("maps.truth") if known else []
    return build_table([*truth, *columns_of("maps.joins")], scenes, labels)


def loop_table(scene: Scene) -> Table | None:
    """Build the table of closed loops: time, nodes, and verdict; None without a loop."""
    rows = np.flatnonzero(scene.loops)
    rows = rows[np.argsort(scene.made[rows], kind="stable")][:MOST]
    run, steps = scene.run, scene.made[rows]
    verdicts = np.where(scene.false[rows], "false", "right").astype(object)
    metres, degrees = measure_offsets(run, steps, run.links["target"][rows])
    verdicts[np.isnan(metres)] = DASH
    verdicts[run.actions[steps, 0] != ActionKind.CREATE_EDGE] += ", refused at first"
    links = run.links[rows]
    return _table_of_events(
        "maps.ends", links, run.seconds[steps], metres, degrees, verdicts.tolist()
    )


def refused_table(scene: Scene) -> Table | None:
    """Build the table of refused loops with their misfit; None if there are none."""
    run, refused = scene.run, scene.run.refused[:MOST]
    metres, degrees = measure_offsets(run, run.steps_at(refused["stamp_ns"]), refused["target"])
    seconds = (refused["stamp_ns"] - run.stamps_ns[:1]) / 1e9
    return _table_of_events(
        "maps.refused", refused, seconds, metres, degrees, refusals(scene)[:MOST]
    )


def _table_of_events(
    table: str,
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
    columns = [*columns_of(table), *columns_of("maps.judgement")]
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
    counts = Counter(kinds).most_common()
    rows = [{"looks": count, "why": run.why[kinds.index(kind)]} for kind, count in counts]
    return build_table(columns_of("maps.looks"), rows, [kind for kind, _ in counts])


def busy_ms(run: RatSlamRun, stage: int | None = None) -> Floats:
    """float64: milliseconds of the steps in which a stage did something.

    Args:
        run: the run.
        stage: index into ``STAGES``; None for all stages of every step together.
    """
    times = run.step_seconds.sum(axis=1) if stage is None else run.step_seconds[:, stage]
    if stage == STAGES.index("map"):
        times = times[run.actions[:, 0] != ActionKind.NONE]
    return np.asarray(times[times > 0] * 1e3)


def cost_table(labels: Sequence[str], runs: Sequence[RatSlamRun]) -> Table | None:
    """Build the table of median and 95th percentile per step; None if nothing was timed."""
    if not any((run.step_seconds > 0).any() for run in runs):
        return None
    parts = [*zip(STAGES, _BUSY, range(len(STAGES)), strict=True), ("step", "all steps", None)]
    columns: list[Column[RatSlamRun]] = [
        Column(
            f"{name} p{share} ms",
            f"percentile {share} of {busy}",
            partial(percentile, stage=stage, share=share),
            "{:.3g}",
        )
        for name, busy, stage in parts
        for share in (50, 95)
    ]

    def speed(run: RatSlamRun) -> float | None:
        spent = float(run.step_seconds.sum())
        driven = float(run.seconds[-1]) - DrawnTime.of(run).left_out
        return driven / spent if spent > 0 and driven > 0 else None

    hint = "how much faster than the data come in"
    columns.append(Column("times real time", hint, speed, "{:.3g}"))
    return build_table(columns, runs, labels)


def percentile(run: RatSlamRun, stage: int | None, share: int) -> float | None:
    """Return a percentile of ``busy_ms``; None if the stage did nothing."""
    times = busy_ms(run, stage)
    return float(np.percentile(times, share)) if times.size else None


class ConfigTable(NamedTuple):
    """Values of configurations; each row has a dotted name, a value per head, and a meaning."""

    heads: list[str]
    rows: list[tuple[str, list[str], str]]


def config_table(labels: Sequence[str], runs: Sequence[RatSlamRun]) -> ConfigTable | None:
    """Build one column for each distinct configuration; None if none is known."""
    groups: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for label, run in zip(labels, runs, strict=True):
        values = flatten(run.config).items()
        texts = ((name, "null" if value is None else str(value)) for name, value in values)
        groups.setdefault(tuple(texts), []).append(label)
    columns = [dict(texts) for texts in groups]
    names = list(dict.fromkeys(name for texts in columns for name in texts))
    if not names:
        return None
    units = {name: (field.description, unit_of(field)) for name, _, field in walk(RatSlamConfig())}
    meanings = {name: f"{text} ({unit})" if unit else text for name, (text, unit) in units.items()}
    return ConfigTable(
        ["value"] if len(groups) == 1 else ["; ".join(group) for group in groups.values()],
        [
            (name, [texts.get(name, DASH) for texts in columns], meanings.get(name) or "")
            for name in names
        ],
    )
