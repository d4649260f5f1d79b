# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Plots of results: curves, trajectories, distance matrices."""

from collections.abc import Mapping
from itertools import cycle, product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import DescriptorRun, LoopRun, PrecisionRecall
from fusionslam.evaluation.loops.nearest_matches import metres_between, pairwise_distances
from fusionslam.report.loops.outcomes import judge_queries
from fusionslam.report.page.figures import (
    CURVE_COLORS,
    PATH,
    draw_loops,
    new_figure,
    widest_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LARGEST_MATRIX = 800
_LABELS = ("x", "y", "z")


def draw_curves(curves: Mapping[str, PrecisionRecall]) -> "Figure":
    """Draw precision over recall of every descriptor on one source, by descriptor name."""
    figure = new_figure(7.4, 4.6)
    axis = figure.add_subplot()
    _iso_f1(axis)
    styles = product(("-", "--", ":"), CURVE_COLORS)
    for (name, curve), (line, color) in zip(curves.items(), cycle(styles), strict=False):
        label = (
            f"{name}: AP {curve.average_precision:.3f}\n"
            f"R@100P {curve.recall_at_full_precision:.3f}, F1 {curve.max_f1:.3f}"
        )
        curve.plot(axis, color=color, ls=line, lw=1.8, label=label)
    axis.legend(loc="upper left", bbox_to_anchor=(1.02, 1), borderaxespad=0)
    return figure


def _iso_f1(axis: "Axes") -> None:
    for f1 in (0.2, 0.4, 0.6, 0.8):
        recall = np.linspace(f1 / (2 - f1), 1, 100)
        axis.plot(recall, f1 * recall / (2 * recall - f1), color="#dddddd", lw=0.8, zorder=0)
        axis.text(1.0, f1 / (2 - f1) + 0.01, f"F1 {f1}", color="#aaaaaa", fontsize=7, ha="right")


def draw_trajectory(run: LoopRun, curve: PrecisionRecall) -> "Figure":
    """Draw the path from above with the accepted loops (``judge_queries``)."""
    places = run.positions
    assert places is not None, "a curve exists only where positions do"
    across, up = widest_axes(places)
    tall = bool(np.ptp(places[:, up]) > np.ptp(places[:, across]))
    if tall:
        across, up = up, across
    plane = places[:, (across, up)]
    wide, high = np.ptp(plane, axis=0)
    figure = new_figure(8.2, 1.3 + 7.2 * float(np.clip(high / max(wide, 1e-9), 0.22, 0.8)))
    axis = figure.add_subplot()
    axis.plot(*plane.T, color=PATH, lw=1.2, zorder=1)
    found = judge_queries(run, curve)
    draw_loops(axis, plane, curve.matches, missed=found.missed, right=found.true, wrong=found.false)
    axis.set(xlabel=f"{_LABELS[across]} (m)", ylabel=f"{_LABELS[up]} (m)")
    if tall:
        # Two swapped axes would show a mirror image.
        axis.invert_yaxis()
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def draw_distances(run: DescriptorRun, window: int, radius: float | None) -> "Figure":
    """Draw descriptor distances of all pairs and, if positions are known, the true distances."""
    rows = np.arange(0, len(run), -(-len(run) // _LARGEST_MATRIX) or 1)
    lag = rows[:, None] - rows[None, :]
    places = run.positions if radius is not None else None
    figure = new_figure(4.6 if places is None else 8.8, 4.2)
    axes = figure.subplots(1, 1 if places is None else 2, sharey=True, squeeze=False)[0]
    distances = pairwise_distances(run.descriptors[rows], run.metric)
    distances = np.where(lag > window, distances, np.nan)
    _matrix(axes[0], distances, rows, window, "descriptor distance")
    if places is not None and radius is not None:
        apart = metres_between(places[rows][:, None], places[rows][None, :])
        near = np.where(lag > window, np.minimum(apart, 5 * radius), np.nan)
        _matrix(axes[1], near, rows, window, "true distance (m)", closer_than=radius)
    axes[0].set_ylabel("query frame")
    return figure


def _matrix(
    axis: "Axes",
    values: NDArray[np.float64],
    rows: NDArray[np.int64],
    window: int,
    title: str,
    closer_than: float | None = None,
) -> None:
    """Draw one lower triangle; grey: the excluded band; red: closer than a radius."""
    extent = (-0.5, rows[-1] + 0.5, rows[-1] + 0.5, -0.5) if len(rows) else (0, 1, 1, 0)
    band = rows[:, None] - rows[None, :]
    excluded = np.ma.masked_where((band < 0) | (band > window), np.ones(band.shape))
    axis.imshow(excluded, cmap="Greys", vmin=0, vmax=3, extent=extent)
    if np.isfinite(values).any():
        # A few outlier frames must not use up the colour range.
        low, high = np.nanpercentile(values, (0, 98))
        shown = axis.imshow(values, cmap="viridis", extent=extent, vmin=low, vmax=high)
        axis.figure.colorbar(shown, ax=axis, shrink=0.8, pad=0.02)
    if closer_than is not None:
        near = np.ma.masked_where(~(values < closer_than), np.ones(values.shape))
        axis.imshow(near, cmap="autumn", vmin=1, vmax=2, extent=extent)
        title += f", red: < {closer_than:g} m"
    axis.set(title=title, xlabel="candidate frame")
