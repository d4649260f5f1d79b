# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The table in docs/results/robustness.md."""

from collections.abc import Iterable, Sequence

from benchmarks.accuracy.markdown import table, write_between
from fuzz import PROJECT
from fuzz.supervisor import Outcome

PAGE = PROJECT / "docs" / "results" / "robustness.md"
FIGURES = ("crashes", "hangs", "memory", "silent", "untyped")


def write_table(outcomes: Iterable[Outcome]) -> None:
    """Write one row a target, and the sums."""
    done = sorted(outcomes, key=lambda outcome: outcome.target)
    rows = [_row(outcome.target, [outcome]) for outcome in done]
    write_between(PAGE, "fuzz", table(["target", "inputs", *FIGURES], [*rows, _row("all", done)]))


def _row(name: str, outcomes: Sequence[Outcome]) -> list[str]:
    sums = [sum(getattr(one, figure) for one in outcomes) for figure in ("inputs", *FIGURES)]
    return [name, *(f"{number:,}" for number in sums)]
