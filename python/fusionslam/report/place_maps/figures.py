# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a map: trajectories and loops, drift, the cloud and the grid from above."""

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.base.texts import counted
from fusionslam.mapping import Edge, MapQuality
from fusionslam.mapping.grids import OccupancyGrid
from fusionslam.report.page.figures import (
    CURVE_COLORS,
    FALSE,
    INK,
    LOOP_COLORS,
    PATH,
    TRACK_COLORS,
    new_figure,
)
from fusionslam.report.place_maps.contents import Drive, LoopFit
from fusionslam.sensors.frame import Cloud

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LONGEST_NAME = 40
_ABOVE_M = 2.0
_MOST_PIXELS = 1500


def draw_trajectories(drives: Sequence[Drive], loops: Sequence[Edge], part: int) -> "Figure":
    """Draw the drives of one part of a map from above: by odometry alone, and as corrected.

    Args:
        drives: of the map.
        loops: of the map; those whose keyframes are in the part are drawn.
        part: number of the part.
    """
    shown = [(drive, drive.parts == part) for drive in drives if (drive.parts == part).any()]
    before, after = (
        np.concatenate(tracks)
        for tracks in zip(
            *((drive.odometry[rows, :2, 3], drive.poses[rows, :2, 3]) for drive, rows in shown),
            strict=True,
        )
    )
    # As high as what the panels show.
    spans = [np.ptp(places, axis=0) for places in (before, after)]
    ratio = float(np.clip(max(span[1] / max(span[0], 1e-6) for span in spans), 0.4, 1.3))
    figure = new_figure(9.6, 1.3 + 4.3 * ratio)
    moved = np.linalg.norm(after - before, axis=1).max(initial=0.0)
    titles = ("odometry alone", f"corrected, by up to {moved:.2f} m")
    for axis, title, corrected in zip(figure.subplots(1, 2), titles, (False, True), strict=True):
        places: dict[int, Floats] = {}
        for (drive, rows), color in zip(shown, cycle(TRACK_COLORS), strict=False):
            own = (drive.poses if corrected else drive.odometry)[rows, :2, 3]
            if drive.truth is not None:
                true = drive.truth[rows, :2, 3].T
                axis.plot(*true, color=PATH, lw=3.2, alpha=0.8, label="truth")
            label = _label(drive.name)
            axis.plot(*own.T, ".-", color=color, ms=2.5, lw=1, label=label, zorder=3)
            axis.plot(*own[0], "D", mfc="white", mec=INK, ms=6, zorder=6)
            places |= dict(zip(drive.numbers[rows].tolist(), own, strict=True))
        _draw_loops(axis, loops, places)
        axis.set_aspect("equal", adjustable="datalim")
        axis.set(xlabel="x (m)", title=title)
    figure.axes[0].set_ylabel("y (m)")
    handles, labels = figure.axes[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _label(name: str) -> str:
    """A name as text of a legend, which would hide "_x" and take "$x$" for a formula."""
    short = name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 3]}..."
    return f" {short}".replace("$", r"\$")


def _draw_loops(axis: "Axes", loops: Sequence[Edge], places: dict[int, Floats]) -> None:
    from matplotlib.collections import LineCollection

    for order, (state, color) in enumerate(LOOP_COLORS.items(), start=4):
        ends = [
            (places[edge.a], places[edge.b])
            for edge in loops
            if edge.state == state and edge.a in places and edge.b in places
        ]
        if not ends:
            continue
        alpha = 0.9 if state == "refused" else float(np.clip(60 / len(ends), 0.3, 0.9))
        axis.add_collection(LineCollection(ends, colors=color, lw=1.1, alpha=alpha, zorder=order))
        axis.plot([], [], color=color, label=f"{counted(len(ends), 'loop')} {state}")


