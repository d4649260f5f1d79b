# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robot may be, by what candidates say; ``PlaceHypotheses`` follows other places.

A hypothesis begins where a scan resembles a stored view elsewhere, and moves with odometry. Driving
tells: the right one is confirmed again and again, a wrong one only as often as places on this map
look alike, which is learned from the hypotheses that were wrong.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.geometry.se2 import Pose, compose, find_near

_AGREE_M, _AGREE_RAD = 0.5, 0.3
"""Candidates whose poses of the robot are this near each other say the same."""
_ALIKE = 0.5
"""Probability from which on a place counts as a look-alike."""
NEWS_M = 0.5
"""Metres and radians of driving after which a scan tells something new."""
_HIT = 0.85
"""How often a scan confirms where the robot is, if views are stored there."""
_WRONG = (1.0, 2.0)
"""Prior of how often a wrong hypothesis is confirmed: times that it was, times that it was not."""
_LEAST_WRONG, _MOST_WRONG = 0.05, 0.8
_LIKELY = 0.5
"""Probability of an alignment from which on it begins or confirms a hypothesis."""
_SAME_M, _SAME_RAD = 0.6, 0.3
"""A scan confirms a hypothesis that is this near."""
_THERE = 0.5
"""Where a view is stored within so many metres and radians, one expects to be confirmed."""
_LEAST_LOG = math.log(1e-4)
"""A hypothesis with smaller odds is given up."""
_MET = 0.1
"""Hypotheses that are so near to each other, metres and radians, are one."""
_FEWEST = 3
"""Confirmations that a hypothesis needs."""
_MOST = 100
NO_NODE = 2**62


def agree(poses: Floats, pose: Pose) -> NDArray[np.bool_]:
    """Which poses of the robot are one of them, for all that alignments can tell."""
    return find_near(poses, pose, _AGREE_M, _AGREE_RAD)


def count_look_alikes(poses: Floats, probabilities: Floats) -> tuple[Floats, Floats]:
    """How much elsewhere looks like the scan.

    Views of one place, which put the robot at the same pose, count once.

    Returns:
        For each candidate, float64 (n,), the sum of the probabilities of others; and the poses of
        those that are likely, float64 (k, 3).
    """
    left, leaders = np.ones(len(poses), bool), []
    for index in np.argsort(-probabilities, kind="stable"):
        if left[index]:
            leaders.append(index)
            left &= ~agree(poses, poses[index])
    alike = np.full(len(poses), probabilities[leaders].sum())
    for leader in leaders:
        alike[agree(poses, poses[leader])] -= probabilities[leader]
    likely = [leader for leader in leaders if probabilities[leader] >= _ALIKE]
    return alike.clip(0), poses[likely]


def density(error_m: float, error_rad: float, sd_m: float, sd_rad: float) -> float:
    """Of a normal distribution over positions and headings, per square metre and radian."""
    square = (error_m / sd_m) ** 2 + (error_rad / sd_rad) ** 2
    return math.exp(-square / 2) / (math.tau * math.sqrt(math.tau) * sd_m**2 * sd_rad)


class Evidence(NamedTuple):
    """What a scan says of where the filter has the robot.

    Attributes:
        confirmed_by, expected_by: first nodes of the views that confirm it, and of those that are
            stored there; ``NO_NODE`` for none.
        is_lost: the filter does not know where the robot is.
    """

    confirmed_by: int
    expected_by: int
    is_lost: bool


