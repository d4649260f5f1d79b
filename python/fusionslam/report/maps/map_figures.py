# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of experience maps: over ground truth and dead reckoning, or side by side."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.argument_types import checked
from fusionslam.errors import DataError
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.report.maps.aligned_run import Scene, find_denied, scene_of
from fusionslam.report.page.figures import CURVE_COLORS, PATH, new_figure, use_style
from fusionslam.storage.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

MAP, RECKONED = CURVE_COLORS[0], CURVE_COLORS[3]
"""Colours of the map and of dead reckoning in all pictures."""
RIGHT, WRONG, DENIED = CURVE_COLORS[2], CURVE_COLORS[1], CURVE_COLORS[4]
"""Colours of loops: closed rightly, closed wrongly, refused."""
INK = "#333333"
_MARGIN = 0.05
_FLATTEST, _STEEPEST = 0.25, 1.6

Bounds = NDArray[np.float64]


def draw_map(scene: Scene) -> "Figure":
    """Draw the map over the ground truth and dead reckoning, with its links and loops."""
    figure, axis = single_map(scene, bounds_of([scene], scene.reckoned))
    axis.plot(
        *scene.reckoned[:, :2].T, color=RECKONED, lw=1, ls="--", zorder=2, label="dead reckoning"
    )
    _draw_links(axis, scene, counted=True)
    _mark_ends(axis, scene)
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def single_map(scene: Scene, bounds: Bounds) -> tuple["Figure", "Axes"]:
    """Return a picture of these bounds that shows only the ground truth so far."""
    ratio = ratio_of(bounds)
    width = 8.2 if ratio < 1 else 6.0
    figure = new_figure(width, 1.4 + (width - 0.8) * ratio)
    axis = figure.add_subplot()
    draw_truth(axis, scene, lw=3.5)
    frame(axis, bounds)
    axis.set(xlabel="x (m)", ylabel="y (m)")
    return figure, axis


@checked
def map_figure(
    runs: Sequence[RatSlamRun],
    reports: Sequence[MapReport] | None = None,
    *,
    titles: Sequence[str] | None = None,
) -> "Figure":
    """Draw the true trajectory beside the maps of several runs, all at one scale.

    The layout follows figures 5.13 to 5.15 of the thesis.

    Args:
        runs: over the same drive; the first one with ground truth gives the trajectory.
        reports: reports on the runs; None computes them.
        titles: titles of the maps; None for the place recognition of each.

    Raises:
        DataError: no runs, or not one title per run.
    """
    names = [run.views for run in runs] if titles is None else list(titles)
    known = [judge_map(run) for run in runs] if reports is None else list(reports)
    if not len(runs) or not len(names) == len(known) == len(runs):
        given = f"{len(runs)} runs, {len(known)} reports and {len(names)} titles"
        problem = f"picture of maps: {given}, expected one of each, and one run at least"
        raise DataError(problem, code="counts-differ")
    with use_style():
        return side_by_side([scene_of(*pair) for pair in zip(runs, known, strict=True)], names)


