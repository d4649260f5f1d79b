# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures: cost and memory against size."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

from benchmarks.speed.curves import DESCRIPTORS, MAP, OURS, SEARCH, Curve
from benchmarks.speed.memory import Memory

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.ticker import NullFormatter

TITLES = {
    DESCRIPTORS: ("Describing a cloud, one thread", "points"),
    SEARCH: ("Exact nearest neighbour of one query, one thread", "descriptors searched"),
    MAP: ("A loop closed on an experience map, mean of many, one thread", "nodes"),
}
_MARKERS = "osD^vP"


def cost_picture(curves: Sequence[Curve], path: Path) -> None:
    """Time against size on log axes; ours solid, peers dashed, a colour for each work."""
    panels = [panel for panel in TITLES if any(curve.panel == panel for curve in curves)]
    figure, axes = plt.subplots(1, len(panels), figsize=(6.4 * len(panels), 5), squeeze=False)
    for axis, panel in zip(axes[0], panels, strict=True):
        _panel(axis, panel, [curve for curve in curves if curve.panel == panel])
    figure.tight_layout()
    figure.savefig(path, format="png", dpi=120)
    plt.close(figure)


def _panel(axis: Any, panel: str, curves: Sequence[Curve]) -> None:
    works = list(dict.fromkeys(curve.work for curve in curves))
    one = len(works) == 1
    for number, curve in enumerate(curves):
        color = number if one else works.index(curve.work)
        name = curve.who if one else f"{curve.work}, {curve.who}"
        axis.plot(
            curve.sizes,
            [1e3 * seconds for seconds in curve.seconds],
            label=f"{name}: n^{curve.exponent:.2f}",
            color=f"C{color}",
            marker=_MARKERS[color % len(_MARKERS)],
            markersize=4,
            linestyle="-" if curve.who == OURS else "--",
            alpha=1 if curve.who == OURS else 0.7,
        )
    title, unit = TITLES[panel]
    _finish(axis, title, unit, "least time, ms")


def memory_picture(memories: Sequence[Memory], path: Path) -> None:
    """Peak memory of descriptors against points."""
    figure, axis = plt.subplots(figsize=(6.4, 5))
    for memory in (memory for memory in memories if not memory.is_index):
        axis.plot(
            memory.sizes,
            [max(value, 4096) / 2**20 for value in memory.bytes],
            label=f"{memory.work}: {memory.slope:.0f} B a point",
            marker="o",
            markersize=4,
            linestyle="-" if memory.who == OURS else "--",
        )
    _finish(axis, "Peak memory on top of the input", "points", "MiB")
    figure.tight_layout()
    figure.savefig(path, format="png", dpi=120)
    plt.close(figure)


def _finish(axis: Any, title: str, unit: str, what: str) -> None:
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_title(title)
    axis.set_xlabel(unit)
    axis.set_ylabel(what)
    axis.grid(which="both", alpha=0.25)
    axis.legend(fontsize=8)