def draw_quality(drives: Sequence[Drive], quality: MapQuality, part: int) -> "Figure":
    """Draw how sure the keyframes of one part of a map are, its weak places, and vital loops.

    Args:
        drives, quality: of the map.
        part: number of the part.
    """
    from matplotlib.collections import LineCollection

    shown = {
        number: pose[:2, 3]
        for drive in drives
        for number, pose, own in zip(drive.numbers.tolist(), drive.poses, drive.parts, strict=True)
        if own == part
    }
    places, inside = np.array([*shown.values()]), np.isin(quality.numbers, [*shown])
    wide, tall = np.ptp(places, axis=0).clip(1e-6)
    figure = new_figure(9.0, 1.0 + 8.0 * float(np.clip(tall / wide, 0.3, 1.0)))
    axis = figure.add_subplot()
    for k, weak in enumerate(quality.weak_places):
        way = [shown[each] for each in range(weak.first, weak.last + 1) if each in shown]
        if way:
            label = None if k else "weak places"
            axis.plot(*np.array(way).T, color=FALSE, lw=9, alpha=0.25, label=label, zorder=1)
    ends = [
        (shown[e.a], shown[e.b]) for e, *_ in quality.influences if e.a in shown and e.b in shown
    ]
    axis.add_collection(LineCollection(ends, colors=CURVE_COLORS[1], lw=1.6, zorder=2))
    dots = axis.scatter(
        places[:, 0], places[:, 1], c=quality.deviations[inside, 0], s=9, cmap="viridis", zorder=3
    )
    axis.plot(*places[0], "D", mfc="white", mec=INK, ms=6, zorder=4, label="first keyframe")
    if ends:
        axis.plot([], [], color=CURVE_COLORS[1], label="loops that change most")
    figure.colorbar(dots, ax=axis, label="standard deviation of the position (m)", shrink=0.8)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="x (m)", ylabel="y (m)")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def draw_drift(fits: Sequence[LoopFit]) -> "Figure | None":
    """Draw what loops say of odometry over the way between, and what the drift model promises.

    None without loops that odometry connects.
    """
    if not fits:
        return None
    figure = new_figure(9.6, 3.9)
    metres = np.array([fit.metres for fit in fits])
    for axis, field, unit in zip(
        figure.subplots(1, 2), ("m", "deg"), ("m", "degrees"), strict=True
    ):
        promised = np.array([getattr(fit, f"promised_{field}") for fit in fits])
        axis.plot(metres, promised, ".", color=PATH, ms=4, label="promised (standard deviation)")
        for state, color in LOOP_COLORS.items():
            errors = [
                (fit.metres, getattr(fit, f"error_{field}"))
                for fit in fits
                if fit.edge.state == state
            ]
            if errors:
                axis.plot(*np.array(errors).T, ".", color=color, ms=5, label=f"{state} loops")
        axis.set(xlabel="driven between (m)", ylabel=f"loop from odometry ({unit})")
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.25)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def draw_cloud(cloud: Cloud, places: Floats) -> "Figure | None":
    """Draw a map's cloud from above, without what is more than 2 m above the robot.

    Args:
        cloud: with or without colours; those without are coloured by height.
        places: float64 (n, 3), where the robot was.

    Returns:
        None without points.
    """
    from scipy.spatial import cKDTree

    points = cloud.points
    if not len(points):
        return None
    _, nearest = cKDTree(places[:, :2]).query(points[:, :2])
    above = points[:, 2] - places[nearest, 2]
    low = above < _ABOVE_M
    if not low.any():
        return None
    points, above = points[low], above[low]
    colors = color_heights(above) if cloud.colors is None else cloud.colors[low]
    image, extent = _rasterise(points, colors)
    figure, axis = _plan(extent)
    axis.imshow(image, origin="lower", extent=extent)
    axis.plot(*places[:, :2].T, ".", color=CURVE_COLORS[1], ms=2.5)
    return figure


def color_heights(heights: Floats) -> NDArray[np.uint8]:
    """Colours, uint8 (n, 3), from dark for low to bright for high."""
    import matplotlib

    low, high = np.percentile(heights, [2, 98])
    share = np.clip((heights - low) / max(high - low, 1e-6), 0, 1)
    return np.asarray(matplotlib.colormaps["viridis"](share, bytes=True)[:, :3])


def _rasterise(
    points: NDArray[np.float32], colors: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
    """An image of the highest point of each cell, and its bounds x0, x1, y0, y1."""
    low, high = np.percentile(points[:, :2], [0.2, 99.8], axis=0)
    inside = ((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)
    points, colors = points[inside], colors[inside]
    # Cells so large that few between the points are empty.
    cell = max(float((high - low).max()) / _MOST_PIXELS * 2, 0.1)
    columns, rows = (np.ceil((high - low) / cell) + 1).astype(int)
    image = np.full((rows, columns, 3), 255, np.uint8)
    order = np.argsort(points[:, 2], kind="stable")  # the highest last
    at = ((points[order, :2] - low) / cell).astype(int)
    image[at[:, 1], at[:, 0]] = colors[order]
    return image, (low[0], low[0] + columns * cell, low[1], low[1] + rows * cell)


def draw_grid(grid: OccupancyGrid) -> "Figure":
    """Draw where a robot can drive: white free, black occupied, grey unknown."""
    cells = np.full(grid.cells.shape, 190, np.uint8)
    cells[grid.cells == 0] = 255
    cells[grid.cells > 0] = 0
    known = grid.cells >= 0
    rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    side = grid.resolution
    y0, x0 = (int(found[0]) if len(found) else 0 for found in (rows, columns))
    y1, x1 = (int(found[-1]) + 1 if len(found) else 1 for found in (rows, columns))
    left, bottom = grid.origin
    extent = (left + x0 * side, left + x1 * side, bottom + y0 * side, bottom + y1 * side)
    figure, axis = _plan(extent)
    axis.imshow(cells[y0:y1, x0:x1], cmap="gray", vmin=0, vmax=255, origin="lower", extent=extent)
    return figure


def _plan(extent: tuple[float, float, float, float]) -> tuple["Figure", Any]:
    """A figure for an image from above."""
    wide, tall = extent[1] - extent[0], extent[3] - extent[2]
    ratio = float(np.clip(tall / wide, 0.25, 1.4))
    figure = new_figure(9.0, 0.6 + 8.3 * ratio)
    axis = figure.add_subplot()
    axis.set(xlabel="x (m)", ylabel="y (m)")
    return figure, axis
