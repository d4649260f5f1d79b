# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Conclusions of the theses, and whether the measured figures support them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import yaml

from benchmarks.theses.stastny2022_chapter5 import find_published
from benchmarks.theses.view_study import ViewStudy
from fusionslam.pipelines.drives import FrameName
from fusionslam.report.page.tables import DASH, Cell, Table


@dataclass(frozen=True)
class Claim:
    """A conclusion, and whether it holds in each case (a world or a sequence).

    Attributes:
        text: the conclusion, in our words.
        figures: case -> the figures it was judged by, as text.
        holds: case -> verdict; cases with a missing figure are left out.
    """

    text: str
    figures: dict[str, str]
    holds: dict[str, bool]

    @property
    def verdict(self) -> str:
        """Describe in how many cases it holds."""
        count, right = len(self.holds), sum(self.holds.values())
        if not count:
            return "not measured"
        if right == count:
            return "holds" if count == 1 else f"holds in all {count}"
        missed = ", ".join(case for case, good in self.holds.items() if not good)
        return f"missed: {missed}" if right == 0 else f"holds in {right} of {count}; not: {missed}"


Operand = str | float
Value = Callable[[str, str, Operand], float | None]


def decide(
    part: str, cases: Sequence[str], value: Value, formats: Mapping[str, str]
) -> list[Claim]:
    """Decide the conclusions of one part.

    Args:
        part: key of ``conclusions.yaml``.
        cases: worlds or sequences.
        value: returns a figure, given the case, its name (empty if a part has only one) and a
            row's ``larger`` or ``smaller``; None if there is no such figure.
        formats: format of each figure, by name.
    """
    rows = yaml.safe_load(Path(__file__).with_name("conclusions.yaml").read_text("utf-8"))[part]
    return [_decide(row, cases, value, formats[row.get("figure", "")]) for row in rows]


def _decide(row: Mapping[str, Any], cases: Sequence[str], value: Value, show: str) -> Claim:
    figures, holds = {}, {}
    for case in cases:
        larger, smaller = (
            value(case, row.get("figure", ""), row[key]) for key in ("larger", "smaller")
        )
        if larger is None or smaller is None:
            continue
        figures[case] = f"{show.format(larger)} and {show.format(smaller)}"
        if "within" in row:
            holds[case] = abs(larger - smaller) <= row["within"]
        else:
            holds[case] = larger > smaller or (row.get("ties", False) and larger == smaller)
    return Claim(row["text"], figures, holds)


_PERCENT = ("{:.1f} %", 100.0)
_SHOWN = {
    "accuracy": _PERCENT,
    "loop_recall": _PERCENT,
    "mean_error": ("{:.2f} m", 1.0),
    "views": ("{:.0f}", 1.0),
    "view_bytes": ("{:.0f} B", 1.0),
    "build_ms": ("{:.2f} ms", 1.0),
}
"""Format and scale of each figure of ``view_row``."""


def view_claims(study: ViewStudy) -> list[Claim]:
    """Decide the conclusions of sections 5.4 to 5.7, in the thesis's set-up and strictly."""

    def value(world: str, name: str, operand: Operand) -> float | None:
        frame, method = str(operand).split()
        if frame == "published":
            found = find_published(world, method, name)
        else:
            found = study.figure(world, cast(FrameName, frame), method, name)
        return None if found is None else found * _SHOWN[name][1]

    formats = {name: show for name, (show, _) in _SHOWN.items()}
    return decide("views", [drive.world for drive in study.drives], value, formats)


def claims_table(claims: Sequence[Claim]) -> Table:
    """Build a table with one row per claim: its figures, and whether it holds."""
    rows = []
    for claim in claims:
        told = "; ".join(f"{case} {figure}" for case, figure in claim.figures.items()) or DASH
        rows.append((claim.text, [Cell(told), Cell(claim.verdict)]))
    return Table(
        [("here", "by case: the figure that should be larger first"), ("verdict", "")], rows
    )
