# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the theses conclude, and whether it holds here: decided by the figures, not by us."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fusionslam.report.tables import Cell, Table
from fusionslam.reproduce.blocks import DASH
from fusionslam.reproduce.chapter5 import published
from fusionslam.reproduce.view_study import ViewStudy
from fusionslam.views.drives import FrameName

Figures = dict[str, float]


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


def view_claims(study: ViewStudy) -> list[Claim]:
    """Those of sections 5.4 to 5.7, judged in the thesis's set-up, and strictly."""
    worlds = [drive.world for drive in study.drives]

    def of(
        frame: FrameName, method: str, name: str, scale: float = 1.0
    ) -> Callable[[str], float | None]:
        def value(world: str) -> float | None:
            found = study.figure(world, frame, method, name)
            return None if found is None else found * scale

        return value

    def accuracy(frame: FrameName, method: str) -> Callable[[str], float | None]:
        return of(frame, method, "accuracy", 100)

    def thesis(world: str) -> float | None:
        found = published(world, "first_stage", "accuracy")
        return None if found is None else 100 * found

    setup = "thesis's set-up"
    return [
        compared(
            f"The first stage is as accurate as published, or more ({setup}; published second)",
            worlds,
            accuracy("odometry", "first_stage"),
            thesis,
            "{:.1f} %",
            ties=True,
        ),
        compared(
            f"Both stages are at least as accurate as the first alone ({setup})",
            worlds,
            accuracy("odometry", "both_stages"),
            accuracy("odometry", "first_stage"),
            "{:.1f} %",
            ties=True,
        ),
        *(
            compared(
                f"The first stage is more accurate than the original's templates ({words})",
                worlds,
                accuracy(frame, "first_stage"),
                accuracy(frame, "templates"),
                "{:.1f} %",
            )
            for frame, words in _FRAMES
        ),
        *(
            compared(
                "False positives of the templates are farther off, on average, than those of the "
                f"first stage ({words})",
                worlds,
                of(frame, "templates", "mean_error"),
                of(frame, "first_stage", "mean_error"),
                "{:.2f} m",
            )
            for frame, words in _FRAMES
        ),
        compared(
            f"The templates store more views than the first stage ({setup})",
            worlds,
            of("odometry", "templates", "views"),
            of("odometry", "first_stage", "views"),
            "{:.0f}",
        ),
        compared(
            "A view of the first stage takes fewer bytes than a template",
            worlds,
            of("robot", "templates", "view_bytes"),
            of("robot", "first_stage", "view_bytes"),
            "{:.0f} B",
        ),
        compared(
            "A second stage costs more to build than the first alone",
            worlds,
            of("robot", "both_stages", "build_ms"),
            of("robot", "first_stage", "build_ms"),
            "{:.2f} ms",
        ),
        compared(
            "Ours, not the thesis's: alignment is more accurate than the first stage is in the "
            "thesis's set-up, without looking at odometry, and judged strictly",
            worlds,
            accuracy("robot", "alignment"),
            accuracy("odometry", "first_stage"),
            "{:.1f} %",
        ),
        compared(
            "Ours, not the thesis's: alignment finds more loops than the first stage (robot's "
            "frame)",
            worlds,
            of("robot", "alignment", "loop_recall", 100),
            of("robot", "first_stage", "loop_recall", 100),
            "{:.1f} %",
        ),
        compared(
            "Not in the thesis: the first stage is more accurate than what looks at nothing "
            "(thesis's set-up)",
            worlds,
            accuracy("odometry", "first_stage"),
            accuracy("odometry", "every_3rd"),
            "{:.1f} %",
        ),
    ]


_FRAMES: tuple[tuple[FrameName, str], ...] = (
    ("odometry", "thesis's set-up"),
    ("robot", "robot's frame"),
    ("drift", "drifting odometry"),
)


def claims_table(claims: Sequence[Claim]) -> Table:
    """A row a claim: what it was judged by, and whether it holds."""
    rows = []
    for claim in claims:
        told = "; ".join(f"{case} {figure}" for case, figure in claim.figures.items()) or DASH
        rows.append((claim.text, [Cell(told), Cell(claim.verdict)]))
    return Table(
        [("here", "by case: the figure that should be larger first"), ("verdict", "")], rows
    )
