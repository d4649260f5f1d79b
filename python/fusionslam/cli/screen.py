# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What people see: tables on stdout; progress and messages on stderr."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from fusionslam.evaluation import Evaluation

Step = Callable[[str, int, int], None]

# Beside the accuracy there is room for what decides between descriptors; the report has the rest.
_LEFT_OUT = {"recall@5", "p95", "load"}
_WIDTH = 160
"""Columns where there is no terminal to ask."""


def stdout() -> "Console":
    """The console of results."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else _WIDTH, highlight=False)


def stderr() -> "Console":
    """The console of messages."""
    from rich.console import Console

    return Console(stderr=True, width=None if sys.stderr.isatty() else _WIDTH, highlight=False)


@contextmanager
def progress() -> Iterator[Step]:
    """A function that shows how far each step is; it shows nothing where nobody looks."""
    console = stderr()
    if not console.is_terminal:
        yield lambda label, done, total: None
        return
    from rich.progress import (
        MofNCompleteColumn,
        Progress,
        TaskID,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn())
    bars = Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console)
    tasks: dict[str, TaskID] = {}

    def show(label: str, done: int, total: int) -> None:
        if label not in tasks:
            tasks[label] = bars.add_task(label, total=total)
        bars.update(tasks[label], completed=done, total=total)

    with bars:
        yield show


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: bool) -> None:
    """A table without lines; with ``numbers`` all columns but the first are right-aligned."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=box.SIMPLE, pad_edge=False)
    for place, head in enumerate(heads):
        right = numbers and place > 0
        table.add_column(head, justify="right" if right else "left", no_wrap=place == 0)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    stdout().print(table)


def print_summary(evaluations: "Sequence[Evaluation]", protocol: str) -> None:
    """Accuracy and cost of every run, as in the report."""
    from fusionslam.report.tables import summary_table

    table = summary_table(evaluations, protocol)
    shown = [place for place, (title, _) in enumerate(table.heads) if title not in _LEFT_OUT]
    heads = ["source / descriptor", *(table.heads[place][0] for place in shown)]
    rows = [[label, *(cells[place].text for place in shown)] for label, cells in table.rows]
    print_table(heads, rows, numbers=True)
    stdout().print(_conditions(evaluations, protocol))


def _conditions(evaluations: "Sequence[Evaluation]", protocol: str) -> str:
    curve = next((e.curves[protocol] for e in evaluations if protocol in e.curves), None)
    if curve is None:
        return "no true poses: cost only (--gt names a file of poses)"
    return (
        f"protocol {protocol}, radius {curve.radius:g} m, window {curve.window} frames: "
        f"{curve.n_revisits} of {curve.n_queries} frames revisit a place; times in ms"
    )
