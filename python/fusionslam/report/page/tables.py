# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The report's tables, as text cells: what stands in them and which cell is the best."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Column(Generic[T]):
    """A column of a table: how its value is found, shown, and judged.

    Attributes:
        title, hint: heading, and what it means.
        value: of one row's thing; None is shown as a dash.
        show: format of the value.
        best: max, min, or None where no value is better than another.
    """

    title: str
    hint: str
    value: Callable[[T], float | None]
    show: str
    best: Callable[[Sequence[float]], float] | None = None


@dataclass(frozen=True)
class Cell:
    """Text, and whether it is the best of its column."""

    text: str
    best: bool = False


@dataclass(frozen=True)
class Table:
    """Headings (title, hint), row labels and cells."""

    heads: list[tuple[str, str]]
    rows: list[tuple[str, list[Cell]]]

    def markdown(self, corner: str = "") -> str:
        """The table as Markdown, the best of each column in bold; ``corner`` heads the labels."""
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
    """One row a thing, with what each column says of it."""
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
