# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Building blocks of the page: chapters of sentences, tables and pictures."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from fusionslam.report.page.images import Picture
from fusionslam.report.page.tables import Table


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
