# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of two frames: side by side, and their clouds over each other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Image, Points
from fusionslam.evaluation import LoopRun, VerifiedRun
from fusionslam.report.loops.outcomes import Pair
from fusionslam.report.page.figures import CURVE_COLORS, new_figure, widest_axes
from fusionslam.sensors.frame import Cloud

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CloudReader = Callable[[str, int], Cloud | None]
ImageReader = Callable[[str, int], Image | None]
"""(source, frame of the dataset) -> its cloud or image."""
ScanReader = Callable[[str, int], Points | None]
"""(source, frame of the dataset) -> points above the ground of the cloud that was registered."""
_MOST_POINTS = 40_000
_COLUMN = 4.5
"""Inches."""
_BACKGROUND = "#15181d"
_QUERY, _MATCH = CURVE_COLORS[4], CURVE_COLORS[5]
_GAMMA = 0.65  # brightens colours, which look darker as dots on a dark background


def draw_pair(
    run: LoopRun, pair: Pair, clouds: CloudReader, images: ImageReader
) -> "Figure | None":
    """Draw query on the left, match on the right; None without images and clouds."""
    frames = [int(run.numbers[row]) for row in (pair.query, pair.match)]
    pictures = [images(run.source, frame) for frame in frames]
    scenes = [clouds(run.source, frame) for frame in frames]
    view = _common_view([scene.points for scene in scenes if scene is not None and len(scene)])
    shapes = [picture.shape for picture in pictures if picture is not None]
    heights = [_COLUMN * shapes[0][0] / shapes[0][1]] if shapes else []
    heights += [view.height] if view else []
    if not heights:
        return None
    figure = new_figure(2 * _COLUMN + 0.2, 0.5 + sum(heights))
    axes = figure.subplots(len(heights), 2, squeeze=False, height_ratios=heights)
    start = run.stamps_ns[0]
    for column, (name, row) in enumerate((("query", pair.query), ("earlier", pair.match))):
        seconds = (run.stamps_ns[row] - start) / 1e9
        axes[0, column].set_title(f"{name}: frame {run.numbers[row]}, {seconds:.1f} s")
        if len(heights) == 2 or not view:
            _draw_image(axes[0, column], pictures[column])
        if view:
            _draw_cloud(axes[-1, column], scenes[column], view)
    return figure


def draw_overlay(run: VerifiedRun, query: int, scans: ScanReader) -> "Figure | None":
    """Draw both clouds of a loop from above over each other; None without them.

    Left as if both had been recorded at one place, right as they were registered.
    """
    match, pose = int(run.match[query]), run.match_from_query[query]
    earlier, later = (scans(run.source, int(run.numbers[row])) for row in (match, query))
    if earlier is None or later is None or not len(earlier) or not len(later):
        return None
    moved = later @ pose[:3, :3].T + pose[:3, 3]
    view = _common_view([earlier, later, moved])
    assert view is not None, "there are points"
    figure = new_figure(2 * _COLUMN + 0.2, 1.0 + view.height)
    titles = "before registration", "after registration"
    for axis, title, shown in zip(figure.subplots(1, 2), titles, (later, moved), strict=True):
        _show_view(axis, view)
        axis.set_title(title)
        named = ((f"frame {run.numbers[match]}", earlier, _MATCH),)
        for label, points, color in (*named, (f"frame {run.numbers[query]}", shown, _QUERY)):
            points = points[:: -(-len(points) // _MOST_POINTS)]
            place = points[:, view.axes].T
            axis.scatter(*place, s=5.0, linewidths=0, color=color, alpha=0.6, label=label)
        axis.set_xlabel(f"{view.high[0] - view.low[0]:.0f} m", fontsize=8, color="#666666")
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=2, markerscale=4)
    return figure


@dataclass(frozen=True)
class _View:
    """Two axes of the clouds, and the part of their plane that is shown, in metres."""

    axes: tuple[int, int]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @property
    def height(self) -> float:
        """Inches at the width of a column, limited to a readable range."""
        wide, high = self.high - self.low
        return float(np.clip(_COLUMN * high / wide, 1.6, 4.2))


def _common_view(clouds: Sequence[NDArray[np.floating[Any]]]) -> _View | None:
    """Look along the axis of least extent, wide enough for all clouds except stray points."""
    if not clouds:
        return None
    points = np.concatenate(clouds)
    axes = widest_axes(points)
    low, high = np.percentile(points[:, axes], (0.5, 99.5), axis=0)
    margin = 0.04 * (high - low) + 0.1
    return _View(axes, low - margin, high + margin)


def _draw_image(axis: "Axes", picture: Image | None) -> None:
    axis.set_axis_off()
    if picture is None:
        axis.text(0.5, 0.5, "no image", ha="center", transform=axis.transAxes)
        return
    # A column is about 540 pixels wide.
    step = max(1, picture.shape[1] // 540)
    axis.imshow(picture[::step, ::step], cmap="gray")


def _show_view(axis: "Axes", view: _View) -> None:
    axis.set(xticks=[], yticks=[], facecolor=_BACKGROUND, aspect="equal")
    axis.set(xlim=(view.low[0], view.high[0]), ylim=(view.low[1], view.high[1]))


def _draw_cloud(axis: "Axes", scene: Cloud | None, view: _View) -> None:
    _show_view(axis, view)
    if scene is None or not len(scene):
        axis.text(0.5, 0.5, "no cloud", ha="center", color="w", transform=axis.transAxes)
        return
    step = -(-len(scene) // _MOST_POINTS)
    points = scene.points[::step]
    (up,) = {0, 1, 2} - set(view.axes)
    colors = points[:, up] if scene.colors is None else (scene.colors[::step] / 255) ** _GAMMA
    across, along = view.axes
    axis.scatter(points[:, across], points[:, along], s=3.0, linewidths=0, c=colors)
    axis.set_xlabel(f"{len(scene):,} points", fontsize=8, color="#666666")
