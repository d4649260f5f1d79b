# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Style, sizes and colours shared by the figures of all reports."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Okabe and Ito's colours, which colour-blind readers can distinguish.
CURVE_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")


TRUE = "#1a9850"


FALSE = "#d73027"


MISSED = "#f59a0b"


PATH = "#b4b8bf"


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


def styled() -> Any:
    """Return a context in which matplotlib draws in the report's style."""
    import matplotlib

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
