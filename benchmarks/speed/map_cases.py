# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""An action of the experience map, with its relaxation: a robot that drives about in known streets.

Every action closes a loop. Times are means over blocks of actions, as relaxing the whole map, now
and then, is shared by all of them.
"""

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve

from benchmarks.speed.cases import Agreement, Bound, Case, agree
from benchmarks.speed.curves import MAP, OURS, Curve, Step
from benchmarks.speed.inputs import Inputs
from benchmarks.speed.settings import Settings
from fusionslam.ratslam import Action, ActionKind, ExperienceMap

SWEEPS = "the same sweeps in NumPy"
SOLVER = "SciPy: the whole map solved sparsely, one step"
STEP_M = 0.5
BLOCK = 20  # steps from one crossing to the next, more or less
ACTIONS = 200  # in one block of actions

Floats = NDArray[np.float64]


@dataclass
class Town:
    """A drive over a square grid of streets that never ends, each time into a lane least driven.

    Attributes:
        graph: the map so far.
        side: crossings along a side of the grid.
        block: steps from one crossing to the next.
        nodes: by the place, its node.
        checked: whether loops are, before they are closed.
    """

    graph: ExperienceMap
    side: int
    block: int
    nodes: dict[tuple[int, int, int], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.checked = self.graph.config.model_dump()["preset"] == "robust"
        self._random = np.random.default_rng(0)
        self._driven = Counter[tuple[int, int, int]]()
        self._steps = self._drive()
        self.graph.apply(Action(ActionKind.CREATE_NODE))

    def _drive(self) -> Iterator[tuple[int, tuple[int, int, int]]]:
        """Quarter turns before a step, and the place after it."""
        x = y = heading = 0
        while True:
            ways = [
                way
                for way, (dx, dy) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1)))
                if way != (heading + 2) % 4 and 0 <= x + dx < self.side and 0 <= y + dy < self.side
            ]
            least = min(self._driven[x, y, way] for way in ways)
            way = int(self._random.choice([w for w in ways if self._driven[x, y, w] == least]))
            self._driven[x, y, way] += 1
            dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[way]
            for step in range(1, self.block + 1):
                turn = (way - heading + 1) % 4 - 1 if step == 1 else 0
                yield turn, (self.block * x + step * dx, self.block * y + step * dy, way)
            x, y, heading = x + dx, y + dy, way

    def leg(self) -> tuple[float, tuple[int, int, int]]:
        """How far odometry turns before the next step, and the place after it."""
        turn, place = next(self._steps)
        return 1.01 * turn * np.pi / 2 + float(self._random.normal(0, 0.002)), place

    def act(self, turn: float, place: tuple[int, int, int]) -> None:
        """One step, with its action."""
        self.graph.on_odometry(1.02 * STEP_M, turn, 1.0)
        here, target = self.graph.current, self.nodes.get(place)
        if target is None or target == here:
            target = self.nodes[place] = len(self.graph)
            action = Action(ActionKind.CREATE_NODE, here, target)
        else:
            action = Action(ActionKind.CREATE_EDGE, here, target)
            if self.checked and not self.graph.check(action).accepted:
                action = Action(ActionKind.CREATE_NODE, here, len(self.graph))
        self.graph.apply(action)
        self.graph.relax()

    def grow(self, count: int) -> None:
        """Drives until there are so many nodes."""
        while len(self.graph) < count:
            self.act(*self.leg())

    def seconds(self) -> float:
        """Mean of an action, over ``ACTIONS`` of them: odometry, check, apply, relax."""
        legs = [self.leg() for _ in range(ACTIONS)]
        begin = time.perf_counter()
        for turn, place in legs:
            self.act(turn, place)
        return (time.perf_counter() - begin) / ACTIONS


def town(count: int, preset: str = "robust") -> Town:
    """A town with about so many nodes, nearly all of whose streets are known in both directions."""
    side = max(3, round((1 + np.sqrt(1 + count / BLOCK)) / 2))
    lanes = 4 * side * (side - 1)
    made = Town(ExperienceMap(preset=preset), side, round(count / lanes))
    made.grow(int(0.95 * lanes * made.block))
    return made


def map_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """The reference's sweeps and ours, at the size of the reference run and far beyond."""
    small, large = settings.maps
    reference = town(small, "openratslam")
    yield Case(
        f"action on a map of {len(reference.graph)} nodes, openratslam",
        SWEEPS,
        reference.seconds,
        Swept(reference.graph).time,
        lambda: agree("places apart, m", Swept(reference.graph).apart(), 1e-9),
        Bound("median", "<=", 0.07),
    )
    for count, most_ms in ((small, 0.07), (large, 1.0)):
        made = town(count)
        yield Case(
            f"action on a map of {len(made.graph):,} nodes, robust",
            SOLVER,
            made.seconds,
            Solved(made.graph).time,
            Solved(made.graph).check,
            Bound("median", "<=", most_ms),
            detail=Solved(made.graph).lag,
        )


