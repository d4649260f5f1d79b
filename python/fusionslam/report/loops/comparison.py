# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors side by side: accuracy with and without verification, and cost, in one table."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fusionslam.evaluation import DIRECTIONS, DescriptorRun, Evaluation, VerifiedRun
from fusionslam.report.loops.labels import run_label, source_name
from fusionslam.report.page.figures import CURVE_COLORS, new_figure
from fusionslam.report.page.html import group_by
from fusionslam.report.page.tables import Cell, Column, Table, build_table
from fusionslam.storage.csv_files import write_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COSTS_CAPTION = (
    "Accuracy over the time to make a descriptor and to compare it with all frames before; up and "
    "left is better. The area of a mark grows with the bytes of a descriptor."
)


@dataclass(frozen=True, eq=False)
class Compared:
    """A descriptor on one source of one recording.

    Attributes:
        plain: its own matches.
        verified: the loops among its candidates that are proven; None if they are not.
    """

    plain: Evaluation
    verified: Evaluation | None = None

    @property
    def key(self) -> tuple[str, str]:
        """Source and name of the descriptor: ("lidar", "cm2dp:author")."""
        return self.plain.run.source, self.plain.run.name


Columns = list[Column[Compared]]


def pair_up(evaluations: Sequence[Evaluation]) -> list[Compared]:
    """Join each descriptor with the loops that are proven of its candidates alone."""
    proven = {
        (each.run.source, each.run.descriptors[0]): each
        for each in evaluations
        if isinstance(each.run, VerifiedRun) and len(each.run.descriptors) == 1
    }
    return [
        Compared(each, proven.get((each.run.source, each.run.name)))
        for each in evaluations
        if isinstance(each.run, DescriptorRun)
    ]


def comparison_columns(compared: Sequence[Compared], protocol: str) -> Columns:
    """Accuracy, accuracy with verification if any is verified, and cost."""
    columns = accuracy_columns(protocol)
    if any(each.verified for each in compared):
        columns += verified_columns(protocol)
    return columns + cost_columns()


def accuracy_columns(protocol: str) -> Columns:
    """Figures of the descriptor's own matches."""

    def column(title: str, hint: str, figure: str) -> Column[Compared]:
        return Column(title, hint, _of_curve("plain", protocol, figure), "{:.3f}", max)

    def ranked(k: int) -> Column[Compared]:
        def read(item: Compared) -> float | None:
            curve = item.plain.curves.get(protocol)
            recalls = getattr(curve, "recall_at_k", None) or {}
            return recalls.get(k)

        return Column(f"r@{k}", f"revisits with a correct one among {k}", read, "{:.3f}", max)

    titles = {"same": "same way", "opposite": "opposite", "crossing": "crossing"}
    return [
        column("top-1", "revisits whose nearest is correct", "top1"),
        *(
            Column(
                titles[kind],
                f"top-1 of revisits by direction: {kind}",
                f"plain.by_direction.{protocol}.{kind}.top1",
                "{:.3f}",
                max,
            )
            for kind in DIRECTIONS
        ),
        ranked(5),
        ranked(10),
        column("R@100P", "recall at 100 % precision", "recall_at_full_precision"),
        column("max F1", "largest 2PR / (P + R)", "max_f1"),
        column("AP", "average precision", "average_precision"),
    ]


def verified_columns(protocol: str) -> Columns:
    """Figures of the loops among the descriptor's candidates that registration proves."""
    top = _of_curve("verified", protocol, "top1")
    full = _of_curve("verified", protocol, "recall_at_full_precision")
    loops = f"verified.accepted.{protocol}"
    return [
        Column(
            "top-1 ver.", "verified: revisits whose most probable is correct", top, "{:.3f}", max
        ),
        Column("R@100P ver.", "verified: recall at 100 % precision", full, "{:.3f}", max),
        Column("loops", "verified and accepted", f"{loops}.loops", "{:.0f}"),
        Column("wrong", "of these loops", f"{loops}.wrong", "{:.0f}", min),
    ]


