# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of experience maps: over ground truth, side by side, and with a path over one."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats
from fusionslam.base.texts import counted
from fusionslam.errors import DataError
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam.experience_map import Route, quickest_route
from fusionslam.report.maps.aligned_run import Scene, find_denied, scene_of
from fusionslam.report.page.figures import (
    CURVE_COLORS,
    DENIED,
    INK,
    MAP,
    PATH,
    RECKONED,
    RIGHT,
    WRONG,
    new_figure,
    use_style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LINK, _ROUTE = CURVE_COLORS[5], CURVE_COLORS[1]
_ARROWS = 8
_MARGIN = 0.05
_FLATTEST, _STEEPEST = 0.25, 1.6

Bounds = NDArray[np.float64]


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
    bounds = _bounds_of(scenes)
    figure, panels = _make_panels(len(scenes) + (exact is not None), _ratio_of(bounds))
    if exact is not None:
        first, panels = panels[0], panels[1:]
        _draw_truth(first, exact, bounds, color=INK, lw=1.2)
        first.set_title("exact trajectory")
    for axis, scene, name in zip(panels, scenes, names, strict=False):
        _draw_truth(axis, scene, bounds, lw=2.5)
        _draw_links(axis, scene, with_counts=False)
        words, errors = counted(len(scene.nodes), "node"), scene.report.nodes
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


def draw_map(scene: Scene) -> "Figure":
    """Draw the map over the ground truth and dead reckoning, with its links and loops."""
    figure, axis = _single_map(scene, _bounds_of([scene], scene.reckoned))
    reckoned = scene.reckoned[:, :2].T
    axis.plot(*reckoned, color=RECKONED, lw=1, ls="--", zorder=2, label="dead reckoning")
    _draw_links(axis, scene, with_counts=True)
    # The robot is not on the map before its first node; the end does not hide the start.
    first = int(np.argmax(scene.run.node_ids >= 0))
    _mark_place(axis, scene.path[first], "D", 8, "start", fill="white")
    _mark_place(axis, scene.path[-1], "s", 4.5, "end")
    figure.legend(loc="outside lower center", ncols=4)
    return figure


@checked
def path_figure(run: RatSlamRun, a: int, b: int) -> "Figure":
    """Draw the map and on it the fastest path from node a to node b.

    Args:
        run: the run whose final map is shown, aligned with the ground truth if known.
        a, b: ids of nodes.

    Raises:
        DataError: an unknown node, or two that no links connect.
    """
    route = quickest_route(run.links, len(run.nodes), a, b)
    with use_style():
        return draw_route(scene_of(run, judge_map(run)), route)


def draw_route(scene: Scene, route: Route) -> "Figure":
    """Draw as ``path_figure``, for a known path; its length is in metres on the map."""
    figure, axis = _single_map(scene, _bounds_of([scene]))
    _draw_lines(axis, scene, _pairs_of(scene.run.links), color=_LINK, lw=0.9, zorder=2)
    axis.plot([], [], color=_LINK, lw=0.9, label="links of the map")
    places = scene.nodes[route.ids, :2]
    axis.plot(*places.T, ".-", color=_ROUTE, lw=2.2, ms=6, zorder=4, label="quickest way")
    _draw_arrows(axis, places)
    start, end = f"from node {route.ids[0]}", f"to node {route.ids[-1]}"
    _mark_place(axis, places[0], "D", 8, start, fill="white")
    _mark_place(axis, places[-1], "*", 13, end)
    metres = float(np.hypot(*np.diff(places, axis=0).T).sum())
    links = counted(len(route.ids) - 1, "link")
    axis.set_title(f"{start} {end}: {links}, {metres:.1f} m, {route.seconds:.1f} s")
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def _draw_arrows(axis: "Axes", places: Floats) -> None:
    """Draw arrow heads along the path at even distances."""
    steps = np.diff(places, axis=0)
    lengths = np.hypot(*steps.T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    if not along[-1] > 0:
        return
    for distance in (np.arange(_ARROWS) + 0.5) * along[-1] / _ARROWS:
        row = int(np.searchsorted(along, distance)) - 1
        middle = places[row] + steps[row] * (distance - along[row]) / lengths[row]
        ahead = middle + 1e-3 * steps[row] / lengths[row]
        style = {"arrowstyle": "-|>", "color": _ROUTE, "mutation_scale": 14, "lw": 0}
        axis.annotate("", xy=ahead, xytext=middle, arrowprops=style, zorder=5)


def _single_map(scene: Scene, bounds: Bounds) -> tuple["Figure", "Axes"]:
    """Return a picture of these bounds that shows only the ground truth so far."""
    ratio = _ratio_of(bounds)
    width = 8.2 if ratio < 1 else 6.0
    figure = new_figure(width, 1.4 + (width - 0.8) * ratio)
    axis = figure.add_subplot()
    _draw_truth(axis, scene, bounds, lw=3.5)
    axis.set(xlabel="x (m)", ylabel="y (m)")
    return figure, axis


def _draw_truth(
    axis: "Axes", scene: Scene, bounds: Bounds, *, lw: float, color: str = PATH
) -> None:
    """Show these bounds, with both axes at one scale, and in them the true path, if known."""
    if scene.truth is not None:
        axis.plot(*scene.truth[:, :2].T, color=color, lw=lw, alpha=0.75, zorder=1, label="truth")
    axis.set(xlim=bounds[:, 0], ylim=bounds[:, 1])
    axis.set_aspect("equal")


def _draw_links(axis: "Axes", scene: Scene, *, with_counts: bool) -> None:
    """Draw links and nodes, and loops by their outcome."""
    run, name = scene.run, "loop" if scene.truth is None else "right loop"
    _draw_lines(axis, scene, _pairs_of(run.links[~scene.loops]), color=MAP, lw=1.0, zorder=3)
    axis.plot(*scene.nodes[:, :2].T, ".-", color=MAP, ms=3, lw=0, zorder=4)
    axis.plot([], [], ".-", color=MAP, ms=3, lw=1, label="experience map")
    for order, (links, color, fill, marker, style, kind) in enumerate(
        (
            (run.refused[find_denied(run)], DENIED, "white", "^", "--", "refused loop"),
            (run.links[scene.right], RIGHT, "white", "o", "-", name),
            (run.links[scene.false], WRONG, WRONG, "X", "-", "false loop"),
        ),
        start=5,
    ):
        if not len(links):
            continue
        pairs = _pairs_of(links)
        # Hundreds of long lines must not hide the map.
        alpha = float(np.clip(40 / len(pairs), 0.2, 0.85))
        look: dict[str, Any] = {"color": color, "lw": 1.3, "ls": style}
        _draw_lines(axis, scene, pairs, zorder=order, alpha=alpha, **look)
        # Correct loops are short: without markers at their ends they would be invisible.
        drawn: dict[str, Any] = {"mfc": fill, "mec": color, "ms": 4.5, "mew": 1.1}
        axis.plot(*scene.nodes[np.unique(pairs), :2].T, marker, zorder=order, **drawn)
        label = counted(len(pairs), kind) if with_counts else f"{kind}s"
        axis.plot([], [], marker, label=label, **look, **drawn)


def _draw_lines(axis: "Axes", scene: Scene, pairs: NDArray[np.int64], **look: Any) -> None:
    """Draw lines between pairs of nodes, int64 (m, 2)."""
    from matplotlib.collections import LineCollection

    axis.add_collection(LineCollection(list(scene.nodes[pairs, :2]), **look))


def _pairs_of(links: NDArray[np.void]) -> NDArray[np.int64]:
    """int64 (l, 2): sources and targets."""
    return np.stack([links["source"], links["target"]], axis=1)


def _mark_place(
    axis: "Axes", pose: Floats, marker: str, size: float, label: str, fill: str = INK
) -> None:
    """Draw a marker at a pose above everything else."""
    axis.plot(*pose[:2], marker, mfc=fill, mec=INK, ms=size, ls="", zorder=8, label=label)


def _bounds_of(scenes: Sequence[Scene], *more: Bounds) -> Bounds:
    """float64 (2, 2): low and high corner of maps and true paths, with a margin."""
    shown = [scene.nodes for scene in scenes] + [scene.path for scene in scenes]
    shown += [scene.truth for scene in scenes if scene.truth is not None] + list(more)
    places = np.concatenate(shown)[:, :2]
    # The truth of a map that was continued may be known in part.
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    edge = np.maximum(_MARGIN * (high - low).max(), 0.5)
    return np.stack([low - edge, high + edge])


def _ratio_of(bounds: Bounds) -> float:
    """Ratio of height to width of these bounds."""
    wide, tall = bounds[1] - bounds[0]
    return float(np.clip(tall / wide, _FLATTEST, _STEEPEST))
