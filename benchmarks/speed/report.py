# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A run on the screen, as files, and as the page of the documentation."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from string import Template

import rich.table
from rich.console import Console
from rich.markup import escape

from benchmarks.accuracy.markdown import table as markdown_table
from benchmarks.speed import plots
from benchmarks.speed.inputs import ROOT
from benchmarks.speed.run import PARTS, Run
from benchmarks.speed.tables import Table, bounds, tables
from fusionslam.base.files import atomic_path

PAGE = ROOT / "docs" / "results" / "performance.md"
PICTURE = ROOT / "docs" / "images" / "performance.png"
COST, MEMORY = "performance.png", "memory.png"


def show(run: Run, console: Console) -> None:
    """Tables on the screen."""
    for name, value in {**run.facts, **run.inputs}.items():
        console.print(f"[bold]{name}[/]: {escape(value)}", highlight=False)
    for table in tables(run):
        shown = rich.table.Table(title=table.title, title_justify="left", show_lines=True)
        for column in table.header:
            shown.add_column(column, overflow="fold")
        for row in table.rows:
            shown.add_row(*(_coloured(cell) for cell in row))
        console.print(shown)


def _coloured(cell: str) -> str:
    text = escape(cell)
    if cell == "met":
        return f"[green]{text}[/]"
    return f"[red]{text}[/]" if cell.startswith(("not met", "WRONG")) else text


def store(run: Run, folder: Path) -> None:
    """performance.json and the pictures."""
    reached = bounds(run)
    content = {
        **asdict(run),
        "results": [{**asdict(result), "name": result.name} for result in run.results],
        "curves": [{**asdict(curve), "exponent": _number(curve.exponent)} for curve in run.curves],
        "bounds": [dict(zip(reached.header, row, strict=True)) for row in reached.rows],
        "memories": [{**asdict(m), "bytes_a_point": m.slope} for m in run.memories],
    }
    with atomic_path(folder / "performance.json") as path:
        path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if run.curves:
        with atomic_path(folder / COST) as path:
            plots.cost_picture(run.curves, path)
    if run.memories:
        with atomic_path(folder / MEMORY) as path:
            plots.memory_picture(run.memories, path)


def _number(value: float) -> float | None:
    return None if value != value else value


def write_page(run: Run, folder: Path) -> None:
    """The page and its picture, which ``store`` put into the folder."""
    with atomic_path(PICTURE) as path:
        shutil.copyfile(folder / COST, path)
    with atomic_path(PAGE) as path:
        path.write_text(page(run), encoding="utf-8")


def page(run: Run) -> str:
    """The text of docs/results/performance.md."""
    by_title = {table.title: _markdown(table) for table in tables(run)}
    template = Template((Path(__file__).parent / "page.md").read_text(encoding="utf-8"))
    return template.substitute(
        parts=", ".join(PARTS),
        facts=_list(run.facts),
        inputs=_list(run.inputs),
        bounds=by_title["Bounds"],
        times=by_title["Times: minimum / median / p95"],
        curves=by_title["Cost by size"],
        memory=by_title["Peak memory"],
    )


def _markdown(table: Table) -> str:
    return markdown_table(table.header, table.rows)


def _list(words: Mapping[str, str]) -> str:
    return "\n".join(f"- {name}: {value}" for name, value in words.items())