def cost_columns() -> Columns:
    """What a descriptor costs: size, time and memory."""
    costs = "plain.costs"
    peak = "working memory to make the descriptor of the largest cloud"
    make = "to make one descriptor of a cloud: median, ms"
    compare = "to compare one query with all frames before it: median, ms"
    return [
        Column("bytes", "of one descriptor", f"{costs}.bytes_per_descriptor", "{:,.0f}", min),
        Column("make ms", make, f"{costs}.stages.describe.median_ms", "{:.1f}", min),
        Column("compare ms", compare, f"{costs}.stages.match.median_ms", "{:.2f}", min),
        Column("MiB", peak, f"{costs}.peak_memory_bytes", "{:,.1f}", min, scale=2**-20),
    ]


def _of_curve(which: str, protocol: str, figure: str) -> Callable[[Compared], Any]:
    """Reader of a figure that some protocols' curves lack."""

    def read(item: Compared) -> Any:
        evaluation: Evaluation | None = getattr(item, which)
        curve = None if evaluation is None else evaluation.curves.get(protocol)
        return getattr(curve, figure, None)

    return read


def row_labels(compared: Sequence[Compared]) -> list[str]:
    """Label of each row; with its source where there are several."""
    sources = {each.key[0] for each in compared}
    return [
        run_label(each.plain.run)
        if len(sources) == 1
        else f"{source_name(each.key[0], sources)}, {run_label(each.plain.run)}"
        for each in compared
    ]


def comparison_table(
    compared: Sequence[Compared], protocol: str, columns: Columns | None = None
) -> Table:
    """One row per source and descriptor, with its preset if it has one."""
    if columns is None:
        columns = comparison_columns(compared, protocol)
    return build_table(columns, compared, row_labels(compared))


def table_over(
    recordings: Sequence[Sequence[Compared]], protocol: str, columns: Columns | None = None
) -> Table:
    """``comparison_table`` over several recordings: "mean (lowest to highest)" in each cell.

    A figure that is not defined in some recordings is that of the others; a descriptor that cannot
    describe some of them has a row all the same.
    """
    everything = [each for recording in recordings for each in recording]
    if columns is None:
        columns = comparison_columns(everything, protocol)
    rows = group_by(everything, lambda each: "\0".join(each.key))
    labels = row_labels([row[0] for row in rows.values()])
    values = [[_values(column, row) for row in rows.values()] for column in columns]
    cells = [_mark_best(column, found) for column, found in zip(columns, values, strict=True)]
    heads = [(column.title, column.hint) for column in columns]
    return Table(heads, [(label, [c[row] for c in cells]) for row, label in enumerate(labels)])


def _values(column: Column[Compared], row: Sequence[Compared]) -> list[float]:
    return [value for value in map(column.read, row) if value is not None]


def mean_and_range(values: Sequence[float], show: str = "{:.3f}") -> str:
    """Format as ``0.31 (0.22 to 0.40)``; the value alone where all are equal."""
    mean, low, high = (show.format(of(values)) for of in (np.mean, min, max))
    return mean if low == high else f"{mean} ({low} to {high})"


def _mark_best(column: Column[Compared], rows: Sequence[Sequence[float]]) -> list[Cell]:
    means = [float(np.mean(values)) for values in rows if values]
    best = column.show.format(column.best(means)) if column.best and len(means) > 1 else None
    return [
        Cell(mean_and_range(values, column.show), column.show.format(np.mean(values)) == best)
        if values
        else Cell("\N{EN DASH}")
        for values in rows
    ]


def comparison_rows(
    recordings: Mapping[str, Sequence[Compared]], protocol: str
) -> tuple[list[str], Iterator[list[object]]]:
    """Heads and rows of comparison.csv: unrounded, one row per recording and descriptor."""
    everything = [each for recording in recordings.values() for each in recording]
    columns = comparison_columns(everything, protocol)
    heads = ["recording", "source", "descriptor", *(column.title for column in columns)]

    def rows() -> Iterator[list[object]]:
        for name, compared in recordings.items():
            for each in compared:
                values = (column.read(each) for column in columns)
                yield [name, *each.key, *("" if value is None else value for value in values)]

    return heads, rows()


