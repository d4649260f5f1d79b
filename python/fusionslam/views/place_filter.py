# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Weighs the stored views that a scan resembles by where odometry has the robot.

Where a building repeats itself, single scans cannot tell its places apart, but a robot drives. The
filter keeps the stored views as nodes of an ``ExperienceMap`` of its own, whose model of drift says
how far odometry may be off since each of them. Only relative motion counts.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import ActionKind, ExperienceMap, ExperienceMapConfig
from fusionslam.base.archive import join_parts, part_of
from fusionslam.base.arrays import Floats, Matrix
from fusionslam.config import Section, option
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.odometry_calibration import LoopCheck, OdometryCalibration
from fusionslam.geometry.rigid import is_rigid
from fusionslam.geometry.se2 import compose, places_of, relative_to, wrap, wrapped
from fusionslam.views.comparison import Candidate
from fusionslam.views.match import NO_VIEW
from fusionslam.views.place_hypotheses import (
    NO_NODE,
    Evidence,
    PlaceHypotheses,
    agree,
    count_look_alikes,
    density,
)

Place = tuple[float, float, float]
"""x, y in metres and heading in radians."""

_CERTAIN = 0.02
"""Scans alone are never more certain than this: where places look alike, half of those that claim
0.98 and more are wrong."""
_MARGIN_M = 5.0
"""Metres by which the area where a robot may be is longer and wider than that of the views."""
_NEAR_M, _NEAR_RAD, _NEAR = 1.5, 1.0, 6
"""So many views that are stored within this of the robot are compared with every scan."""
_REVISED_M = 0.2
"""A match that moves the robot by more than this may change earlier answers, too."""
_NORMAL = NormalDist()
_NODE_M = 0.3
"""Metres after which the way of a robot that matches nothing gets another node."""
_ELSEWHERE, _ELSEWHERE_LOST = 1e-3, 0.02
"""Odds that the robot is where a scan resembles a view, and not where the filter has it."""
_MOST_TELLING = 20.0
"""Most by which a scan that nothing else looks like raises these odds for a lost robot."""

_OF_THE_MAP = ("drift_m", "drift_turn", "drift_heading", "place_m", "place_rad", "sigmas")
"""Options that the experience map has, too."""


class PlaceFilterConfig(Section):
    """How candidates of a scan are weighed by odometry."""

    candidates: int = option(12, "stored views that are weighed for a scan", ge=1, le=10_000)
    lost_candidates: int = option(20, "the same while the robot may be anywhere", ge=1, le=10_000)
    least: float = option(
        0.05, "candidates that are less probable by their scans alone are left out", ge=0, le=1
    )
    sigmas: float = option(
        3.0,
        "a pose this many standard deviations from where odometry has the robot is wrong",
        gt=0.1,
        le=10,
    )
    slide_share: float = option(
        0.5, "share of the wrong poses that are near the right one, as along a wall", ge=0, le=1
    )
    slide_m: float = option(1.0, "standard deviation of these", unit="m", gt=0)
    slide_rad: float = option(0.3, "standard deviation of their heading", unit="rad", gt=0)
    drift_m: float = option(
        0.03, "standard deviation of odometry's position after one metre", unit="m/sqrt(m)", gt=0
    )
    drift_turn: float = option(
        0.01,
        "standard deviation of its heading after a turn of one radian",
        unit="rad/sqrt(rad)",
        gt=0,
    )
    drift_heading: float = option(
        0.005, "standard deviation of its heading after one metre", unit="rad/sqrt(m)", gt=0
    )
    place_m: float = option(0.1, "standard deviation of an alignment's position", unit="m", gt=0)
    place_rad: float = option(0.05, "standard deviation of its heading", unit="rad", gt=0)
    radius_m: float = option(0.8, "a place reaches so far around its first view", unit="m", gt=0)
    radius_rad: float = option(0.4, "and so far to both sides of its heading", unit="rad", gt=0)
    older: float = option(
        0.6, "an older place is preferred if the robot is there with this probability", ge=0, le=1
    )
    window: int = option(20, "an answer can be revised until so many scans later", ge=0, le=10_000)
    max_step: float = option(
        5.0, "odometry that moves farther between two scans has jumped", unit="m", gt=0
    )


