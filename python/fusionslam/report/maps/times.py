# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Time per step of a RatSLAM run: a table and a picture."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import ActionKind
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.report.maps.plots import DrawnTime
from fusionslam.report.page.figures import CURVE_COLORS, new_figure
from fusionslam.report.page.tables import Column, Table, build_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STAGES = ("looking", "pose cells", "map")
"""Names of the columns of ``step_seconds``."""
_BUSY = ("steps that looked", "steps that moved or looked", "steps that changed the map")
_COLORS = (CURVE_COLORS[2], CURVE_COLORS[4], CURVE_COLORS[0])
_WIDTH = 9.2


def busy_ms(run: RatSlamRun, stage: int | None = None) -> NDArray[np.float64]:
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
            partial(_percentile, stage=stage, share=share),
            "{:.3g}",
        )
        for name, busy, stage in parts
        for share in (50, 95)
    ]
    columns.append(
        Column("times real time", "how much faster than the data come in", _speed, "{:.3g}")
    )
    return build_table(columns, runs, labels)


def _percentile(run: RatSlamRun, stage: int | None, share: int) -> float | None:
    times = busy_ms(run, stage)
    return float(np.percentile(times, share)) if times.size else None


def _speed(run: RatSlamRun) -> float | None:
    spent = float(run.step_seconds.sum())
    driven = float(run.seconds[-1]) - DrawnTime.of(run).left_out
    return driven / spent if spent > 0 and driven > 0 else None


def draw_step_times(run: RatSlamRun) -> "Figure | None":
    """Draw the time of each stage per step, over time and over the size of the map.

    None if nothing was timed.
    """
    times = np.where(run.step_seconds > 0, run.step_seconds * 1e3, np.nan)
    if not np.isfinite(times).any():
        return None
    time = DrawnTime.of(run)
    figure = new_figure(_WIDTH, 3.6)
    left, right = figure.subplots(1, 2, sharey=True)
    changed = run.actions[:, 0] != ActionKind.NONE
    nodes = np.cumsum(run.actions[:, 0] == ActionKind.CREATE_NODE)
    for stage, color in enumerate(_COLORS):
        if (label := _stage_label(run, stage)) is not None:
            left.plot(time.seconds, times[:, stage], ".", ms=2, color=color)
            left.plot([], [], "o", color=color, label=label)
    right.plot(nodes[changed], times[changed, 2], ".", ms=3, color=_COLORS[2])
    time.label(left)
    left.set(ylabel="milliseconds", yscale="log", title="every step")
    right.set(xlabel="nodes of the map", title="map, in steps that change it")
    left.yaxis.set_major_formatter("{x:g}")
    for axis in (left, right):
        axis.grid(alpha=0.25)
    figure.legend(loc="outside upper left", ncols=3)
    return figure


def _stage_label(run: RatSlamRun, stage: int) -> str | None:
    """Return a stage with its percentiles, as in the table; None if it did nothing."""
    half, most = (_percentile(run, stage, share) for share in (50, 95))
    if half is None or most is None:
        return None
    return f"{STAGES[stage]}: p50 {half:.3g}, p95 {most:.3g} ms"
