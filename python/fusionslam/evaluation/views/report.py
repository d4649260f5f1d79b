# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``ViewReport``: a judged sequence of view ids."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.base.texts import counted
from fusionslam.evaluation.views.rules import ViewRule


@checked
@dataclass(frozen=True, eq=False)
class ViewReport:
    """A judged sequence of view ids. Shares lie in [0, 1]; one without a denominator is None.

    A scan is positive if its id was seen before, else negative; its view is the first scan with
    the same id.

    Attributes:
        n: number of scans.
        views: number of stored scenes: distinct ids that are not negative.
        unplaced: number of scans with a negative id, which hold nothing to recognise.
        rule_name, rule: the rule that was applied.
        ids: int64 (n,), as given.
        matched: int64 (n,), the first scan with the same id, -1 for negatives.
        distances, angles: float64 (n,), metres and degrees to that scan; NaN for negatives.
        false_positive: bool (n,), positives that are too far from their view.
        false_negative: bool (n,), negatives within reach of an earlier stored scene.
        revisit: bool (n,), scans that return to an older true pose.
        loop: bool (n,), positives whose view is older than the rule's ``loop_age``.
        loop_correct: bool (n,), loops that are near their view.
    """

    n: int
    views: int
    unplaced: int
    rule_name: str
    rule: ViewRule
    ids: Integers
    matched: Integers
    distances: Floats
    angles: Floats
    false_positive: Mask
    false_negative: Mask
    revisit: Mask
    loop: Mask
    loop_correct: Mask

    @property
    def positives(self) -> int:
        """Number of scans whose id was seen before."""
        return int((self.matched >= 0).sum())

    @property
    def false_positives(self) -> int:
        """Number of positives that are too far from their view."""
        return int(self.false_positive.sum())

    @property
    def false_negatives(self) -> int:
        """Number of negatives within reach of a stored scene."""
        return int(self.false_negative.sum())

    @property
    def true_positives(self) -> int:
        """Number of positives near their view."""
        return self.positives - self.false_positives

    @property
    def true_negatives(self) -> int:
        """Number of negatives that are rightly new."""
        return self.n - self.positives - self.false_negatives

    @property
    def accuracy(self) -> float | None:
        """1 - (false positives + false negatives) / n; loop closing hardly affects it."""
        return share(self.true_positives + self.true_negatives, self.n)

    @property
    def precision(self) -> float | None:
        """True positives / positives."""
        return share(self.true_positives, self.positives)

    @property
    def recall(self) -> float | None:
        """True positives / (true positives + false negatives)."""
        return share(self.true_positives, self.true_positives + self.false_negatives)

    @property
    def loops(self) -> int:
        """Number of scans that were matched to an old view."""
        return int(self.loop.sum())

    @property
    def correct_loops(self) -> int:
        """Number of scans that were matched to an old view nearby."""
        return int(self.loop_correct.sum())

    @property
    def revisits(self) -> int:
        """Number of scans that return to an older true pose."""
        return int(self.revisit.sum())

    @property
    def found_revisits(self) -> int:
        """Number of revisits that were matched to an old view nearby."""
        return int((self.revisit & self.loop_correct).sum())

    @property
    def loop_recall(self) -> float | None:
        """Found revisits / revisits."""
        return share(self.found_revisits, self.revisits)

    @property
    def loop_precision(self) -> float | None:
        """Correct loops / loops."""
        return share(self.correct_loops, self.loops)

    @property
    def false_positive_indices(self) -> Integers:
        """Int64 (false_positives,): scans of the false positives."""
        return np.flatnonzero(self.false_positive)

    @property
    def false_negative_indices(self) -> Integers:
        """Int64 (false_negatives,): scans of the false negatives."""
        return np.flatnonzero(self.false_negative)

    @property
    def false_positive_distances(self) -> Floats:
        """Float64 (false_positives,): metres from their views."""
        return self.distances[self.false_positive]

    @property
    def mean_false_positive_distance(self) -> float | None:
        """Metres; None without false positives."""
        return float(self.false_positive_distances.mean()) if self.false_positives else None

    @property
    def max_false_positive_distance(self) -> float | None:
        """Metres; None without false positives."""
        return float(self.false_positive_distances.max()) if self.false_positives else None

    @property
    def mean_false_positive_angle(self) -> float | None:
        """Degrees; None without false positives."""
        return float(self.angles[self.false_positive].mean()) if self.false_positives else None

    @property
    def max_false_positive_angle(self) -> float | None:
        """Degrees; None without false positives."""
        return float(self.angles[self.false_positive].max()) if self.false_positives else None

    def metrics(self) -> dict[str, Any]:
        """All scalar figures with the rule, ready for JSON; undefined ones are null."""
        return {
            "rule": self.rule_name,
            **{name: getattr(self, name) for name in FIGURES},
            "limits": self.rule.model_dump(mode="json"),
        }

    def __str__(self) -> str:
        apart = "none"
        if self.false_positives:
            apart = (
                f"mean {self.mean_false_positive_distance:.2f} m "
                f"{self.mean_false_positive_angle:.1f} deg, "
                f"max {self.max_false_positive_distance:.2f} m "
                f"{self.max_false_positive_angle:.1f} deg"
            )
        return "\n".join(
            [
                f"rule {self.rule_name}: {counted(self.n, 'scan')}, {counted(self.views, 'view')}, "
                f"{self.unplaced} without a view",
                f"  accuracy        {percent(self.accuracy):>8}   {self.false_positives} false "
                f"positives, {self.false_negatives} false negatives",
                f"  loop recall     {percent(self.loop_recall):>8}   {self.found_revisits} of "
                f"{self.revisits} revisits",
                f"  loop precision  {percent(self.loop_precision):>8}   {self.correct_loops} of "
                f"{self.loops} loops",
                f"  precision       {percent(self.precision):>8}   {self.true_positives} of "
                f"{self.positives} positives",
                f"  recall          {percent(self.recall):>8}",
                f"  false positives: {apart}",
            ]
        )


FIGURES = (
    "accuracy",
    "loop_recall",
    "loop_precision",
    "precision",
    "recall",
    "n",
    "views",
    "unplaced",
    "positives",
    "true_positives",
    "true_negatives",
    "false_positives",
    "false_negatives",
    "revisits",
    "found_revisits",
    "loops",
    "correct_loops",
    "mean_false_positive_distance",
    "max_false_positive_distance",
    "mean_false_positive_angle",
    "max_false_positive_angle",
)
"""Scalar figures of a report, by attribute."""


def share(part: int, whole: int) -> float | None:
    """Part / whole; None if the whole is 0."""
    return part / whole if whole else None


def percent(value: float | None) -> str:
    """Format a share as per cent; "none" if it is undefined."""
    return "none" if value is None else f"{100 * value:.1f} %"
