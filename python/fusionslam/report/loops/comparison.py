# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors side by side: accuracy with and without verification, and cost, in one table.

``write_several`` writes comparison.html, over several recordings.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fusionslam.base.csv_files import write_csv
from fusionslam.evaluation import DescriptorRun, Evaluation, VerifiedRun
from fusionslam.report.loops.labels import run_label, source_name
from fusionslam.report.page.figures import CURVE_COLORS, new_figure, use_style
from fusionslam.report.page.html import about_report, check_extra, group_by, write_page
from fusionslam.report.page.images import keep
from fusionslam.report.page.tables import (
    DASH,
    Column,
    Table,
    build_cells,
    build_table,
    columns_of,
    table_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    return columns_of("descriptors.accuracy", protocol=protocol)


def verified_columns(protocol: str) -> Columns:
    """Figures of the loops among the descriptor's candidates that registration proves."""
    return columns_of("descriptors.verified", protocol=protocol)


def cost_columns() -> Columns:
    """What a descriptor costs: size, time and memory."""
    return columns_of("descriptors.costs")


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
    rows = _by_descriptor(everything)
    labels = row_labels([row[0] for row in rows])
    cells = []
    for column in columns:
        values = [_values(column, row) for row in rows]
        means = [float(np.mean(row)) if row else None for row in values]
        ranges = [mean_and_range(row, column.show) if row else DASH for row in values]
        cells.append(build_cells(column, means, ranges))
    return table_of(columns, labels, cells)


def tables_over(recordings: Mapping[str, Sequence[Evaluation]], protocol: str) -> dict[str, Table]:
    """Tables by name of the source: mean and range over the recordings of each descriptor."""
    compared = [pair_up(evaluations) for evaluations in recordings.values()]
    everything = [each for recording in compared for each in recording]
    sources = list(dict.fromkeys(each.key[0] for each in everything))
    columns = comparison_columns(everything, protocol)
    return {
        source_name(source, sources): table_over(
            [[each for each in recording if each.key[0] == source] for recording in compared],
            protocol,
            columns,
        )
        for source in sources
    }


def _by_descriptor(everything: Sequence[Compared]) -> list[list[Compared]]:
    """Group those of one source and descriptor."""
    return [*group_by(everything, lambda each: each.key).values()]


def _values(column: Column[Compared], row: Sequence[Compared]) -> list[float]:
    return [value for value in map(column.read, row) if value is not None]


def mean_and_range(values: Sequence[float], show: str = "{:.3f}") -> str:
    """Format as ``0.31 (0.22 to 0.40)``; the value alone where all are equal."""
    mean, low, high = (show.format(of(values)) for of in (np.mean, min, max))
    return mean if low == high else f"{mean} ({low} to {high})"


def write_comparison(
    folder: Path, recordings: Mapping[str, Sequence[Compared]], protocol: str
) -> Path:
    """Write comparison.csv into a folder: unrounded, one row per recording and descriptor.

    Returns its path. Raises DataError.
    """
    everything = [each for recording in recordings.values() for each in recording]
    columns = comparison_columns(everything, protocol)
    rows = (
        [
            name,
            *each.key,
            *("" if (value := column.read(each)) is None else value for column in columns),
        ]
        for name, compared in recordings.items()
        for each in compared
    )
    heads = ["recording", "source", "descriptor", *(column.title for column in columns)]
    write_csv(folder / "comparison.csv", heads, rows)
    return folder / "comparison.csv"


def write_several(
    folder: str | os.PathLike[str],
    recordings: Mapping[str, Sequence[Evaluation]],
    *,
    protocol: str,
    command: str,
    config: Mapping[str, Any],
    page: bool = True,
) -> Path:
    """Write comparison.csv and, beside it, comparison.html with its picture.

    Args:
        folder: created if missing.
        recordings: evaluations by name of the recording.
        protocol: that judges matches.
        command, config: that the evaluations were made with.
        page: whether to write more than the table.

    Returns:
        The path of the page, or of the table without one.

    Raises:
        DataError: the folder cannot be written.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    target = Path(folder)
    compared = {name: pair_up(evaluations) for name, evaluations in recordings.items()}
    path = write_comparison(target, compared, protocol)
    if not page:
        return path
    check_extra()
    with use_style():
        costs = draw_costs([*compared.values()], protocol)
        picture = keep(target, "accuracy_cost", costs)
    return write_page(
        target / "comparison.html",
        "comparison.html.j2",
        about_report(", ".join(recordings), command, config),
        title="Descriptors compared",
        recordings=[*recordings],
        protocol=protocol,
        tables=tables_over(recordings, protocol),
        costs=picture,
    )


def draw_costs(recordings: Sequence[Sequence[Compared]], protocol: str) -> "Figure | None":
    """Draw accuracy against the time to make and to compare a descriptor; None without accuracy.

    Of several recordings, means. The area of a mark grows with the bytes of a descriptor.
    """
    from matplotlib.ticker import LogLocator

    everything = [each for recording in recordings for each in recording]
    columns = {column.title: column for column in comparison_columns(everything, protocol)}
    rows = _by_descriptor(everything)
    panels = [name for name in ("top-1", "R@100P", "R@100P ver.") if name in columns]
    points: list[dict[str, float | None]] = [
        {
            title: float(np.mean(values)) if (values := _values(column, row)) else None
            for title, column in columns.items()
        }
        for row in rows
    ]
    panels = [name for name in panels if any(point[name] is not None for point in points)]
    if not panels:
        return None
    labels = [run_label(row[0].plain.run) for row in rows]
    sources = [row[0].key[0] for row in rows]
    colors = dict(zip(dict.fromkeys(sources), cycle(CURVE_COLORS), strict=False))
    figure = new_figure(4.6 * len(panels), 4.8)
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axis, name in zip(axes, panels, strict=True):
        for label, source, point in zip(labels, sources, points, strict=True):
            _mark(axis, label, point, name, colors[source])
        axis.set(xlabel="ms to make and to compare", xscale="log", title=columns[name].hint)
        axis.margins(x=0.15)
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter("")
        axis.set_ylim(-0.03, 1.03)
        axis.grid(color="#eeeeee", zorder=0)
    if len(colors) > 1:
        for source, color in colors.items():
            axes[0].plot([], [], "o", color=color, label=source_name(source, sources))
        figure.legend(loc="outside lower center", ncols=3)
    figure.canvas.draw()  # sets the layout, on which it depends what overlaps
    for axis in axes:
        _separate_labels(axis)
    return figure


def _mark(
    axis: "Axes", label: str, point: Mapping[str, float | None], figure: str, color: str
) -> None:
    make, value = point["make ms"], point[figure]
    if make is None or value is None:
        return
    cost = make + (point["compare ms"] or 0.0)
    area = 12 + 6 * np.sqrt((point["bytes"] or 0.0) / 256)
    axis.scatter(cost, value, s=area, color=color, alpha=0.75, zorder=2, lw=0)
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
