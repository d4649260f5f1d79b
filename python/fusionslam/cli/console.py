# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Console output: tables on stdout; progress and messages on stderr."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING

from fusionslam.base.progress import Step
from fusionslam.base.texts import listed

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable

    from fusionslam.doctor import Finding
    from fusionslam.evaluation import LoopRun
    from fusionslam.report.page.tables import Table

_WIDTH = 160
"""Columns without a terminal."""
_PERIOD = 10.0
"""Seconds between two lines of progress without a terminal."""


def stdout() -> "Console":
    """Return the console for results."""
    from rich.console import Console

    class Patient(Console):
        """Lets the command handle a broken pipe."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    return Patient(width=None if sys.stdout.isatty() else _WIDTH, highlight=False)


def stderr() -> "Console":
    """Return the console for messages."""
    from rich.console import Console

    return Console(stderr=True, width=None if sys.stderr.isatty() else _WIDTH, highlight=False)


@contextmanager
def progress() -> Iterator[Step]:
    """Yield a function that shows the progress of each step: bars; without a terminal, lines."""
    console = stderr()
    if not console.is_terminal:
        yield progress_lines(lambda line: print(line, file=sys.stderr, flush=True))
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


@contextmanager
def during(step: Step, label: str = "opening the recording") -> Iterator[None]:
    """Report the block as one step; opening a long bag, which indexes it, takes a while."""
    step(label, 0, 1)
    yield
    step(label, 1, 1)


def progress_lines(
    write: Callable[[str], None], clock: Callable[[], float] = time.monotonic
) -> Step:
    """Return a function that writes a line when a step begins, and one every ten seconds.

    Args:
        write: receives the lines.
        clock: returns seconds.
    """
    begun: dict[str, float] = {}
    last = clock()

    def show(label: str, done: int, total: int) -> None:
        nonlocal last
        now = clock()
        if label in begun and now - last < _PERIOD:
            return
        line = label if total == 1 else f"{label}: {done:,} of {total:,}"
        if label in begun and 0 < done < total:
            line += f", about {(now - begun[label]) * (total - done) / done:.0f} s left"
        begun.setdefault(label, now)
        last = now
        write(line)

    return show


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table of texts."""
    from rich.markup import escape

    table = _table(heads, right=False)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    stdout().print(table)


def print_findings(findings: "Iterable[Finding]", optional: str) -> None:
    """Print findings, one per row; ``optional`` is the status shown for failed optional ones."""
    rows = [
        ["ok" if each.fine else optional if each.optional else "fault", each.what, each.detail]
        for each in findings
    ]
    print_table(["", "what", "detail"], rows)


def print_figures(title: str, table: "Table", groups: Sequence[tuple[str, int]] = ()) -> None:
    """Print a table of figures under its title, as narrow as possible.

    Args:
        title: of the table; empty for none.
        table: rows in the order of the groups.
        groups: name and number of rows of each; the names stand above them, in a wider table.
    """
    from rich.text import Text

    shown = _table(["", *(head for head, _ in table.heads)], right=True, space=1 if groups else 0)
    rows = iter(table.rows)
    for name, count in groups or [("", len(table.rows))]:
        if groups:
            shown.add_row(Text(name, style="bold"))
        for label, cells in islice(rows, count):
            texts = (Text(cell.text, style="bold" if cell.best else "") for cell in cells)
            shown.add_row(f"  {label}" if groups else label, *texts)
    console = stdout()
    if not groups:
        console.print(Text(title, style="bold"))
    console.print(shown)


def _table(heads: Sequence[str], *, right: bool, space: int = 1) -> "RichTable":
    """Make a table without lines; ``right`` right-aligns all columns but the first."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE, show_edge=False, pad_edge=False, padding=(0, space, 0, 0))
    for place, head in enumerate(heads):
        aside = right and place > 0
        table.add_column(head, justify="right" if aside else "left", no_wrap=right or place == 0)
    return table


def left_out(run: "LoopRun") -> str:
    """List the skipped frames of the run, as the end of a line."""
    if not run.skipped:
        return ""
    reason = next(iter(run.skipped.values()))
    numbers = listed(run.skipped)
    return f"; {len(run.skipped)} left out that cannot be described: {numbers} ({reason})"