def write_comparison(
    folder: Path, recordings: Mapping[str, Sequence[Compared]], protocol: str
) -> Path:
    """Write comparison.csv into a folder; return its path. Raises DataError."""
    path = folder / "comparison.csv"
    write_csv(path, *comparison_rows(recordings, protocol))
    return path


def draw_costs(recordings: Sequence[Sequence[Compared]], protocol: str) -> "Figure | None":
    """Draw accuracy against the time to make and to compare a descriptor; None without accuracy.

    Of several recordings, means. The area of a mark grows with the bytes of a descriptor.
    """
    from matplotlib.ticker import LogLocator

    everything = [each for recording in recordings for each in recording]
    columns = {column.title: column for column in comparison_columns(everything, protocol)}
    rows = group_by(everything, lambda each: "\0".join(each.key))
    panels = [name for name in ("top-1", "R@100P", "R@100P ver.") if name in columns]
    points = [
        {title: _mean(column, row) for title, column in columns.items()} for row in rows.values()
    ]
    panels = [name for name in panels if any(point[name] is not None for point in points)]
    if not panels:
        return None
    sources = [row[0].key[0] for row in rows.values()]
    figure = new_figure(4.6 * len(panels), 4.8)
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axis, name in zip(axes, panels, strict=True):
        for label, source, point in zip(
            [run_label(row[0].plain.run) for row in rows.values()], sources, points, strict=True
        ):
            _mark(axis, label, point, name, list(dict.fromkeys(sources)).index(source))
        axis.set(xlabel="ms to make and to compare", xscale="log", title=columns[name].hint)
        axis.margins(x=0.15)
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter("")
        axis.set_ylim(-0.03, 1.03)
        axis.grid(color="#eeeeee", zorder=0)
    if len(set(sources)) > 1:
        for place, source in enumerate(dict.fromkeys(sources)):
            axes[0].plot([], [], "o", color=_color(place), label=source_name(source, sources))
        figure.legend(loc="outside lower center", ncols=3)
    figure.canvas.draw()  # sets the layout, on which it depends what overlaps
    for axis in axes:
        _separate_labels(axis)
    return figure


def _mean(column: Column[Compared], row: Sequence[Compared]) -> float | None:
    values = _values(column, row)
    return float(np.mean(values)) if values else None


def _mark(
    axis: "Axes", label: str, point: Mapping[str, float | None], figure: str, place: int
) -> None:
    make, value = point["make ms"], point[figure]
    if make is None or value is None:
        return
    cost = make + (point["compare ms"] or 0.0)
    area = 12 + 6 * np.sqrt((point["bytes"] or 0.0) / 256)
    axis.scatter(cost, value, s=area, color=_color(place), alpha=0.75, zorder=2, lw=0)
    line = {"arrowstyle": "-", "color": "#999999", "lw": 0.4, "shrinkA": 0, "shrinkB": 2}
    axis.annotate(
        label,
        (cost, value),
        (3, 3),
        textcoords="offset points",
        fontsize=6.5,
        zorder=3,
        arrowprops=line,
    )


_CORNERS: Sequence[tuple[float, float, int, Literal["left", "right"]]] = (
    (3, 3, 1, "left"),
    (3, -8, -1, "left"),
    (-3, 3, 1, "right"),
    (-3, -8, -1, "right"),
)
_PLACES = tuple(
    ((x, y + shift * up), end) for shift in range(0, 61, 6) for x, y, up, end in _CORNERS
)
"""Of a label beside its mark, in points, and its end that is there; the best one first."""


def _separate_labels(axis: "Axes") -> None:
    """Move labels to a side of their marks where they cover no other one, if there is one."""
    from matplotlib.text import Annotation, Text

    labels = [each for each in axis.texts if isinstance(each, Annotation)]
    placed: list[Any] = []
    for label in sorted(labels, key=lambda each: -each.xy[1]):
        for offset, end in (*_PLACES, _PLACES[0]):
            label.set_position(offset)
            label.set_horizontalalignment(end)
            extent = Text.get_window_extent(label)  # without its line
            if not any(extent.overlaps(other) for other in placed):
                break
        placed.append(extent)


def _color(place: int) -> str:
    return CURVE_COLORS[place % len(CURVE_COLORS)]
