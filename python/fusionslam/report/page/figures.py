# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Style, sizes and colours shared by the figures of all reports."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.errors import FusionSlamError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CURVE_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's colours, which colour-blind readers can distinguish."""
TRUE, FALSE, MISSED, PATH = "#1a9850", "#d73027", "#f59a0b", "#b4b8bf"
INK = "#333333"
DARK = "#15181d"
"""Background of clouds."""
LOOP_COLORS = {"refused": MISSED, "pending": PATH, "believed": TRUE}
"""Of a map's loops by their state."""
TRACK_COLORS = (CURVE_COLORS[0], CURVE_COLORS[3], CURVE_COLORS[5], CURVE_COLORS[6])
"""Of the sessions of a map."""
MAP, RECKONED = CURVE_COLORS[0], CURVE_COLORS[3]
"""Of RatSLAM's map and of dead reckoning."""
RIGHT, WRONG, DENIED = CURVE_COLORS[2], CURVE_COLORS[1], CURVE_COLORS[4]
"""Of RatSLAM's loops: closed rightly, closed wrongly, refused."""
_STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#777777",
    "axes.linewidth": 0.8,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "image.interpolation": "nearest",
}


def use_style() -> Any:
    """Return a context in which matplotlib draws in the report's style.

    Raises:
        FusionSlamError: matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        problem = "pictures need: pip install 'fusionslam[report]'"
        raise FusionSlamError(problem, code="missing-extra", fields=("report",)) from error
    return matplotlib.rc_context(_STYLE)


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure (sizes in inches) that is not registered with pyplot."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", dpi=120)
    FigureCanvasAgg(figure)
    return figure


def widest_axes(points: NDArray[np.floating[Any]]) -> tuple[int, int]:
    """Return the two axes along which points (N, 3) extend most, in ascending order."""
    low, high = np.percentile(points, (1, 99), axis=0)
    first, second = sorted(np.argsort(low - high, kind="stable")[:2].tolist())
    return first, second


def draw_loops(
    axis: "Axes", places: Floats, matched: Integers, *, missed: Mask, right: Mask, wrong: Mask
) -> None:
    """Mark the start of a path from above, its loops with a line to their match, and its misses.

    Args:
        axis: where to draw; both axes get one scale.
        places: float64 (n, 2), metres.
        matched: int64 (n,), row of each match.
        missed, right, wrong: bool (n,), the outcomes.
    """
    from matplotlib.collections import LineCollection

    axis.plot(*places[0], "D", color=INK, ms=5, zorder=5, label="start")
    for order, (mask, color, marker, label) in enumerate(
        (
            (missed, MISSED, "x", "missed revisits"),
            (right, TRUE, "o", "right loops"),
            (wrong, FALSE, "s", "false loops"),
        ),
        start=2,
    ):
        ends = places[mask]
        axis.plot(*ends.T, marker, color=color, ms=3.5, zorder=order, label=f"{mask.sum()} {label}")
        if mask is not missed:
            lines = np.stack([ends, places[matched[mask]]], axis=1)
            axis.add_collection(LineCollection(list(lines), colors=color, lw=0.7, alpha=0.6))
    axis.set_aspect("equal", adjustable="datalim")
