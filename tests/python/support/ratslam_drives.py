# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Laps round a block, with odometry that drifts, for tests of the experience map."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from fusionslam.geometry.rigid import fit_rigid
from fusionslam.ratslam import Action, ActionKind, ExperienceMap

STEP_M = 0.5
NODES_A_LAP = 120


class Leg(NamedTuple):
    """One step of ``STEP_M`` and a second: where odometry and truth have it, and its place."""

    way: float
    turn: float
    place: int
    truth: tuple[float, float, float]


class Driven(NamedTuple):
    """A map, the true poses of its nodes, and the checks of its loops."""

    graph: ExperienceMap
    truth: Any
    checks: list[Any]

    @property
    def accepted(self) -> int:
        return sum(check.accepted for check in self.checks)

    def rmse(self) -> float:
        """Of its nodes, metres."""
        return rmse(self.graph.nodes, self.truth)


def rmse(poses: Any, truth: Any) -> float:
    """After rigid alignment, metres."""
    aligned = fit_rigid(np.asarray(poses), np.asarray(truth)).apply(np.asarray(poses))
    return float(np.sqrt(((aligned - truth)[:, :2] ** 2).sum(axis=1).mean()))


def laps(count: float, *, scale: float = 1.02, turn: float = 1.01, seed: int = 0) -> Iterator[Leg]:
    """Round a block of 20 m by 10 m, counter-clockwise."""
    random = np.random.default_rng(seed)
    x = y = heading = 0.0
    corners = (40, 60, 100, 120)
    for number in range(round(count * NODES_A_LAP)):
        place = number % NODES_A_LAP
        turned = np.pi / 2 if place in corners or (place == 0 and number) else 0.0
        heading += turned
        x, y = x + STEP_M * np.cos(heading), y + STEP_M * np.sin(heading)
        way = STEP_M * scale * (1 + 0.01 * random.normal())
        yield Leg(way, turned * turn + 0.002 * random.normal(), place, (x, y, heading))


Claim = Callable[[int, dict[int, int], int], int | None]
"""Of the step's number, the nodes by place, and the place: the node that a view says it is."""


def right(number: int, nodes: dict[int, int], place: int) -> int | None:
    """The node that was made there."""
    return nodes.get(place)


def drive(graph: ExperienceMap, legs: Iterator[Leg], claim: Claim = right) -> Driven:
    """Every step ends at a loop, if one is claimed and believed, or at a new node."""
    graph.apply(Action(ActionKind.CREATE_NODE))
    truth, checks, nodes = [(0.0, 0.0, 0.0)], [], dict[int, int]()
    for number, leg in enumerate(legs):
        graph.on_odometry(leg.way, leg.turn, 1.0)
        here, target = graph.current, claim(number, nodes, leg.place)
        if target is not None and target != here:
            loop = Action(ActionKind.CREATE_EDGE, here, target)
            checks.append(graph.check(loop))
            if checks[-1].accepted:
                graph.apply(loop)
                graph.relax()
                continue
        nodes.setdefault(leg.place, len(graph))
        graph.apply(Action(ActionKind.CREATE_NODE, here, len(graph)))
        graph.relax()
        truth.append(leg.truth)
    return Driven(graph, np.array(truth), checks)


def reckoned(legs: Iterator[Leg]) -> Driven:
    """The same by odometry alone: a map without loops."""
    return drive(ExperienceMap(), legs, lambda *_: None)


def weighted_errors(nodes: Any, links: Any) -> Any:
    """float64 (m, 3): what links say of place and rotation, over their deviations."""
    one, other = nodes[links["source"]], nodes[links["target"]]
    way = one[:, 2] + links["heading"]
    place = other[:, :2] - one[:, :2]
    place = place - links["distance"][:, None] * np.stack([np.cos(way), np.sin(way)], axis=1)
    turn = other[:, 2] - one[:, 2] - links["facing"]
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    return np.column_stack([place / links["sd_m"][:, None], turn / links["sd_rad"]])