@dataclass(frozen=True)
class Belief:
    """What a scan and odometry say together.

    Attributes:
        best: the candidate that is matched if the place is known; None without candidates.
        known: probability that the place is that of ``best``.
        new: probability that no candidate is right.
        shares: slots of the candidates and the probability of each, most probable first.
        look_alikes: number of other poses at which stored views look like the scan.
    """

    best: Candidate | None
    known: float
    new: float
    shares: tuple[tuple[int, float], ...] = ()
    look_alikes: int = 0


class Location(NamedTuple):
    """A place that the robot is at, going by odometry since other matches.

    Attributes:
        slot: of the first view of the place.
        probability: that the robot is there.
        pose: of the robot in the frame of that view.
    """

    slot: int
    probability: float
    pose: Place


class Answer(NamedTuple):
    """An answer that may be revised: number of the scan, id, and where the robot was."""

    scan: int
    id: int
    node: int
    offset: Place


class PlaceFilter:
    """A belief over the stored views, moved by odometry.

    Args:
        config: None for the defaults.
    """

    def __init__(self, config: PlaceFilterConfig | None = None) -> None:
        self.config = config or PlaceFilterConfig()
        values = {name: getattr(self.config, name) for name in _OF_THE_MAP}
        # Loops that agree are no evidence where places look alike: hypotheses weigh them.
        self._map = ExperienceMap(ExperienceMapConfig(**values, agreement_m=0.0))
        self._calibration = OdometryCalibration(self.config.drift_turn, self.config.drift_heading)
        self._map.set_odometry_deviations(*self._calibration.deviations)
        self._hypotheses = PlaceHypotheses()
        self._nodes: list[int] = []
        self._last: Place | None = None
        # Nodes that were made next when odometry was interrupted, of parts of the map that no match
        # has joined since; ascending.
        self._losses: list[int] = []
        self._answers: list[Answer] = []
        self._was_moved = False

    @property
    def is_lost(self) -> bool:
        """Whether odometry was interrupted, and no view from before was matched since."""
        return bool(self._losses)

    @property
    def factors(self) -> tuple[float, float]:
        """What odometry's distances and turns are multiplied by, as learned so far."""
        return self._calibration.factors

    def move(self, odometry: Matrix | None) -> str:
        """Move the robot to where odometry has it now.

        Args:
            odometry: float64 (4, 4), odom_from_robot; None if it is unknown, so that the robot may
                be anywhere. What is no rigid motion counts as unknown.

        Returns:
            What is wrong with odometry, as a sentence; empty if nothing is.

        Raises:
            ShapeError: it is not (4, 4).
        """
        here, problem = (None, "no odometry") if odometry is None else _ground(odometry)
        before, self._last = self._last, here
        if here is None:
            return self._interrupt(problem)
        if before is None:
            return self._interrupt("odometry begins")
        x, y = here[0] - before[0], here[1] - before[1]
        way, turn = math.hypot(x, y), wrap(here[2] - before[2])
        if way > self.config.max_step:
            return self._interrupt(f"odometry jumped by {way:.4g} m")
        bearing = wrap(math.atan2(y, x) - before[2]) if way else 0.0
        factors = self._calibration.factors
        ahead = factors.way * way
        self._hypotheses.move(
            (ahead * math.cos(bearing), ahead * math.sin(bearing), factors.turn * turn)
        )
        if abs(bearing) > math.pi / 2:  # backwards
            way, bearing = -way, bearing - math.copysign(math.pi, bearing)
        for v, w in ((0.0, bearing), (way, 0.0), (0.0, turn - bearing)):
            self._calibration.move(v, w)
            self._map.on_odometry(v * factors.way, w * factors.turn, 1.0)
        return ""

    def _interrupt(self, problem: str) -> str:
        self._map.mark_interruption()
        self._calibration.forget()
        if len(self._map) and self._losses[-1:] != [len(self._map)]:
            self._losses.append(len(self._map))
            self._hypotheses.clear()
        return f"{problem}: the robot may be anywhere" if self.is_lost else ""

    def find_near(self) -> list[int]:
        """Slots of the views stored nearest to where the robot is; none if it is lost."""
        if self.is_lost or not self._nodes:
            return []
        apart = self._map.nodes[self._nodes] - np.array(self._map.pose)
        metres = np.hypot(apart[:, 0], apart[:, 1])
        near = np.flatnonzero((metres < _NEAR_M) & (np.abs(wrapped(apart[:, 2])) < _NEAR_RAD))
        return [int(slot) for slot in near[np.argsort(metres[near], kind="stable")[:_NEAR]]]

    def weigh(self, candidates: Sequence[Candidate], least: float) -> Belief:
        """Weigh candidates by where odometry has the robot.

        Args:
            candidates: with ``relative_pose``, and the probability as ``similarity``.
            least: the probability from which on a place is known.
        """
        likely = [c for c in candidates if c.similarity >= self.config.least and c.relative_pose]
        nodes = self._map.nodes
        views = nodes[self._nodes]
        slots = [one.slot for one in likely]
        poses = compose(
            views[slots], np.array([one.relative_pose for one in likely]).reshape(-1, 3)
        )
        probabilities = np.array([one.similarity for one in likely])
        alike, leaders = count_look_alikes(poses, probabilities)
        checks = [self._check(one.slot, one.relative_pose) for one in likely]
        area = float((np.ptp(nodes[:, :2], axis=0) + _MARGIN_M).prod()) if len(nodes) else 1.0
        odds = np.array(
            [
                self._weigh_one(one, check, float(other), area)
                for one, check, other in zip(likely, checks, alike, strict=True)
            ]
        )
        belief = Belief(None, 0.0, 1.0)
        total = 1.0 + float(odds.sum())
        if likely:
            best = int(odds.argmax())
            same = agree(poses, poses[best])
            known = float(odds[same].sum()) / total if checks[best].fits else 0.0
            shares = [(slot, float(share)) for slot, share in zip(slots, odds / total, strict=True)]
            shares.sort(key=lambda share: (-share[1], share[0]))
            others = np.count_nonzero(~agree(leaders, poses[best]))
            belief = Belief(likely[best], known, 1.0 / total, tuple(shares), int(others))
        self._weigh_hypotheses(poses, probabilities, alike, slots)
        which = self._find_elsewhere(poses, probabilities, slots, least)
        if which is not None and belief.known < least:
            belief = replace(belief, best=likely[which], known=least, new=1.0 - least)
            self._go_elsewhere(least)
        return belief

    def _weigh_hypotheses(
        self, poses: Floats, probabilities: Floats, alike: Floats, slots: list[int]
    ) -> None:
        nodes, here = self._map.nodes, np.array(self._map.pose)
        stored, agrees = np.array(self._nodes, np.int64), agree(poses, here)
        elsewhere, old = ~agrees, stored
        if self.is_lost:
            elsewhere, old = stored[slots] < self._losses[-1], stored[stored < self._losses[-1]]
        evidence = Evidence(NO_NODE, NO_NODE, self.is_lost)
        odds = np.full(len(slots), _ELSEWHERE)
        if self.is_lost:
            # What nothing else looks like tells most.
            alone = probabilities / (1 - probabilities.clip(max=1 - _CERTAIN) + alike)
            odds = _ELSEWHERE_LOST * alone.clip(1, _MOST_TELLING)
        else:
            confirming, there = stored[slots][agrees], stored[agree(nodes[stored], here)]
            evidence = Evidence(
                int(confirming.min(initial=NO_NODE)), int(there.min(initial=NO_NODE)), False
            )
        self._hypotheses.weigh(
            *(poses[elsewhere], probabilities[elsewhere], nodes[old]),
            *(evidence, max(1, len(self._map)), odds[elsewhere]),
        )

    def _find_elsewhere(
        self, poses: Floats, probabilities: Floats, slots: list[int], least: float
    ) -> int | None:
        """The candidate by which the robot is where the best hypothesis has it; None for none."""
        number = self._hypotheses.find(least)
        if number is None:
            return None
        first = self._losses[-1] if self.is_lost else self._hypotheses.first_node(number)
        older = np.array([self._nodes[slot] < first for slot in slots], bool)
        agreeing = np.flatnonzero(older & agree(poses, self._hypotheses.pose(number)))
        return int(agreeing[probabilities[agreeing].argmax()]) if agreeing.size else None

    def _go_elsewhere(self, least: float) -> None:
        """Believe the best hypothesis, so that the next match moves what was mapped since then."""
        number = self._hypotheses.find(least)
        if number is not None and not self.is_lost:
            first = self._hypotheses.first_node(number)
            self._map.mark_interruption_before(first)
            self._calibration.forget()
            self._losses = [first]
        self._hypotheses.clear()

    def _weigh_one(
        self, candidate: Candidate, check: LoopCheck, alike: float, area: float
    ) -> float:
        """The odds of a candidate against a new place.

        Bayes: those of the scans times the density of the pose if it is right, by that if it is
        wrong. Wrong ones slide along the right one, or are anywhere on the map. If other places
        look alike, the scans tell less.
        """
        config = self.config
        probability = min(candidate.similarity, 1 - _CERTAIN)
        by_scans = probability / (1 - probability + alike)
        if self._losses and self._nodes[candidate.slot] < self._losses[-1]:
            return by_scans  # odometry says nothing of it
        if not check.fits:
            return 0.0
        sd_m, sd_rad = check.allowed_m / config.sigmas, check.allowed_rad / config.sigmas
        right = density(check.error_m, check.error_rad, sd_m, sd_rad)
        sliding = density(
            check.error_m,
            check.error_rad,
            math.hypot(sd_m, config.slide_m),
            math.hypot(sd_rad, config.slide_rad),
        )
        share, anywhere = config.slide_share, 1 / (area * math.tau)
        return by_scans * right / (share * sliding + (1 - share) * anywhere)

    def _check(self, slot: int, pose: Place | None) -> LoopCheck:
        assert pose is not None
        action = (ActionKind.CREATE_EDGE, self._map.current, self._nodes[slot], pose[2], pose[:2])
        return LoopCheck(*self._map.check(*action))

    def locate(self, slots: Sequence[int], least: float) -> Location | None:
        """The oldest place that the robot is at, going by where odometry has it.

        Args:
            slots: the first view of each place, oldest first.
            least: the probability that is needed.

        Returns:
            None if it is at none, or lost.
        """
        return self._locate(slots, least, np.array(self._map.pose))

    def _locate(self, slots: Sequence[int], least: float, here: Floats) -> Location | None:
        config = self.config
        if not slots or self.is_lost:
            return None
        there = self._map.nodes[[self._nodes[slot] for slot in slots]]
        robot = np.array(self._map.pose)
        apart = np.hypot(*(here - there)[:, :2].T)
        turns = np.abs(wrapped(here[2] - there[:, 2]))
        inside = (apart < config.radius_m) & (turns < config.radius_rad)
        for index in np.flatnonzero(inside).tolist():
            check = self._check(slots[index], relative_to(there[index], robot))
            sd_m, sd_rad = check.allowed_m / config.sigmas, check.allowed_rad / config.sigmas
            share = _NORMAL.cdf((config.radius_m - float(apart[index])) / sd_m)
            share *= _NORMAL.cdf((config.radius_rad - float(turns[index])) / sd_rad)
            if share >= least:
                return Location(slots[index], share, relative_to(there[index], here))
        return None

    def arrive(self, candidate: Candidate, candidates: Sequence[Candidate]) -> None:
        """Put the robot where a match says, let the map give way, and learn from the match.

        Args:
            candidate: the match.
            candidates: all views that resemble the scan, which tell how much odometry is off.
        """
        pose = candidate.relative_pose
        assert pose is not None
        target, before = self._nodes[candidate.slot], self._map.pose
        self._map.apply(ActionKind.CREATE_EDGE, self._map.current, target, pose[2], pose[:2])
        self._map.relax(False)
        self._was_moved |= math.dist(before[:2], self._map.pose[:2]) > _REVISED_M
        if self._losses and target < self._losses[-1]:
            self._losses = [node for node in self._losses if node <= target]
            self._hypotheses.clear()
        views = [(one.slot, one.relative_pose) for one in candidates if one.relative_pose]
        stored = self._map.nodes[[self._nodes[slot] for slot, _ in views]]
        poses = compose(stored, np.array([seen for _, seen in views]).reshape(-1, 3))
        right = agree(poses, np.array(self._map.pose))
        changed = self._calibration.observe([views[row] for row in np.flatnonzero(right)])
        if changed is not None:
            self._map.rescale_odometry(*changed)
            self._map.relax(True)
        self._map.set_odometry_deviations(*self._calibration.deviations)

    def store(self) -> None:
        """Store where the robot is as the place of a new view."""
        self._nodes.append(len(self._map))
        self._calibration.store()
        self._create_node()

    def pass_by(self) -> None:
        """Note where the robot is, without a view."""
        if math.hypot(*self._map.offset[:2]) > _NODE_M or self._losses[-1:] == [len(self._map)]:
            self._create_node()

    def _create_node(self) -> None:
        number = len(self._map)
        self._map.apply(ActionKind.CREATE_NODE, self._map.current, number, 0.0, (0.0, 0.0))
        self._map.relax(False)

    def remove(self, slot: int) -> None:
        """Forget which node a stored view has; the node stays."""
        del self._nodes[slot]
        self._calibration.remove(slot)

    def note_answer(self, scan: int, id: int) -> None:
        """Remember an answer, which may be revised within ``window`` scans."""
        self._answers.append(Answer(scan, id, self._map.current, self._map.offset))
        del self._answers[: -self.config.window or None]

    @property
    def may_revise(self) -> bool:
        """Whether ``revise`` may find any: answers were held back, or a match moved the robot."""
        held_back = any(answer.id == NO_VIEW for answer in self._answers)
        return not self.is_lost and (held_back or self._was_moved)

    def revise(
        self, slots: Sequence[int], ids: Sequence[int], least: float
    ) -> list[tuple[int, int]]:
        """Answers that turn out to be others, now that the robot is better known where it was.

        Args:
            slots, ids: the first view of each place, oldest first, and its id.
            least: the probability that an answer needs.

        Returns:
            Scans and their ids, -1 for those that were matched wrongly and are at no known place.
        """
        self._was_moved = False
        firsts = dict(zip(ids, slots, strict=True))
        nodes, found = self._map.nodes, []
        for index, answer in enumerate(self._answers):
            pose = compose(nodes[answer.node : answer.node + 1], np.array([answer.offset]))[0]
            place = self._locate(slots, least, pose)
            id = answer.id if place is None else ids[slots.index(place.slot)]
            if place is None and answer.id in firsts:
                first = nodes[self._nodes[firsts[answer.id]]]
                if math.hypot(*(pose - first)[:2]) > 2 * self.config.radius_m:
                    id = NO_VIEW
            elif 0 <= answer.id < id:  # both are near enough
                id = answer.id
            if id != answer.id:
                found.append((answer.scan, id))
                self._answers[index] = answer._replace(id=id)
        return found

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything but the configuration, as arrays for ``restore``."""
        last = () if self._last is None else self._last
        answers = [(scan, id, node) for scan, id, node, _ in self._answers]
        offsets = [offset for *_, offset in self._answers]
        parts = {
            "map": self._map.state(),
            "calibration": self._calibration.state(),
            "hypotheses": self._hypotheses.state(),
            "answers": {
                "numbers": np.array(answers, np.int64).reshape(-1, 3),
                "offsets": np.array(offsets, float).reshape(-1, 3),
            },
        }
        return {
            "nodes_of_slots": np.array(self._nodes, np.int64),
            "last": np.array(last, float),
            "losses": np.array(self._losses, np.int64),
            "was_moved": np.array(self._was_moved),
            **join_parts(parts),
        }

    def restore(self, state: Mapping[str, NDArray[Any]], slots: int) -> None:
        """Go on from a state.

        Args:
            state: of ``state``.
            slots: number of stored views.

        Raises:
            DataError: the arrays are invalid.
        """
        self._map.restore(part_of(state, "map"))
        self._calibration.restore(part_of(state, "calibration"), slots)
        self._hypotheses.restore(part_of(state, "hypotheses"))
        self._restore_answers(part_of(state, "answers"))
        nodes, last, losses = (state[name] for name in ("nodes_of_slots", "last", "losses"))
        valid = nodes.dtype == np.int64 and nodes.shape == (slots,)
        if not valid or not ((nodes >= 0) & (nodes < len(self._map))).all():
            raise DataError(f"{slots} views, but nodes {nodes.dtype} {nodes.shape} of a filter")
        rising = losses.ndim == 1 and (np.diff(losses, prepend=0) > 0).all()
        if losses.dtype != np.int64 or not rising or (losses > len(self._map)).any():
            raise DataError(f"losses of a filter: {losses.tolist()}, expected ascending nodes")
        if last.shape not in ((0,), (3,)) or not np.isfinite(last).all():
            raise DataError(f"last pose {last.tolist()} of a filter: expected x, y and heading")
        self._nodes, self._was_moved = nodes.tolist(), bool(state["was_moved"])
        self._losses = losses.tolist()
        x, y, heading = last.tolist() or (0.0, 0.0, 0.0)
        self._last = (x, y, heading) if last.size else None

    def _restore_answers(self, state: Mapping[str, NDArray[Any]]) -> None:
        numbers, offsets = state["numbers"], state["offsets"]
        count = len(numbers)
        if numbers.dtype != np.int64 or (numbers.shape, offsets.shape) != ((count, 3),) * 2:
            raise DataError(
                f"answers of a filter: {numbers.dtype} {numbers.shape}, {offsets.shape}"
            )
        if (numbers[:, 2] >= len(self._map)).any() or (numbers[:, 2] < 0).any():
            raise DataError("answers of a filter name nodes that are not there")
        rows = zip(numbers.tolist(), offsets.tolist(), strict=True)
        self._answers = [Answer(scan, id, node, (x, y, t)) for (scan, id, node), (x, y, t) in rows]


def _ground(pose: Matrix) -> tuple[Place | None, str]:
    """x, y and heading of odom_from_robot; None and the reason if it is no rigid motion."""
    matrix = np.asarray(pose)
    if matrix.shape != (4, 4) or matrix.dtype.kind not in "fiu":
        raise ShapeError(
            f"odometry: {matrix.dtype} {matrix.shape}, expected numbers (4, 4)",
            fields=("odometry",),
        )
    if not np.isfinite(matrix).all():
        return None, "odometry is not finite"
    if not is_rigid(matrix):
        return None, "odometry is no rotation and translation"
    x, y, heading = places_of(matrix[None].astype(np.float64))[0].tolist()
    return (x, y, heading), ""
