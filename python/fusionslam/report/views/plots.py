# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Plots of the report of views: curves, errors over time, times, paths."""

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import ViewReport, ViewRun, baselines, judge_views
from fusionslam.report.page.figures import CURVE_COLORS, PATH, draw_loops, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Judged = Sequence[tuple[ViewRun, ViewReport]]
_MARKERS = "osD^vPX"


def draw_view_curves(runs: Judged) -> "Figure | None":
    """Draw precision over recall of loops and of all positives; None without a sweep."""
    swept = [(run, report, run.curve) for run, report in runs if run.curve is not None]
    if not swept:
        return None
    figure = new_figure(9.2, 4.6)
    panels = figure.subplots(1, 2)
    for axis, kind in zip(panels, ("loop ", ""), strict=True):
        names = [f"{kind}recall".replace(" ", "_"), f"{kind}precision".replace(" ", "_")]
        for (run, report, curve), color in zip(swept, cycle(CURVE_COLORS), strict=False):
            recall, precision = (curve.figures[name] for name in names)
            axis.plot(recall, precision, color=color, lw=1.6, label=run.method)
            here = [getattr(report, name) for name in names]
            if None not in here:
                axis.plot(*here, "o", color=color, markeredgecolor="white", ms=8, zorder=5)
        axis.set(xlabel=f"{kind}recall", ylabel=f"{kind}precision")
        axis.set(xlim=(-0.02, 1.02), ylim=(0, 1.04))
        axis.grid(alpha=0.25)
    _without_sensor(panels[1], *swept[0][:2])
    panels[0].set_title("Loops: matches with views older than 20 s")
    panels[1].set_title("All positives, as in the thesis's figure 5.5")
    handles, labels = panels[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(3, len(labels)))
    return figure


def _without_sensor(axis: "Axes", run: ViewRun, report: ViewReport) -> None:
    """Draw the baselines, which have recall but no loop recall."""
    for (name, ids), marker in zip(baselines(len(run)).items(), "+x*", strict=True):
        own = judge_views(ids, run.poses, run.stamps, rule=report.rule)
        if own.recall is not None and own.precision is not None:
            label = f"no sensor: {name}"
            axis.plot(own.recall, own.precision, marker, color="#666666", ms=8, label=label)


def draw_errors(runs: Judged) -> "Figure | None":
    """Draw distances of the false positives over time (figures 5.7 to 5.9); None without any."""
    wrong = [(run, report) for run, report in runs if report.false_positives]
    if not wrong:
        return None
    figure = new_figure(9.2, 3.9)
    axis = figure.add_subplot()
    looks = zip(cycle(CURVE_COLORS), cycle(_MARKERS), strict=False)
    styles = {run.method: look for (run, _), look in zip(runs, looks, strict=False)}
    start = min(run.stamps[0] for run, _ in wrong)
    for run, report in wrong:
        color, marker = styles[run.method]
        rows = report.false_positive_indices
        apart = report.false_positive_distances
        label = f"{run.method}: {rows.size}, mean {apart.mean():.2f} m, max {apart.max():.2f} m"
        axis.plot(
            run.stamps[rows] - start, apart, marker, color=color, ms=5, alpha=0.75, label=label
        )
    rule = wrong[0][1].rule
    axis.axhline(rule.false_positive_distance, color="#777777", lw=0.8, ls="--")
    axis.set(xlabel="time (s)", ylabel="metres from the view")
    axis.set_xlim(0, max(run.stamps[-1] - start for run, _ in wrong))
    axis.set_ylim(bottom=0)
    axis.grid(alpha=0.25)
    figure.legend(loc="outside upper left", ncols=2)
    return figure


def draw_times(runs: Judged) -> "Figure | None":
    """Draw building and matching times of every scan; None if nothing was timed."""
    from matplotlib.lines import Line2D

    kinds = (("build_seconds", "making a view"), ("match_seconds", "comparing with all stored"))
    shown = [
        (title, [(run, times) for run, _ in runs if (times := getattr(run, name)) is not None])
        for name, title in kinds
    ]
    shown = [(title, timed) for title, timed in shown if timed]
    if not shown:
        return None
    figure = new_figure(9.2, 3.4)
    colors = {run.method: color for (run, _), color in zip(runs, cycle(CURVE_COLORS), strict=False)}
    for axis, (title, timed) in zip(
        figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True
    ):
        for run, times in timed:
            color = colors[run.method]
            axis.plot(run.stamps - run.stamps[:1], times * 1e3, ".", ms=3, color=color)
        axis.set(title=title, xlabel="time (s)", ylabel="milliseconds", yscale="log")
        axis.grid(alpha=0.25)
    names = {run.method: colors[run.method] for _, timed in shown for run, _ in timed}
    marks = [Line2D([], [], marker="o", ls="", color=color) for color in names.values()]
    figure.legend(marks, list(names), loc="outside lower center", ncols=min(4, len(names)))
    return figure


def draw_belief(run: ViewRun) -> "Figure | None":
    """Draw how probable the best place, others and a new one were; None without odometry."""
    if run.known is None or run.others is None:
        return None
    seconds = run.stamps - run.stamps[:1]
    figure = new_figure(9.2, 2.8)
    axis = figure.add_subplot()
    shares = (run.known, run.others, (1 - run.known - run.others).clip(0))
    names = ("the most probable place", "other places", "a new place")
    axis.stackplot(
        seconds, *shares, labels=names, colors=("#3b7dd8", "#e8a33d", "#d9dde3"), step="post"
    )
    held = [row for row, _ in run.held_back]
    axis.plot(
        seconds[held], np.full(len(held), 1.03), "v", ms=5, color="#b3261e", label="held back"
    )
    axis.set(xlabel="time (s)", ylabel="probability", ylim=(0, 1.08))
    axis.margins(x=0)
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def draw_path(run: ViewRun, report: ViewReport) -> "Figure":
    """Draw the path from above with the loops that were closed, and those that were missed."""
    places = run.poses[:, :2]
    wide, high = np.maximum(np.ptp(places, axis=0), 1e-9)
    figure = new_figure(7.6, 1.2 + 6.4 * float(np.clip(high / wide, 0.25, 0.85)))
    axis = figure.add_subplot()
    for piece in path_pieces(run):
        axis.plot(*piece.T, color=PATH, lw=1.2, zorder=1)
    missed = report.revisit & ~report.loop_correct
    wrong = report.loop & ~report.loop_correct
    draw_loops(axis, places, report.matched, missed=missed, right=report.loop_correct, wrong=wrong)
    axis.set(xlabel="x (m)", ylabel="y (m)")
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def path_pieces(run: ViewRun) -> list[NDArray[np.float64]]:
    """Return the path, float64 (m, 2) each, cut where scans were left out for a while."""
    steps = np.diff(run.stamps)
    usual = np.median(steps) if steps.size else 0.0
    return np.split(run.poses[:, :2], np.flatnonzero(steps > 4 * usual) + 1)
