# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Console output: tables on stdout; progress and messages on stderr."""

import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from fusionslam.help_texts import counted, listed
from fusionslam.storage.progress import Step

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable

    from fusionslam.doctor import Finding
    from fusionslam.evaluation import Evaluation, LoopRun
    from fusionslam.report.loops.comparison import Compared
    from fusionslam.report.page.tables import Table

OPENING = "opening the recording"
"""Name of the step in which a long bag is indexed."""
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


def print_figures(title: str, table: "Table") -> None:
    """Print a table of figures under its title, as narrow as possible."""
    from rich.text import Text

    shown = _table(["", *(head for head, _ in table.heads)], right=True, space=0)
    for label, cells in table.rows:
        shown.add_row(label, *(Text(c.text, style="bold" if c.best else "") for c in cells))
    console = stdout()
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


def print_summary(evaluations: "Sequence[Evaluation]", protocol: str) -> None:
    """Print accuracy and cost of every run, in 80 columns; the report has more."""
    from fusionslam.report.loops.comparison import pair_up
    from fusionslam.report.loops.labels import by_rank, winner
    from fusionslam.report.loops.tables import (
        accuracy_table,
        cost_table,
        peers_table,
        published_table,
    )

    groups = by_rank(evaluations, protocol)
    every = [evaluation for group in groups.values() for evaluation in group]
    compared = [each for each in pair_up(every) if each.verified is not None]
    alone = [each.verified for each in compared]  # in a table of their own
    groups = {name: [e for e in group if e not in alone] for name, group in groups.items()}
    ranked = [evaluation for group in groups.values() for evaluation in group]
    curves = [e.curves[protocol] for e in ranked if protocol in e.curves]
    judged = any(curve.n_revisits for curve in curves)
    tables = [accuracy_table(ranked, protocol)] if judged else []
    published = published_table(ranked, protocol)
    if published.heads:
        tables.append(published)
    sizes = [(name, len(group)) for name, group in groups.items()]
    for table in [*tables, cost_table(ranked)]:
        _print_groups(table, sizes)
    peers = peers_table(ranked, protocol)
    if peers is not None:
        print_figures(f"as published under protocol {protocol}", peers)
        for source in dict.fromkeys(peer.source for each in ranked for peer in each.peers):
            print(textwrap.fill(f"published: {source}", 80))
    lines = [_conditions(ranked, protocol), _COSTS, *_accepted(ranked, protocol)]
    for line in (*lines, winner(every, protocol)):
        if line:
            print(line)
    if judged and compared:
        print_comparison(compared, protocol)
    for line in dict.fromkeys(left_out(evaluation.run) for evaluation in ranked):
        if line:
            print(line.removeprefix(", "))


def print_comparison(compared: "Sequence[Compared]", protocol: str) -> None:
    """Print accuracy with and without verification, and cost, of each descriptor by itself."""
    from fusionslam.report.loops import comparison

    accuracy = comparison.accuracy_columns(protocol)
    kept = [column for column in accuracy if column.title in ("top-1", "opposite", "R@100P")]
    columns = [*kept, *comparison.verified_columns(protocol), *comparison.cost_columns()]
    table = comparison.comparison_table(compared, protocol, columns)
    print_figures("each descriptor by itself, and its candidates verified (ver.)", table)


def _accepted(evaluations: "Sequence[Evaluation]", protocol: str) -> Iterator[str]:
    """Yield lines for each run of verified loops: what was accepted and what proposed them."""
    from fusionslam.evaluation import VerifiedRun

    for evaluation in evaluations:
        run = evaluation.run
        if isinstance(run, VerifiedRun):
            found = evaluation.accepted.get(protocol)
            wrong = "" if found is None else f", {found.wrong} of them wrong"
            loops = counted(int(run.accepted.sum()), "loop")
            yield f"verified, {run.source}: {loops} accepted{wrong}"
            yield f"  candidates of {run.descriptor}"
    if any(isinstance(evaluation.run, VerifiedRun) for evaluation in evaluations):
        yield "match, of verified loops: the registration of their candidates"


_COSTS = (
    "times: medians in ms per frame; peak MiB: additional memory to describe the\n"
    "largest cloud, 0 if less than half a MiB"
)


def left_out(run: "LoopRun") -> str:
    """List the skipped frames of the run, as the end of a line."""
    if not run.skipped:
        return ""
    reason = next(iter(run.skipped.values()))
    numbers = listed(run.skipped)
    return f"; {len(run.skipped)} left out that cannot be described: {numbers} ({reason})"


def _print_groups(table: "Table", groups: Sequence[tuple[str, int]]) -> None:
    """Print a table with named groups of rows."""
    from rich.text import Text

    shown = _table(["", *(title for title, _ in table.heads)], right=True)
    rows = iter(table.rows)
    for name, count in groups:
        shown.add_row(Text(name, style="bold"))
        for _ in range(count):
            label, cells = next(rows)
            shown.add_row(
                f"  {label}", *(Text(c.text, style="bold" if c.best else "") for c in cells)
            )
    stdout().print(shown)


def _conditions(evaluations: "Sequence[Evaluation]", protocol: str) -> str:
    curve = next((e.curves[protocol] for e in evaluations if protocol in e.curves), None)
    if curve is None:
        return "no true poses: cost only (--gt names a file of poses)"
    conditions = f"protocol {protocol}, radius {curve.radius:g} m, window {curve.window}: "
    if curve.judges_pairs:
        return f"{conditions}{curve.counts}"
    if curve.n_revisits:
        revisits, frames = counted(curve.n_revisits, "revisit"), counted(curve.n_queries, "frame")
        return f"{conditions}{revisits} in {frames}"
    return (
        f"{conditions}no frame is a revisit, so there is no\n"
        "accuracy to judge; --set evaluation.window or evaluation.radius may change that"
    )
