# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A row of the benchmark: what is timed, when the answers agree, and what is to be reached."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from benchmarks.speed.timing import Comparison, Limits, Timer, compare


class WrongAnswer(Exception):
    """Ours and the peer do not give the same."""


@dataclass(frozen=True)
class Agreement:
    """How far two answers are apart."""

    words: str
    error: float
    tolerance: float

    def __str__(self) -> str:
        return f"{self.words}: {self.error:.3g} <= {self.tolerance:g}"


def agree(words: str, error: float, tolerance: float) -> Agreement:
    """Raises WrongAnswer if the error, which may be NaN, is not within the tolerance."""
    if not error <= tolerance:
        raise WrongAnswer(f"{words}: {error:.6g}, expected at most {tolerance:g}")
    return Agreement(words, float(error), tolerance)


@dataclass(frozen=True)
class Verdict:
    """A bound and what was measured."""

    words: str
    figure: float
    met: bool


@dataclass(frozen=True)
class Bound:
    """What is to be reached: the ratio to the peer, or the median of ours in milliseconds."""

    of: Literal["ratio", "median"]
    sense: Literal[">=", "<="]
    limit: float

    def judge(self, comparison: Comparison) -> Verdict:
        """Whether it is."""
        if self.of == "median":
            figure = 1e3 * comparison.ours.median
        else:
            assert comparison.ratio is not None  # rows without a peer have no bound on a ratio
            figure = comparison.ratio.value
        met = figure >= self.limit if self.sense == ">=" else figure <= self.limit
        unit = "x" if self.of == "ratio" else "ms"
        return Verdict(f"{self.sense} {self.limit:g} {unit}", figure, met)


def times_faster(factor: float) -> Bound:
    """The peer takes at least so many times longer."""
    return Bound("ratio", ">=", factor)


@dataclass(frozen=True)
class Case:
    """Ours against one peer.

    Attributes:
        what: the work, with its size.
        peer: who else does it; "" if nobody.
        ours, theirs: do it once.
        check: compares the two answers; raises WrongAnswer.
        bound: what is to be reached.
        work: how much ours and the peer do in one call, where that differs.
        detail: asked after the timing for what explains it.
    """

    what: str
    peer: str
    ours: Timer
    theirs: Timer | None
    check: Callable[[], Agreement]
    bound: Bound | None = None
    work: tuple[float, float] = (1, 1)
    detail: Callable[[], str] = lambda: ""

    @property
    def name(self) -> str:
        """What and against whom."""
        return f"{self.what} / {self.peer}" if self.peer else self.what


@dataclass(frozen=True)
class Result:
    """A measured row; ``wrong`` tells of an answer that is not the peer's."""

    group: str
    what: str
    peer: str
    comparison: Comparison | None
    agreement: str = ""
    verdict: Verdict | None = None
    reason: str = ""
    detail: str = ""
    wrong: str = ""

    @property
    def name(self) -> str:
        """What and against whom."""
        return f"{self.what} / {self.peer}" if self.peer else self.what


def measured(
    group: str, case: Case, limits: Limits, reasons: dict[str, str], *, judged: bool
) -> Result:
    """Compare the answers first, then the times."""
    try:
        agreement = str(case.check())
    except WrongAnswer as wrong:
        return Result(group, case.what, case.peer, None, wrong=str(wrong))
    comparison = compare(case.ours, case.theirs, limits, case.work)
    verdict = case.bound.judge(comparison) if case.bound and judged else None
    reason = "" if verdict is None or verdict.met else reasons.get(case.name, "")
    return Result(
        group, case.what, case.peer, comparison, agreement, verdict, reason, case.detail()
    )
