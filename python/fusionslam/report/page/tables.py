# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the reports as text cells, with the best cell of each column marked."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Column(Generic[T]):
    """A column of a table: where its value comes from, its format, and which value is best.

    Attributes:
        title, hint: heading and its explanation.
        value: gives the value of a row's item; None is shown as a dash.
        show: format string of the value.
        best: max, min, or None if no value is better than another.
    """

    title: str
    hint: str
    value: Callable[[T], float | None]
    show: str
    best: Callable[[Sequence[float]], float] | None = None


@dataclass(frozen=True)
class Cell:
    """Text of a cell, and whether it is the best of its column."""

    text: str
    best: bool = False


@dataclass(frozen=True)
class Table:
    """Headings (title, hint), row labels and cells."""

    heads: list[tuple[str, str]]
    rows: list[tuple[str, list[Cell]]]

    def markdown(self, corner: str = "") -> str:
        """Format the table as Markdown, the best values in bold; ``corner`` heads the labels."""
        lines = [
            f"| {' | '.join([corner, *(title for title, _ in self.heads)])} |",
            f"|---|{'--:|' * len(self.heads)}",
        ]
        for label, cells in self.rows:
            texts = (f"**{cell.text}**" if cell.best else cell.text for cell in cells)
            lines.append(f"| {' | '.join([label, *texts])} |")
        return "\n".join(lines)


def build_table(
    columns: Sequence[Column[T]], things: Sequence[T], label: Callable[[T], str]
) -> Table:
    """Build a table with one row per item."""
    cells = [_cells(column, [column.value(thing) for thing in things]) for column in columns]
    rows = [(label(thing), [column[row] for column in cells]) for row, thing in enumerate(things)]
    return Table([(column.title, column.hint) for column in columns], rows)


def _cells(column: Column[T], values: Sequence[float | None]) -> list[Cell]:
    texts = ["\N{EN DASH}" if value is None else column.show.format(value) for value in values]
    known = [value for value in values if value is not None]
    if column.best is None or len(known) < 2:
        return [Cell(text) for text in texts]
    # Values that look the same are equally good.
    best = column.show.format(column.best(known))
    return [Cell(text, best=text == best) for text in texts]
