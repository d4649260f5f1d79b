# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Counts the revisits of a recording, and what became of them."""

import itertools
from typing import NamedTuple

import numpy as np

from benchmarks.real.recordings import Rule
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.evaluation import VerifiedRun
from fusionslam.evaluation.loops.judge import pose_differences
from fusionslam.evaluation.loops.precision_recall import sweep_thresholds

RIGHT = (1.0, 8.0)
"""Metres and degrees that the pose of a right loop is off at most."""


class Found(NamedTuple):
    """What a detector found of the revisits.

    Attributes:
        frames, revisits: number of them.
        recall: share of the revisits with an accepted loop that is right; None without revisits.
        full: share found at the threshold of probability at which all poses are right.
        accepted, wrong: loops, and those of them that are off by more than ``RIGHT``.
        metres: errors of the accepted loops.
        milliseconds: of processor time a frame, the mean.
    """

    frames: int
    revisits: int
    recall: float | None
    full: float | None
    accepted: int
    wrong: int
    metres: Floats
    milliseconds: float

    def cells(self) -> list[str]:
        """Cells of a table, "-" where there is no figure."""
        shares = (self.recall, self.full)
        return [
            str(self.frames),
            str(self.revisits),
            *("-" if share is None else f"{share:.3f}" for share in shares),
            str(self.accepted),
            str(self.wrong),
            *spread(self.metres),
            f"{self.milliseconds:.0f}",
        ]


def find_older(stamps_ns: Integers, rule: Rule) -> Mask:
    """Bool (N, N): whether the frame of a column is old enough for that of a row."""
    rows = np.arange(len(stamps_ns))
    older = rows[:, None] - rows > rule.frames
    return older & (stamps_ns[:, None] - stamps_ns > rule.seconds * 1e9)


def find_near(poses: Floats, rule: Rule) -> Mask:
    """Bool (N, N): whether two frames are of one place; ``poses`` are world_from_cloud."""
    places, turns = poses[:, :3, 3], poses[:, :3, :3]
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    # The trace of a rotation between two poses is the sum of the products of their elements.
    trace = np.einsum("aij,bij->ab", turns, turns)
    degrees = np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
    return np.asarray((apart < rule.metres) & (degrees < rule.degrees), np.bool_)


def find_revisits(poses: Floats, stamps_ns: Integers, rule: Rule) -> Mask:
    """Bool (N,): frames that revisit a place by a rule."""
    return np.asarray((find_near(poses, rule) & find_older(stamps_ns, rule)).any(axis=1))


def judge(run: VerifiedRun, rule: Rule) -> Found:
    """Judge the loops of a run by the true poses."""
    assert run.poses is not None  # each recording has them
    revisits = find_revisits(run.poses, run.stamps_ns, rule)
    metres, degrees = (errors[:, 0] for errors in pose_differences(run.matches, run.poses))
    right = (metres <= RIGHT[0]) & (degrees <= RIGHT[1])
    apart = np.where(run.match >= 0, 1 - run.probability, np.inf)
    accepted = run.accepted
    return Found(
        frames=len(run),
        revisits=int(revisits.sum()),
        recall=float((accepted & right)[revisits].mean()) if revisits.any() else None,
        full=sweep_thresholds(apart, right, revisits)["recall_at_full_precision"],
        accepted=int(accepted.sum()),
        wrong=int((accepted & ~right).sum()),
        metres=metres[accepted],
        milliseconds=float(np.mean(run.seconds["match"]) * 1e3),
    )


BINS = (0.0, 0.05, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
"""Probabilities between which poses are counted."""


def count_right(run: VerifiedRun) -> list[str]:
    """Share of right poses, and the number of all, by what probability was stated.

    The poses are those of each frame's best candidate, accepted or not.
    """
    assert run.poses is not None  # each recording has them
    metres, degrees = (errors[:, 0] for errors in pose_differences(run.matches, run.poses))
    right = (metres <= RIGHT[0]) & (degrees <= RIGHT[1])
    stated = np.isfinite(metres)
    cells = []
    for low, high in itertools.pairwise(BINS):
        inside = stated & (run.probability >= low)
        inside &= (run.probability < high) | (high == BINS[-1])
        cells.append(f"{right[inside].mean():.2f} ({inside.sum()})" if inside.any() else "-")
    return cells


def spread(errors: Floats) -> list[str]:
    """Median and 95 % of errors in metres."""
    known = len(errors) > 0
    return [f"{value:.3f}" for value in np.percentile(errors, [50, 95])] if known else ["-", "-"]
