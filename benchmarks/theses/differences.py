# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Differences between measured and published figures, with their reasons if known."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.theses.descriptor_study import TOWN, DescriptorStudy
from benchmarks.theses.document import scaled
from benchmarks.theses.perdomo2019_chapter4 import (
    NAMES,
    SPACES,
    color_recall,
    describe_ms,
    full_recall,
)
from benchmarks.theses.stastny2022_chapter5 import published, title_of
from benchmarks.theses.view_study import ViewStudy
from fusionslam.evaluation.loops.published import (
    PUBLISHED_COLOR_SPACES,
    PUBLISHED_RECALL,
    PUBLISHED_SECONDS,
)
from fusionslam.pipelines.drives import FrameName
from fusionslam.report.page.tables import Cell, Table

CLOSE = 0.05
"""Measured figures within this share of the published one count as met."""
UNKNOWN = "not known"

Figure = Callable[[str], float | None]


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


def _difference(
    text: str, cases: Sequence[str], known: Figure, measured: Figure, show: str, reason: str
) -> list[Difference]:
    """Compare the cases with both figures known; empty if there are none."""
    there, here = {}, {}
    for case in cases:
        one, other = known(case), measured(case)
        if one is not None and other is not None:
            there[case], here[case] = one, other
    return [Difference(text, there, here, show, reason)] if here else []


_RERUN = "the thesis's program, run again on such scans, gave 85.8, 89.0 and 92.8 %"
_VIEWS: tuple[tuple[str, str, str, FrameName, str, float], ...] = (
    ("accuracy", "accuracy", "accuracy in %", "odometry", "{:.1f}", 100),
    ("mean_error", "mean_error", "mean distance of false positives in m", "odometry", "{:.2f}", 1),
    ("max_error", "max_error", "largest distance of one in m", "odometry", "{:.2f}", 1),
    ("build_ms", "build_ms", "building a view in ms", "robot", "{:.2f}", 1),
    ("pair_ms", "match_ms", "comparing two views in ms", "robot", "{:.3f}", 1),
    ("view_bytes", "view_bytes", "bytes of a view", "robot", "{:.0f}", 1),
    ("views", "views", "views stored", "odometry", "{:.0f}", 1),
)
"""Our name of a figure, the thesis's name, its description, frame, format and scale."""


def view_differences(study: ViewStudy, methods: Sequence[str]) -> list[Difference]:
    """Compare with tables 5.2 to 5.5, in the thesis's set-up."""
    worlds = [drive.world for drive in study.drives]
    where = _where([drive.world for drive in study.drives if drive.made])
    return [
        one
        for method in methods
        for name, known, words, frame, show, scale in _VIEWS
        for one in _difference(
            f"{title_of(method)}: {words}",
            worlds,
            lambda w, m=method, k=known, s=scale: scaled(published(w, m, k), s),  # type: ignore[misc]
            lambda w, m=method, n=name, f=frame, s=scale: scaled(study.figure(w, f, m, n), s),  # type: ignore[misc]
            show,
            _view_reason(method, name, where),
        )
    ]


def _where(made: Sequence[str]) -> str:
    """Describe how the drives differ from the thesis's."""
    others = f", and another world ({', '.join(made)})" if made else ""
    return f"another drive in another simulator{others}"


def _view_reason(method: str, name: str, where: str) -> str:
    if name in ("build_ms", "pair_ms"):
        objects = "compiled here and Python there; " if method != "visual_templates" else ""
        return f"{objects}another machine"
    if name == "view_bytes":
        if method == "visual_templates":
            return "60 x 20 blocks of 4 bytes each; the thesis does not say what its 600 bytes hold"
        return "follows from the number of objects in a view, so from the world and the drive"
    if method == "visual_templates":
        return f"{where}; images rendered without the simulator's lights, fewer a second"
    if method == "two_stages:author":
        return f"{where}; the network is trained anew, its weights were not published"
    if name == "accuracy" and method == "objects:author":
        return f"{where}; {_RERUN}"
    return where


_TOWN = (
    "a simulated town, not KITTI: half of its revisits are driven the other way, and images of two "
    "visits differ in exposure"
)


def descriptor_differences(study: DescriptorStudy) -> list[Difference]:
    """Compare colour spaces, times, and on KITTI the figures of tables 4.4 and 4.5."""
    town = study.cases == [TOWN]
    case = TOWN if town else study.cases[0]
    where = _TOWN if town else UNKNOWN
    names = {title: name for name, title in NAMES.items()}
    spaces = {title: name for name, title in SPACES.items()}
    found = _difference(
        "c-M2DP: recall at 100 % precision, KITTI 06",
        list(spaces),
        lambda title: PUBLISHED_COLOR_SPACES[spaces[title]][0],
        lambda title: color_recall(study, spaces[title], 1.0),
        "{:.3f}",
        where,
    )
    for source in study.sources(case):
        found += _difference(
            f"{source}: describing a cloud in ms, KITTI 05",
            list(names),
            lambda t, s=source: scaled(PUBLISHED_SECONDS.get(("05", s, names[t])), 1e3),  # type: ignore[misc]
            lambda t, s=source: describe_ms(study.find(case, s, names[t], "author")),  # type: ignore[misc]
            "{:.1f}",
            f"another machine, vector instructions{'; another sensor' * town}",
        )
        found += [] if town else _recalls(study, source)
    return found


def _recalls(study: DescriptorStudy, source: str) -> list[Difference]:
    return [
        one
        for name, title in NAMES.items()
        for one in _difference(
            f"{source}, {title}: recall at 100 % precision",
            study.cases,
            lambda case, n=name: PUBLISHED_RECALL.get((case.removeprefix("KITTI "), source, n)),  # type: ignore[misc]
            lambda case, n=name: full_recall(study.find(case, source, n, "author")),  # type: ignore[misc]
            "{:.3f}",
            UNKNOWN,
        )
    ]
