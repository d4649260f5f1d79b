# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the page is made of: chapters of sentences, tables and pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from fusionslam.report.page.images import Picture
from fusionslam.report.page.tables import Cell, Table

DASH = "\N{EN DASH}"


@dataclass(frozen=True)
class Block:
    """A sentence, a table or a picture.

    Attributes:
        text: the sentence, or what a table shows.
        table, corner: with the heading of its first column.
        picture: with its caption.
        worded: whether the table holds sentences, not figures.
    """

    text: str = ""
    table: Table | None = None
    corner: str = ""
    picture: Picture | None = None
    worded: bool = False


@dataclass
class Chapter:
    """A heading and what is below it."""

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
    """A column: heading, what it means, and the text of a row's cell; empty is a dash."""

    title: str
    hint: str
    text: Callable[[str], str]


def table_of(
    rows: Sequence[str], heads: Sequence[Head], labels: Mapping[str, str] | None = None
) -> Table:
    """A table of texts, whose rows are called by name, or as ``labels`` says."""
    names = labels or {}
    cells = [
        (names.get(row, row), [Cell(head.text(row) or DASH) for head in heads]) for row in rows
    ]
    return Table([(head.title, head.hint) for head in heads], cells)


def shown(value: float | None, show: str, scale: float = 1.0) -> str:
    """A figure as text; a dash where there is none."""
    known = scaled(value, scale)
    return DASH if known is None else show.format(known)


def scaled(value: float | None, scale: float) -> float | None:
    """A figure in another unit; None where there is none."""
    return None if value is None else value * scale


def as_markdown(chapters: Sequence[Chapter]) -> str:
    """Sentences and tables of all chapters."""
    parts = []
    for chapter in chapters:
        parts.append(f"## {chapter.title}")
        for block in chapter.blocks:
            if block.text:
                parts.append(f"**{block.text}**" if block.table else block.text)
            if block.table:
                parts.append(block.table.markdown(block.corner))
    return "\n\n".join(parts) + "\n"
