# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Picture of the fastest path over a map from one node to another."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam.argument_types import checked
from fusionslam.evaluation import judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam.experience_map import Route, quickest_route
from fusionslam.report.maps.aligned_run import Scene, scene_of
from fusionslam.report.maps.map_figures import (
    bounds_of,
    count_noun,
    lines_between,
    mark_place,
    pairs_of,
    single_map,
)
from fusionslam.report.page.figures import CURVE_COLORS, use_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LINK, _ROUTE = CURVE_COLORS[5], CURVE_COLORS[1]
_ARROWS = 8


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
    """Draw as ``path_figure``, for a known path."""
    figure, axis = single_map(scene, bounds_of([scene]))
    axis.add_collection(lines_between(scene, pairs_of(scene.run.links), _LINK, 0.9, 2))
    axis.plot([], [], color=_LINK, lw=0.9, label="links of the map")
    places = scene.nodes[route.ids, :2]
    axis.plot(*places.T, ".-", color=_ROUTE, lw=2.2, ms=6, zorder=4, label="quickest way")
    _draw_arrows(axis, places)
    mark_place(axis, places[0], "D", 8, f"from node {route.ids[0]}", fill="white")
    mark_place(axis, places[-1], "*", 13, f"to node {route.ids[-1]}")
    axis.set_title(describe_route(route, places))
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def describe_route(route: Route, places: NDArray[np.float64]) -> str:
    """Describe the length of a path: links, metres on the map, seconds as driven."""
    metres = float(np.hypot(*np.diff(places, axis=0).T).sum())
    return (
        f"from node {route.ids[0]} to node {route.ids[-1]}: "
        f"{count_noun(len(route.ids) - 1, 'link')}, {metres:.1f} m, {route.seconds:.1f} s"
    )


def _draw_arrows(axis: "Axes", places: NDArray[np.float64]) -> None:
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