def side_by_side(scenes: Sequence[Scene], names: Sequence[str]) -> "Figure":
    """Draw as ``map_figure``, for runs that are already aligned with the ground truth."""
    exact = next((scene for scene in scenes if scene.truth is not None), None)
    bounds, count = bounds_of(scenes), len(scenes) + (exact is not None)
    figure, panels = _make_panels(count, ratio_of(bounds))
    if exact is not None:
        first, panels = panels[0], panels[1:]
        draw_truth(first, exact, color=INK, lw=1.2)
        frame(first, bounds)
        first.set_title("exact trajectory")
    for axis, scene, name in zip(panels, scenes, names, strict=False):
        draw_truth(axis, scene, lw=2.5)
        _draw_links(axis, scene, counted=False)
        frame(axis, bounds)
        words, errors = count_noun(len(scene.nodes), "node"), scene.report.nodes
        axis.set_title(f"{name}\n{words}" + (f", RMSE {errors.rmse_m:.2f} m" if errors else ""))
    found = [axis.get_legend_handles_labels() for axis in panels]
    handles = {name: one for ones, names in found for one, name in zip(ones, names, strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=5)
    return figure


def _make_panels(count: int, ratio: float) -> tuple["Figure", list["Axes"]]:
    """Return a figure with ``count`` panels whose height is ``ratio`` times their width."""
    most = 2 if ratio < 0.4 else 3 if ratio < 0.9 else 4
    down = -(-count // most)
    across = -(-count // down)
    width = 9.2 / across - 0.45
    figure = new_figure(9.2, 0.7 + down * (0.75 + width * ratio))
    panels = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True)
    for axis in panels.flat[count:]:
        axis.set_axis_off()
    for axis in panels[-1]:
        axis.set_xlabel("x (m)")
    for axis in panels[:, 0]:
        axis.set_ylabel("y (m)")
    return figure, list(panels.flat[:count])


def draw_truth(axis: "Axes", scene: Scene, *, lw: float, color: str = PATH) -> None:
    """Draw the true path, if known."""
    if scene.truth is not None:
        axis.plot(*scene.truth[:, :2].T, color=color, lw=lw, alpha=0.75, zorder=1, label="truth")


def _draw_links(axis: "Axes", scene: Scene, *, counted: bool) -> None:
    """Draw links and nodes, and loops by their outcome."""
    axis.add_collection(lines_between(scene, pairs_of(scene.run.links[~scene.loops]), MAP, 1.0, 3))
    axis.plot(*scene.nodes[:, :2].T, ".-", color=MAP, ms=3, lw=0, zorder=4)
    axis.plot([], [], ".-", color=MAP, ms=3, lw=1, label="experience map")
    run, name = scene.run, "loop" if scene.truth is None else "right loop"
    refused = pairs_of(run.refused[find_denied(run)])
    for order, (pairs, color, fill, marker, style, kind) in enumerate(
        (
            (refused, DENIED, "white", "^", "--", "refused loop"),
            (pairs_of(run.links[scene.right]), RIGHT, "white", "o", "-", name),
            (pairs_of(run.links[scene.false]), WRONG, WRONG, "X", "-", "false loop"),
        ),
        start=5,
    ):
        if len(pairs):
            label = count_noun(len(pairs), kind) if counted else f"{kind}s"
            # Hundreds of long lines must not hide the map.
            alpha = float(np.clip(40 / len(pairs), 0.2, 0.85))
            axis.add_collection(lines_between(scene, pairs, color, 1.3, order, style, alpha=alpha))
            # Correct loops are short: without markers at their ends they would be invisible.
            drawn: dict[str, Any] = {"mfc": fill, "mec": color, "ms": 4.5, "mew": 1.1}
            axis.plot(*scene.nodes[np.unique(pairs), :2].T, marker, zorder=order, **drawn)
            axis.plot([], [], marker, ls=style, color=color, lw=1.3, label=label, **drawn)


def count_noun(number: int, word: str) -> str:
    """Number and noun, as in "1 loop" and "2 loops"."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def pairs_of(links: NDArray[np.void]) -> NDArray[np.int64]:
    """int64 (l, 2): sources and targets."""
    return np.stack([links["source"], links["target"]], axis=1)


def lines_between(
    scene: Scene,
    pairs: NDArray[np.int64],
    color: str,
    width: float,
    order: int,
    style: str = "-",
    alpha: float = 1.0,
) -> "LineCollection":
    """Lines between pairs of nodes, int64 (m, 2)."""
    from matplotlib.collections import LineCollection

    segments = list(scene.nodes[pairs, :2])
    return LineCollection(
        segments, colors=color, lw=width, zorder=order, linestyles=style, alpha=alpha
    )


def _mark_ends(axis: "Axes", scene: Scene) -> None:
    """Mark the start and end of the path so that neither hides the other."""
    # The robot is not on the map before its first node.
    first = int(np.argmax(scene.run.node_ids >= 0))
    mark_place(axis, scene.path[first], "D", 8, "start", fill="white")
    mark_place(axis, scene.path[-1], "s", 4.5, "end")


def mark_place(
    axis: "Axes", pose: Floats, marker: str, size: float, label: str, fill: str = INK
) -> None:
    """Draw a marker at a pose above everything else."""
    axis.plot(*pose[:2], marker, mfc=fill, mec=INK, ms=size, ls="", zorder=8, label=label)


def bounds_of(scenes: Sequence[Scene], *more: Bounds) -> Bounds:
    """float64 (2, 2): low and high corner of maps and true paths, with a margin."""
    shown = [scene.nodes for scene in scenes] + [scene.path for scene in scenes]
    shown += [scene.truth for scene in scenes if scene.truth is not None] + list(more)
    places = np.concatenate(shown)[:, :2]
    # The truth of a map that was continued may be known in part.
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    edge = np.maximum(_MARGIN * (high - low).max(), 0.5)
    return np.stack([low - edge, high + edge])


def ratio_of(bounds: Bounds) -> float:
    """Ratio of height to width of these bounds."""
    wide, tall = bounds[1] - bounds[0]
    return float(np.clip(tall / wide, _FLATTEST, _STEEPEST))


def frame(axis: "Axes", bounds: Bounds) -> None:
    """Show these bounds at equal scale on both axes."""
    axis.set(xlim=bounds[:, 0], ylim=bounds[:, 1])
    axis.set_aspect("equal")
