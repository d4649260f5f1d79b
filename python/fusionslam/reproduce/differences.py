# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where what was measured is not what was published, and why, as far as that is known."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fusionslam.report.tables import Cell, Table
from fusionslam.reproduce.blocks import DASH, shown

CLOSE = 0.05
"""Figures that differ by no more than this share of the published one count as met."""


@dataclass(frozen=True)
class Difference:
    """A figure that was published for several cases, and what came out.

    Attributes:
        text: what it is.
        published, measured: by case; of the second those that there are.
        show: format of one.
        reason: why they differ, if that is known.
    """

    text: str
    published: Mapping[str, float]
    measured: Mapping[str, float]
    show: str
    reason: str

    @property
    def met(self) -> bool:
        """Whether every measured figure is close to the published one."""
        pairs = ((self.measured[case], self.published[case]) for case in self.measured)
        return all(abs(here - there) <= CLOSE * abs(there) for here, there in pairs)


def difference(
    text: str,
    cases: Sequence[str],
    published: Callable[[str], float | None],
    measured: Callable[[str], float | None],
    show: str,
    reason: str,
) -> Difference | None:
    """Of the cases in which both are known; None where there is none."""
    pairs = {case: (published(case), measured(case)) for case in cases}
    known = {c: (p, m) for c, (p, m) in pairs.items() if p is not None and m is not None}
    if not known:
        return None
    there, here = ({case: pair[i] for case, pair in known.items()} for i in (0, 1))
    return Difference(text, there, here, show, reason)


def differences_table(differences: Sequence[Difference]) -> Table:
    """A row a figure that was not met: published, measured, why."""
    rows = []
    for one in differences:
        if not one.met:
            told = [_told(one.published, one.measured, one.show), _told(one.measured, None, one.show)]
            rows.append((one.text, [Cell(text) for text in (*told, one.reason)]))
    heads = [
        ("published", "case by case"),
        ("here", "in the same order"),
        ("why", "as far as it is known"),
    ]
    return Table(heads, rows)


def _told(figures: Mapping[str, float], only: Mapping[str, float] | None, show: str) -> str:
    cases = figures if only is None else only
    return "; ".join(f"{case} {shown(figures[case], show)}" for case in cases) or DASH
