# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Differences between measured and published figures, with their reasons if known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import yaml

from benchmarks.theses.descriptor_study import TOWN, DescriptorStudy
from benchmarks.theses.perdomo2019_chapter4 import (
    NAMES,
    SPACES,
    color_recall,
    describe_ms,
    full_recall,
)
from benchmarks.theses.stastny2022_chapter5 import find_published, title_of
from benchmarks.theses.view_study import ViewStudy
from fusionslam.evaluation.loops.published import (
    PUBLISHED_COLOR_SPACES,
    PUBLISHED_RECALL,
    PUBLISHED_SECONDS,
)
from fusionslam.report.page.tables import Cell, Table

CLOSE = 0.05
"""Measured figures within this share of the published one count as met."""
UNKNOWN = "not known"

Figures = Mapping[str, float | None]
"""By case: a world, a sequence, a descriptor or a colour space."""


@dataclass(frozen=True)
class Difference:
    """A figure published for several cases, and its measured values.

    Attributes:
        text: description of the figure.
        published, measured: one value per case.
        show: format of a value.
        reason: why they differ, if known.
    """

    text: str
    published: dict[str, float]
    measured: dict[str, float]
    show: str
    reason: str

    @property
    def met(self) -> bool:
        """Whether every measured figure is close to the published one."""
        return all(
            abs(here - self.published[case]) <= CLOSE * abs(self.published[case])
            for case, here in self.measured.items()
        )


def differences_table(differences: Sequence[Difference]) -> Table:
    """Build a table with one row per figure that was not met: published, measured, reason."""
    heads = [
        ("published", "case by case"),
        ("here", "the same cases"),
        ("why", "as far as it is known"),
    ]
    rows = [
        (one.text, [Cell(text) for text in (*_format_cases(one), one.reason)])
        for one in differences
        if not one.met
    ]
    return Table(heads, rows)


def met_sentence(differences: Sequence[Difference]) -> str:
    """List the figures that came out as published."""
    met = [one.text for one in differences if one.met]
    close = f"Within {100 * CLOSE:.0f} % of the published figures in every case: "
    return f"{close}{'; '.join(met) or 'none of them'}."


def _format_cases(one: Difference) -> list[str]:
    return [
        "; ".join(f"{case} {one.show.format(value)}" for case, value in figures.items())
        for figures in (one.published, one.measured)
    ]


def _compare(
    text: str,
    known: Figures,
    measured: Figures,
    show: str,
    reason: str,
    scale: float = 1,
) -> list[Difference]:
    """Compare the cases with both figures known; empty if there are none."""
    there, here = {}, {}
    for case, theirs in known.items():
        own = measured[case]
        if theirs is not None and own is not None:
            there[case], here[case] = theirs * scale, own * scale
    return [Difference(text, there, here, show, reason)] if here else []


def view_differences(study: ViewStudy, methods: Sequence[str]) -> list[Difference]:
    """Compare with tables 5.2 to 5.5, in the thesis's set-up."""
    stored = yaml.safe_load(Path(__file__).with_name("differences.yaml").read_text("utf-8"))
    made = [drive.world for drive in study.drives if drive.made]
    others = f", and another world ({', '.join(made)})" if made else ""
    where = f"another drive in another simulator{others}"
    found = []
    for method, row in product(methods, stored["figures"]):
        figure, worlds = row["figure"], [drive.world for drive in study.drives]
        found += _compare(
            f"{title_of(method)}: {row['text']}",
            {
                world: find_published(world, method, row.get("published", figure))
                for world in worlds
            },
            {world: study.figure(world, row["frame"], method, figure) for world in worlds},
            row["show"],
            _find_reason(stored["reasons"], method, figure).format(where=where),
            row.get("scale", 1),
        )
    return found


def _find_reason(reasons: Sequence[Mapping[str, Any]], method: str, figure: str) -> str:
    """Return the first reason that is given for a figure of a method."""
    return next(
        str(row["text"])
        for row in reasons
        if figure in row.get("figures", [figure]) and row.get("method", method) == method
    )


_TOWN = (
    "a simulated town, not KITTI: half of its revisits are driven the other way, and images of two "
    "visits differ in exposure"
)


def descriptor_differences(study: DescriptorStudy) -> list[Difference]:
    """Compare colour spaces, times, and on KITTI the figures of tables 4.4 and 4.5."""
    town = study.cases == [TOWN]
    case = TOWN if town else study.cases[0]
    where = _TOWN if town else UNKNOWN
    found = _compare(
        "c-M2DP: recall at 100 % precision, KITTI 06",
        {title: PUBLISHED_COLOR_SPACES[space][0] for space, title in SPACES.items()},
        {title: color_recall(study, space, 1.0) for space, title in SPACES.items()},
        "{:.3f}",
        where,
    )
    for source in study.sources(case):
        own = {name: study.find(case, source, name, "author") for name in NAMES}
        seconds = {name: PUBLISHED_SECONDS.get(("05", source, name)) for name in NAMES}
        found += _compare(
            f"{source}: describing a cloud in ms, KITTI 05",
            {NAMES[name]: value and value * 1e3 for name, value in seconds.items()},
            {NAMES[name]: describe_ms(measured) for name, measured in own.items()},
            "{:.1f}",
            f"another machine, vector instructions{'; another sensor' * town}",
        )
        found += [] if town else _compare_recalls(study, source)
    return found


def _compare_recalls(study: DescriptorStudy, source: str) -> list[Difference]:
    found = []
    for name, title in NAMES.items():
        own = {case: study.find(case, source, name, "author") for case in study.cases}
        found += _compare(
            f"{source}, {title}: recall at 100 % precision",
            {
                case: PUBLISHED_RECALL.get((case.removeprefix("KITTI "), source, name))
                for case in study.cases
            },
            {case: full_recall(measured) for case, measured in own.items()},
            "{:.3f}",
            UNKNOWN,
        )
    return found