def map_curves(settings: Settings, step: Step) -> list[Curve]:
    """The cost of an action by the size of the map, and SciPy's while it takes no more than is
    patient."""
    sizes, ours, theirs = list[int](), list[float](), list[float]()
    for count in settings.towns:
        step(f"a map of {count:,} nodes")
        made = town(count)
        sizes.append(len(made.graph))
        ours.append(min(made.seconds() for _ in range(5)))
        if len(theirs) == len(sizes) - 1:
            seconds = Solved(made.graph).time()
            theirs += [seconds] if seconds <= settings.patience else []
    stopped = "" if len(theirs) == len(sizes) else f"a step takes more than {settings.patience} s"
    work = "loop closed on a map"
    return [
        Curve(MAP, work, OURS, sizes, ours, ""),
        Curve(MAP, work, SOLVER, sizes[: len(theirs)], theirs, stopped),
    ]


def _ways(links: NDArray[np.void], headings: Floats) -> Floats:
    way = headings[links["source"]] + links["heading"]
    ways: Floats = links["distance"] * np.stack([np.cos(way), np.sin(way)])
    return ways


def _wrapped(angle: Floats) -> Floats:
    return np.arctan2(np.sin(angle), np.cos(angle))


class Swept:
    """Relaxation link by link, as the reference does it."""

    def __init__(self, graph: ExperienceMap) -> None:
        self.graph = graph

    def relaxed(self) -> Floats:
        nodes, correction = self.graph.nodes, self.graph.config.model_dump()["correction"]
        links = self.graph.links
        links = links[np.argsort(links["source"], kind="stable")]
        for _ in range(self.graph.config.model_dump()["loops"]):
            for link in links:
                one, other = nodes[link["source"]], nodes[link["target"]]
                way = one[2] + link["heading"]
                expected = link["distance"] * np.array([np.cos(way), np.sin(way)])
                error = (other[:2] - one[:2] - expected) * correction
                turn = _wrapped(other[2] - one[2] - link["facing"]) * correction
                one[:2] += error
                other[:2] -= error
                one[2], other[2] = one[2] + turn, other[2] - turn
        return nodes

    def time(self) -> float:
        begin = time.perf_counter()
        self.relaxed()
        return time.perf_counter() - begin

    def apart(self) -> float:
        """From what ours makes of the same map, metres."""
        wanted = self.relaxed()
        self.graph.relax()
        return float(np.abs(self.graph.nodes - wanted)[:, :2].max())


class Solved:
    """Gauss-Newton over all nodes with SciPy's sparse solver, after each action."""

    def __init__(self, graph: ExperienceMap) -> None:
        self.graph = graph

    def stepped(self, nodes: Floats) -> Floats:
        """One step; node 0 stays."""
        links = self.graph.links
        one, other, count = links["source"], links["target"], len(links)
        way = _ways(links, nodes[:, 2])
        sd = np.concatenate([links["sd_m"], links["sd_m"], links["sd_rad"]])
        turn = _wrapped(nodes[other, 2] - nodes[one, 2] - links["facing"])
        error = np.concatenate([*((nodes[other, :2] - nodes[one, :2]).T - way), turn])
        # Of each axis: -1 at the source, 1 at the target, and how the source's heading turns it.
        rows = np.arange(3 * count)
        ends = [np.concatenate([3 * end + axis for axis in range(3)]) for end in (one, other)]
        heading = 3 * np.concatenate([one, one]) + 2
        turned = np.concatenate([way[1], -way[0]])
        values = np.concatenate([-np.ones(3 * count), np.ones(3 * count), turned])
        row = np.concatenate([rows, rows, rows[: 2 * count]])
        column = np.concatenate([*ends, heading])
        matrix = csr_matrix((values / sd[row], (row, column)), shape=(3 * count, nodes.size))[:, 3:]
        step = spsolve((matrix.T @ matrix).tocsc(), -matrix.T @ (error / sd))
        moved: Floats = nodes + np.concatenate([np.zeros(3), step]).reshape(-1, 3)
        return moved

    def time(self) -> float:
        begin = time.perf_counter()
        self.stepped(self.graph.nodes)
        return time.perf_counter() - begin

    def apart(self) -> float:
        """Of its places from those of the converged map, root mean square, metres."""
        nodes = self.graph.nodes
        for _ in range(4):
            nodes = self.stepped(nodes)
        return float(np.sqrt(((nodes - self.graph.nodes)[:, :2] ** 2).sum(axis=1).mean()))

    def lag(self) -> str:
        """How far a map that is driven on is behind."""
        return f"{1e3 * self.apart():.2g} mm rms from the converged map while driving on"

    def check(self) -> Agreement:
        """Ours against SciPy's, once nothing is left for later actions."""
        while not self.graph.relax().settled:
            pass
        return agree("places from the converged map, rms, m", self.apart(), 1e-3)
