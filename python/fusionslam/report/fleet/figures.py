# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the page of a fleet: the places of a site."""

from typing import TYPE_CHECKING

import numpy as np

from fusionslam.fleet.place_database import Positions
from fusionslam.report.page.figures import CURVE_COLORS, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_NAMED = 12


def draw_site(positions: Positions) -> "Figure | None":
    """Draw the places of a site from above, a colour for each recording; None without poses."""
    known = np.isfinite(positions.poses).all(axis=(1, 2))
    if not known.any():
        return None
    figure = new_figure(6.4, 5.2)
    axis = figure.subplots()
    sessions = np.array(positions.sessions)
    names = sorted({*sessions[known].tolist()})
    for order, name in enumerate(names):
        x, y = positions.poses[known & (sessions == name), :2, 3].T
        label = name if order < _MOST_NAMED else None
        axis.plot(x, y, ".", color=CURVE_COLORS[order % len(CURVE_COLORS)], ms=4, label=label)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="x (m)", ylabel="y (m)")
    figure.legend(loc="outside lower center", ncols=2)
    return figure
