# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the reports as text cells, with the best cell of each column marked."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import yaml

T = TypeVar("T")
DASH = "\N{EN DASH}"
"""Text of an unknown value."""
_BEST = {"max": max, "min": min, None: None}


@dataclass(frozen=True)
class Column(Generic[T]):
    """A column of a table: where its value comes from, its format, and which value is best.

    Attributes:
        title, hint: heading and its explanation.
        value: dotted path from a row's item through attributes and keys, of which those that end in
            a question mark may be lacking; or a function of the item. A value that is None or NaN
            is shown as a dash.
        show: format string of the value.
        best: max, min, or None if no value is better than another.
        scale: factor applied to a number before it is formatted.
    """

    title: str
    hint: str
    value: str | Callable[[T], Any]
    show: str = "{}"
    best: Callable[[Sequence[Any]], Any] | None = None
    scale: float = 1

    def read(self, item: T) -> Any:
        """Return the value of an item, scaled; None if unknown."""
        value = _follow(item, self.value) if isinstance(self.value, str) else self.value(item)
        if value is None or value != value:  # NaN
            return None
        return value if self.scale == 1 else value * self.scale


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


def columns_of(table: str, **names: str) -> list[Column[Any]]:
    """Return columns of ``columns.yaml``; the names fill in the paths of values."""
    return [
        Column(
            **{
                **column,
                "value": column["value"].format(**names),
                "best": _BEST[column.get("best")],
            }
        )
        for column in _stored()[table]
    ]


@cache
def _stored() -> dict[str, list[dict[str, Any]]]:
    path = Path(__file__).with_name("columns.yaml")
    stored: dict[str, list[dict[str, Any]]] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return stored


def build_table(columns: Sequence[Column[T]], items: Sequence[T], labels: Sequence[str]) -> Table:
    """Build a table with one row per item."""
    cells = [build_cells(column, [column.read(item) for item in items]) for column in columns]
    return table_of(columns, labels, cells)


def table_of(
    columns: Sequence[Column[Any]], labels: Sequence[str], cells: Sequence[Sequence[Cell]]
) -> Table:
    """Build a table of the cells of each column."""
    rows = [(label, [column[row] for column in cells]) for row, label in enumerate(labels)]
    return Table([(column.title, column.hint) for column in columns], rows)


def build_cells(
    column: Column[Any], values: Sequence[Any], ranges: Sequence[str] | None = None
) -> list[Cell]:
    """Format the values of a column, None as a dash, and mark the best.

    Args:
        column: gives the format.
        values: of all rows.
        ranges: texts of the cells instead of the values.
    """
    shown = [DASH if value is None else column.show.format(value) for value in values]
    texts = shown if ranges is None else ranges
    known = [value for value in values if value is not None]
    if column.best is None or len(known) < 2:
        return [Cell(text) for text in texts]
    # Values that look the same are equally good.
    best = column.show.format(column.best(known))
    return [Cell(text, best=one == best) for text, one in zip(texts, shown, strict=True)]


def _follow(item: Any, path: str) -> Any:
    """Follow a dotted path of attributes and keys; None from the first one that is unknown."""
    for name in path.split("."):
        if item is None:
            return None
        if isinstance(item, Mapping):
            item = item.get(int(name) if name.isdecimal() else name)
        elif name.endswith("?"):
            item = getattr(item, name[:-1], None)
        else:
            item = getattr(item, name)
    return item
