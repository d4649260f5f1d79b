# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables for the documentation, written between markers of a page."""

from collections.abc import Sequence
from pathlib import Path


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(str(cell) for cell in line)} |" for line in lines)


def read_rows(page: Path, name: str) -> list[list[str]]:
    """Return the cells of the table between the markers ``<!-- name: ... -->``, below its head."""
    content = page.read_text(encoding="utf-8").split(f"<!-- {name}:")[1].split("<!-- end -->")[0]
    lines = [line for line in content.splitlines() if line.startswith("| ")]
    return [line.strip("| ").split(" | ") for line in lines[2:]]


def write_between(page: Path, name: str, text: str) -> None:
    """Replace what stands between the markers ``<!-- name: ... -->`` and ``<!-- end -->``."""
    content = page.read_text(encoding="utf-8")
    start = content.index("\n", content.index(f"<!-- {name}:")) + 1
    end = content.index("<!-- end -->", start)
    page.write_text(content[:start] + text + "\n" + content[end:], encoding="utf-8")