class PlaceHypotheses:
    """Hypotheses of where the robot is, and the odds of each against where the filter has it."""

    def __init__(self) -> None:
        self._poses: Floats = np.empty((0, 3))
        self._logs: Floats = np.empty(0)  # of the odds
        # Node that was made next when it began, and times that it was confirmed.
        self._counts = np.empty((0, 2), np.int64)
        self._wrong = np.array(_WRONG)
        self._since = 0.0

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def shares(self) -> Floats:
        """Probability of each; what is left of 1 is that of the filter."""
        odds = np.exp(self._logs.clip(max=500))
        return np.asarray(odds / (1 + odds.sum()))

    def clear(self) -> None:
        """Forget all hypotheses, but not how alike places look."""
        self._poses, self._logs = self._poses[:0], self._logs[:0]
        self._counts, self._since = self._counts[:0], 0.0

    def move(self, motion: tuple[float, float, float]) -> None:
        """Move all by odometry: x and y in metres and the turn in radians, in the robot's frame."""
        x, y, turn = motion
        self._since += math.hypot(x, y) + abs(turn)
        if len(self):
            self._poses = compose(self._poses, np.tile(motion, (len(self), 1)))

    def weigh(
        self,
        claims: Floats,
        probabilities: Floats,
        views: Floats,
        evidence: Evidence,
        node: int,
        odds: Floats | float,
    ) -> None:
        """Weigh the hypotheses by a scan, if the robot has moved since the last one.

        Args:
            claims: float64 (n, 3), poses of the robot by the stored views that a scan resembles,
                except those that agree with the filter.
            probabilities: float64 (n,), of the alignments.
            views: float64 (k, 3), poses of the stored views.
            evidence: what the scan says of where the filter has the robot.
            node: the node that is made next.
            odds: of a new hypothesis, of all or float64 (n,) of each claim.
        """
        likely = probabilities >= _LIKELY
        if self._since >= NEWS_M:
            self._since = 0.0
            self._weigh_all(claims[likely], views, evidence)
        logs = np.log(np.broadcast_to(odds, likely.shape)[likely])
        for pose, log in zip(claims[likely], logs, strict=True):
            if not find_near(self._poses, pose, _SAME_M, _SAME_RAD).any():
                self._poses = np.vstack([self._poses, pose])
                self._logs = np.append(self._logs, log)
                self._counts = np.vstack([self._counts, [node, 1]])
        kept = np.argsort(-self._logs, kind="stable")[:_MOST]
        kept = kept[self._logs[kept] > _LEAST_LOG]
        # Of those that are where a more probable one is, one view confirmed both.
        poses = self._poses
        alone = [
            number
            for place, number in enumerate(kept.tolist())
            if not find_near(poses[kept[:place]], poses[number], _MET, _MET).any()
        ]
        self._poses, self._logs, self._counts = poses[alone], self._logs[alone], self._counts[alone]

    def find(self, least: float) -> int | None:
        """The hypothesis that has at least this probability, and was confirmed often enough."""
        if not len(self):
            return None
        shares = self.shares
        best = int(shares.argmax())
        same = find_near(self._poses, self._poses[best], _SAME_M, _SAME_RAD)
        is_sure = float(shares[same].sum()) >= least and self._counts[best, 1] >= _FEWEST
        return best if is_sure else None

    def pose(self, number: int) -> Floats:
        """The robot under a hypothesis: float64 (3,)."""
        return np.array(self._poses[number])

    def first_node(self, number: int) -> int:
        """The node that was made next when it began."""
        return int(self._counts[number, 0])

    def _weigh_all(self, claims: Floats, views: Floats, evidence: Evidence) -> None:
        if not len(self):
            return
        hit = np.zeros(len(self), bool)
        for number, pose in enumerate(self._poses):
            found = claims[find_near(claims, pose, _SAME_M, _SAME_RAD)]
            if len(found):
                hit[number] = True
                self._poses[number] = found[np.hypot(*(found - pose)[:, :2].T).argmin()]
        expected = np.array([find_near(views, pose, _THERE, _THERE).any() for pose in self._poses])
        # Views that were stored since a hypothesis began are where the filter had the robot.
        first = self._counts[:, 0]
        confirmed = evidence.confirmed_by < first
        missed = ~confirmed & (evidence.expected_by < first)
        if not evidence.is_lost:
            wrong = (self._counts[:, 1] > 1) & ~missed
            self._wrong += [
                np.count_nonzero(hit & wrong),
                np.count_nonzero(~hit & wrong & expected),
            ]
        share = float((self._wrong[0] / self._wrong.sum()).clip(_LEAST_WRONG, _MOST_WRONG))
        up, down = math.log(_HIT / share), math.log((1 - _HIT) / (1 - share))
        # Where nothing is stored, a place that looks like another one is no news of the robot.
        is_news = missed | confirmed | evidence.is_lost
        self._logs += np.where(hit, up * is_news, np.where(expected, down, 0.0))
        self._logs += np.where(confirmed, -up, np.where(missed, -down, 0.0))
        self._counts[:, 1] += hit

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything as arrays for ``restore``."""
        return {
            "poses": self._poses.copy(),
            "logs": self._logs.copy(),
            "counts": self._counts.copy(),
            "wrong": self._wrong.copy(),
            "since": np.array(self._since),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume from a state. Raises DataError if the arrays are invalid."""
        poses, logs, counts, wrong, since = (
            state[name] for name in ("poses", "logs", "counts", "wrong", "since")
        )
        count = len(logs)
        shapes = [rows.shape for rows in (poses, logs, counts, wrong, since)]
        kinds = [rows.dtype for rows in (poses, logs, wrong, since)]
        if (
            shapes != [(count, 3), (count,), (count, 2), (2,), ()]
            or any(kind != np.float64 for kind in kinds)
            or counts.dtype != np.int64
            or (counts < 1).any()
            or not all(np.isfinite(rows).all() for rows in (poses, logs, wrong, since))
            or (wrong <= 0).any()
        ):
            raise DataError(f"hypotheses of a filter: {shapes}, expected rows of {count}")
        self._poses, self._logs, self._counts = poses.copy(), logs.copy(), counts.copy()
        self._wrong, self._since = wrong.copy(), float(since)
