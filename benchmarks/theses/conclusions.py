# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the theses conclude, and whether it holds here: decided by the figures, not by us."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.theses.document import DASH, scaled
from benchmarks.theses.stastny2022_chapter5 import published
from benchmarks.theses.view_study import ViewStudy
from fusionslam.pipelines.drives import FrameName
from fusionslam.report.page.tables import Cell, Table


@dataclass(frozen=True)
class Claim:
    """A conclusion, and for each case (a world, a sequence) whether it holds.

    Attributes:
        text: the conclusion, in our words.
        figures: by case what it was judged by, in words.
        holds: by case; a case of which a figure is missing is left out.
    """

    text: str
    figures: dict[str, str]
    holds: dict[str, bool]

    @property
    def verdict(self) -> str:
        """In how many cases it holds."""
        count, right = len(self.holds), sum(self.holds.values())
        if not count:
            return "not measured"
        if right == count:
            return "holds" if count == 1 else f"holds in all {count}"
        missed = ", ".join(case for case, good in self.holds.items() if not good)
        return f"missed: {missed}" if right == 0 else f"holds in {right} of {count}; not: {missed}"


def compared(
    text: str,
    cases: Sequence[str],
    better: Callable[[str], float | None],
    worse: Callable[[str], float | None],
    show: str,
    *,
    ties: bool = False,
) -> Claim:
    """The claim that one figure is larger than another in every case where both are.

    Args:
        text: the claim.
        cases: worlds or sequences.
        better, worse: the figures of a case, None where there is none.
        show: format of a figure.
        ties: whether an equal one counts.
    """
    figures, holds = {}, {}
    for case in cases:
        one, other = better(case), worse(case)
        if one is not None and other is not None:
            figures[case] = f"{show.format(one)} and {show.format(other)}"
            holds[case] = one > other or (ties and one == other)
    return Claim(text, figures, holds)


_PERCENT = ("{:.1f} %", 100.0)
_SHOWN = {
    "accuracy": _PERCENT,
    "loop_recall": _PERCENT,
    "mean_error": ("{:.2f} m", 1.0),
    "views": ("{:.0f}", 1.0),
    "view_bytes": ("{:.0f} B", 1.0),
    "build_ms": ("{:.2f} ms", 1.0),
}
"""Format and scale of a figure of ``ViewRow``."""
_FRAMES: tuple[tuple[FrameName, str], ...] = (
    ("odometry", "thesis's set-up"),
    ("robot", "robot's frame"),
    ("drift", "drifting odometry"),
)

Measured = tuple[FrameName, str]
_CLAIMS: tuple[tuple[str, str, Measured, Measured], ...] = (
    *(
        (
            f"The first stage is more accurate than the original's templates ({words})",
            "accuracy",
            (frame, "objects:author"),
            (frame, "visual_templates"),
        )
        for frame, words in _FRAMES
    ),
    *(
        (
            "False positives of the templates are farther off, on average, than those of the "
            f"first stage ({words})",
            "mean_error",
            (frame, "visual_templates"),
            (frame, "objects:author"),
        )
        for frame, words in _FRAMES
    ),
    (
        "The templates store more views than the first stage (thesis's set-up)",
        "views",
        ("odometry", "visual_templates"),
        ("odometry", "objects:author"),
    ),
    (
        "A view of the first stage takes fewer bytes than a template",
        "view_bytes",
        ("robot", "visual_templates"),
        ("robot", "objects:author"),
    ),
    (
        "A second stage costs more to build than the first alone",
        "build_ms",
        ("robot", "two_stages:author"),
        ("robot", "objects:author"),
    ),
    (
        "Ours, not the thesis's: alignment is more accurate than the first stage is in the "
        "thesis's set-up, without looking at odometry, and judged strictly",
        "accuracy",
        ("robot", "alignment"),
        ("odometry", "objects:author"),
    ),
    (
        "Ours, not the thesis's: alignment finds more loops than the first stage (robot's frame)",
        "loop_recall",
        ("robot", "alignment"),
        ("robot", "objects:author"),
    ),
    (
        "Not in the thesis: the first stage is more accurate than what looks at nothing "
        "(thesis's set-up)",
        "accuracy",
        ("odometry", "objects:author"),
        ("odometry", "every_3rd"),
    ),
)
"""A claim, a figure of ``ViewRow``, and by frame and way where it should be larger, and smaller."""


def view_claims(study: ViewStudy) -> list[Claim]:
    """Those of sections 5.4 to 5.7, judged in the thesis's set-up, and strictly."""
    worlds = [drive.world for drive in study.drives]

    def of(name: str, measured: Measured) -> Callable[[str], float | None]:
        frame, method = measured
        scale = _SHOWN[name][1]
        return lambda world: scaled(study.figure(world, frame, method, name), scale)

    def thesis(world: str) -> float | None:
        return scaled(published(world, "objects:author", "accuracy"), _PERCENT[1])

    first = of("accuracy", ("odometry", "objects:author"))
    both = of("accuracy", ("odometry", "two_stages:author"))
    as_published = (
        "The first stage is as accurate as published, or more (thesis's set-up; published second)"
    )
    second = "Both stages are at least as accurate as the first alone (thesis's set-up)"
    return [
        compared(as_published, worlds, first, thesis, _PERCENT[0], ties=True),
        compared(second, worlds, both, first, _PERCENT[0], ties=True),
        *(
            compared(text, worlds, of(name, larger), of(name, smaller), _SHOWN[name][0])
            for text, name, larger, smaller in _CLAIMS
        ),
    ]


def claims_table(claims: Sequence[Claim]) -> Table:
    """A row a claim: what it was judged by, and whether it holds."""
    rows = []
    for claim in claims:
        told = "; ".join(f"{case} {figure}" for case, figure in claim.figures.items()) or DASH
        rows.append((claim.text, [Cell(told), Cell(claim.verdict)]))
    return Table(
        [("here", "by case: the figure that should be larger first"), ("verdict", "")], rows
    )
