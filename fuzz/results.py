# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The table in docs/results/robustness.md."""

from collections.abc import Iterable

from benchmarks.accuracy.markdown import read_rows, table, write_between
from fuzz import PROJECT
from fuzz.supervisor import Outcome

PAGE = PROJECT / "docs" / "results" / "robustness.md"
FIGURES = ("crashes", "hangs", "memory", "silent", "untyped")


def write_table(outcomes: Iterable[Outcome]) -> None:
    """Write one row a target, and the sums; rows of targets that were not tried stay."""
    rows = {row[0]: row for row in read_rows(PAGE, "fuzz")[:-1]}
    for one in outcomes:
        figures = [getattr(one, figure) for figure in ("inputs", *FIGURES)]
        rows[one.target] = [one.target, *(f"{figure:,}" for figure in figures)]
    done = [rows[name] for name in sorted(rows)]
    sums = [
        sum(int(row[place].replace(",", "")) for row in done)
        for place in range(1, len(FIGURES) + 2)
    ]
    everything = ["all", *(f"{total:,}" for total in sums)]
    write_between(PAGE, "fuzz", table(["target", "inputs", *FIGURES], [*done, everything]))
