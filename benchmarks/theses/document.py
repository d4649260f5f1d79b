# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Building blocks of the page: chapters of sentences, tables and pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from fusionslam.report.page.images import Picture
from fusionslam.report.page.tables import Cell, Table

DASH = "\N{EN DASH}"


@dataclass(frozen=True)
class Block:
    """A sentence, a table or a picture.

    Attributes:
        text: the sentence, or the title of the table.
        table, corner: the table, and the heading of its first column.
        picture: the picture with its caption.
        worded: True if the table holds sentences, not figures.
    """

    text: str = ""
    table: Table | None = None
    corner: str = ""
    picture: Picture | None = None
    worded: bool = False


@dataclass
class Chapter:
    """A heading and its blocks."""

    title: str
    blocks: list[Block] = field(default_factory=list)

    def say(self, text: str) -> None:
        """Add a sentence."""
        self.blocks.append(Block(text))

    def show(self, text: str, table: Table, corner: str, *, worded: bool = False) -> None:
        """Add a table under its title."""
        self.blocks.append(Block(text, table, corner, worded=worded))

    def picture(self, picture: Picture | None) -> None:
        """Add a picture, if there is one."""
        if picture is not None:
            self.blocks.append(Block(picture=picture))


@dataclass(frozen=True)
class Head:
    """A column: heading, its explanation, and the text of a row's cell; empty is a dash."""

    title: str
    hint: str
    text: Callable[[str], str]


def table_of(
    rows: Sequence[str], heads: Sequence[Head], labels: Mapping[str, str] | None = None
) -> Table:
    """Build a table of texts; ``labels`` gives the displayed names of the rows."""
    names = labels or {}
    cells = [
        (names.get(row, row), [Cell(head.text(row) or DASH) for head in heads]) for row in rows
    ]
    return Table([(head.title, head.hint) for head in heads], cells)


def shown(value: float | None, show: str, scale: float = 1.0) -> str:
    """Format a figure; a dash if it is None."""
    known = scaled(value, scale)
    return DASH if known is None else show.format(known)


def scaled(value: float | None, scale: float) -> float | None:
    """Convert a figure to another unit; None stays None."""
    return None if value is None else value * scale


def as_markdown(chapters: Sequence[Chapter]) -> str:
    """Format the sentences and tables of all chapters as Markdown."""
    parts = []
    for chapter in chapters:
        parts.append(f"## {chapter.title}")
        for block in chapter.blocks:
            if block.text:
                parts.append(f"**{block.text}**" if block.table else block.text)
            if block.table:
                parts.append(block.table.markdown(block.corner))
    return "\n\n".join(parts) + "\n"
