# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Plots of a RatSLAM run over time: pose cells, views and actions, errors, times of a step."""

from typing import TYPE_CHECKING

import numpy as np

from fusionslam._core import ActionKind
from fusionslam.base.arrays import Floats
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.report.maps.aligned_run import DrawnTime, Scene, align_poses, new_views
from fusionslam.report.maps.tables import STAGES, percentile
from fusionslam.report.page.figures import (
    CURVE_COLORS,
    DENIED,
    MAP,
    PATH,
    RECKONED,
    RIGHT,
    WRONG,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 900
_WIDTH = 9.2
_STAGE_COLORS = (RIGHT, DENIED, MAP)


def draw_activity(run: RatSlamRun) -> "Figure | None":
    """Draw the pose cells' activity along each axis over time; None without a view step.

    Each image has columns at even times, each with the latest activity at that time.
    """
    from matplotlib.colors import PowerNorm

    if not run.is_view.any():
        return None
    time = DrawnTime.of(run)
    seconds = time.seconds[run.is_view]
    start, end = float(seconds[0]), float(max(seconds[-1], seconds[0] + 1e-3))
    moments = np.linspace(start, end, min(_COLUMNS, max(2, len(seconds))))
    latest = np.searchsorted(seconds, moments + 1e-9, side="right") - 1
    figure = new_figure(_WIDTH, 6.2)
    panels = figure.subplots(3, 1, sharex=True)
    rows = (
        (run.activity_th, 2, "th (deg)", 360.0),
        (run.activity_x, 0, "x (cells)", None),
        (run.activity_y, 1, "y (cells)", None),
    )
    for axis, (activity, column, label, reach) in zip(panels, rows, strict=True):
        size = activity.shape[1]
        top = reach or float(size)
        axis.imshow(
            activity[latest].T,
            extent=(start, end, 0, top),
            origin="lower",
            aspect="auto",
            cmap="magma",
            # Activity spreads over many cells: a square root keeps its fringes visible.
            norm=PowerNorm(0.5, vmin=0, vmax=1),
        )
        decoded = run.cells[run.is_view, column] * top / size
        axis.plot(seconds, decoded, ".", ms=1.6, mew=0, color="white", alpha=0.8)
        axis.set(ylabel=label, ylim=(0, top))
    panels[0].set_yticks(range(0, 361, 90))
    time.label(panels[-1], *panels[:-1])
    shown = panels[0].images[0]
    figure.colorbar(shown, ax=list(panels), shrink=0.6, pad=0.01, label="share of the activity")
    return figure


def draw_views(scene: Scene) -> "Figure | None":
    """Draw view ids over time, and the actions of the map; None without a view step."""
    run = scene.run
    if not run.is_view.any():
        return None
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(_WIDTH, 4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    time = DrawnTime.of(run)
    seconds, ids = time.seconds[run.is_view], run.view_ids[run.is_view]
    new = new_views(ids)
    for mask, color, name in ((~new & (ids >= 0), RIGHT, "known view"), (new, MAP, "new view")):
        label = f"{name}: {np.count_nonzero(mask)}"
        above.plot(seconds[mask], ids[mask], "o", mew=0, ms=3, color=color, label=label)
    most = max(int(ids.max()), 1)
    above.set(ylabel="view", ylim=(-0.04 * most - 0.5, 1.04 * most + 0.5))
    above.yaxis.set_major_locator(MaxNLocator(integer=True))
    above.grid(alpha=0.25)
    _draw_events(below, scene, time, seconds[ids < 0])
    time.label(below, above)
    figure.legend(loc="outside upper left", ncols=2)
    return figure


def _draw_events(axis: "Axes", scene: Scene, time: DrawnTime, blind: Floats) -> None:
    """Draw a row of ticks for each kind of event."""
    run, kinds, seconds = scene.run, scene.run.actions[:, 0], time.seconds
    right = scene.made[scene.right]
    rows = (
        ("nothing seen", blind, PATH),
        ("refused loop", time.at(run, run.refused["stamp_ns"]), DENIED),
        ("false loop", seconds[scene.made[scene.false]], WRONG),
        ("right loop" if scene.truth is not None else "loop", seconds[right], RIGHT),
        ("known node", seconds[kinds == ActionKind.CREATE_EDGE], RIGHT),
        ("new node", seconds[kinds == ActionKind.CREATE_NODE], MAP),
    )
    shown = [row for row in rows if len(row[1])]
    for height, (_, stamps, color) in enumerate(shown):
        axis.vlines(stamps, height - 0.38, height + 0.38, colors=color, lw=0.8)
    names = [f"{name}: {len(stamps)}" for name, stamps, _ in shown]
    axis.set_yticks(range(len(shown)), names)
    axis.set_ylim(-0.6, max(len(shown), 1) - 0.4)
    axis.tick_params(axis="y", length=0)


def draw_errors(scene: Scene) -> "Figure | None":
    """Draw the errors of map and dead reckoning over time; None without truth or nodes."""
    if scene.truth is None or scene.report.trajectory is None:
        return None
    figure = new_figure(_WIDTH, 3.6)
    axis = figure.add_subplot()
    run, report, rows = scene.run, scene.report, scene.run.node_ids >= 0
    time = DrawnTime.of(run)
    for poses, errors, color, style, name in (
        (run.dead_reckoning, report.dead_reckoning, RECKONED, "--", "dead reckoning"),
        (run.poses, report.live, CURVE_COLORS[5], "-", "map, at the time"),
        (run.final_poses, report.trajectory, MAP, "-", "map, in the end"),
    ):
        if errors is None:
            continue
        apart = np.hypot(*(align_poses(poses, errors) - scene.truth)[rows, :2].T)
        label = f"{name}: RMSE {errors.rmse_m:.2f} m"
        axis.plot(time.seconds[rows], apart, style, color=color, lw=1.2, label=label)
    time.label(axis)
    axis.set_ylabel("metres from the truth")
    axis.set_ylim(bottom=0)
    axis.grid(alpha=0.25)
    figure.legend(loc="outside upper left", ncols=3)
    return figure


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
    for stage, (name, color) in enumerate(zip(STAGES, _STAGE_COLORS, strict=True)):
        half, most = (percentile(run, stage, share) for share in (50, 95))
        if half is not None and most is not None:
            label = f"{name}: p50 {half:.3g}, p95 {most:.3g} ms"
            left.plot(time.seconds, times[:, stage], ".", ms=2, color=color)
            left.plot([], [], "o", color=color, label=label)
    right.plot(nodes[changed], times[changed, 2], ".", ms=3, color=_STAGE_COLORS[2])
    time.label(left)
    left.set(ylabel="milliseconds", yscale="log", title="every step")
    right.set(xlabel="nodes of the map", title="map, in steps that change it")
    left.yaxis.set_major_formatter("{x:g}")
    for axis in (left, right):
        axis.grid(alpha=0.25)
    figure.legend(loc="outside upper left", ncols=3)
    return figure
