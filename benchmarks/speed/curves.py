# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Cost against size: points of a cloud, rows of a table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import fusionslam
from benchmarks.speed.descriptor_cases import PAPER
from benchmarks.speed.inputs import Inputs, random_descriptors
from benchmarks.speed.peers import native
from benchmarks.speed.search_cases import filled, searches
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import Call, Times, alternate, exponent, timer

DESCRIPTORS = "descriptors"
SEARCH = "search"
MAP = "map"
WIDTH = 192


@dataclass(frozen=True)
class Curve:
    """Least times by size: growth shows best without what else the machine did.

    Attributes:
        panel: DESCRIPTORS, SEARCH or MAP.
        work: what is done; curves of one work have one colour.
        who: "fusionslam" or the peer.
        sizes, seconds: what was measured.
        stopped: why there is nothing beyond the last size; "" if there is.
    """

    panel: str
    work: str
    who: str
    sizes: Sequence[int]
    seconds: Sequence[float]
    stopped: str

    @property
    def exponent(self) -> float:
        """b of cost = a * size ** b."""
        return exponent(self.sizes, self.seconds)


OURS = "fusionslam"
Step = Callable[[str], None]


def descriptor_curves(inputs: Inputs, settings: Settings, step: Step) -> list[Curve]:
    """Descriptors of clouds."""
    curves = _Curves(DESCRIPTORS, settings)
    for size in settings.clouds:
        step(f"clouds of {size:,} points")
        points, colors = inputs.sized(size)
        cloud = native.PclCloud(points, colors)
        radius = 5 * fusionslam.cloud_resolution(points)
        works: dict[str, dict[str, Call]] = {
            f"{name} paper": {
                OURS: partial(ours, *arguments, preset="paper"),
                PAPER: partial(paper, *arguments),
            }
            for name, ours, paper, arguments in (
                ("M2DP", fusionslam.m2dp, native.paper_m2dp, (points,)),
                ("c-M2DP", fusionslam.cm2dp, native.paper_cm2dp, (points, colors)),
            )
        }
        works["c-M2DP robust"] = {OURS: partial(fusionslam.cm2dp, points, colors)}
        works["normals + CSHOT"] = {
            OURS: partial(fusionslam.cshot, points, colors, normal_radius=radius),
            "PCL": partial(_pcl_cshot, cloud, radius),
        }
        curves.add(size, works)
    return curves.finished()


def _pcl_cshot(cloud: Any, radius: float) -> object:
    return native.pcl_cshot(native.PclSurface(cloud, radius=radius))


def search_curves(settings: Settings, step: Step) -> list[Curve]:
    """One query in tables."""
    curves = _Curves(SEARCH, settings)
    query = random_descriptors(1, WIDTH, seed=1)
    for size in settings.searches:
        step(f"a table of {size:,} descriptors")
        rows = random_descriptors(size, WIDTH)
        index, peers = filled(rows), searches(rows)
        calls: dict[str, Call] = {OURS: partial(index.query, query[0])}
        calls |= {peer: partial(search, query) for peer, search in peers.items()}
        curves.add(size, {f"1 query, width {WIDTH}": calls})
    return curves.finished()


class _Curves:
    """Curves of one panel while they grow."""

    def __init__(self, panel: str, settings: Settings) -> None:
        self._panel = panel
        self._settings = settings
        self._points: dict[tuple[str, str], list[tuple[int, float]]] = {}
        self._stopped: dict[tuple[str, str], str] = {}

    def add(self, size: int, works: dict[str, dict[str, Call]]) -> None:
        """Time everything at one size; ours alternates with each of its peers."""
        for work, calls in works.items():
            ours = calls[OURS]
            peers = [who for who in calls if who != OURS]
            going = [who for who in peers if not self._too_slow(work, who, size)]
            if not self._too_slow(work, OURS, size):
                self._time(work, size, ours, {who: calls[who] for who in going})

    def _time(self, work: str, size: int, ours: Call, peers: dict[str, Call]) -> None:
        mine: list[float] = []
        for who, peer in peers.items():
            samples = alternate(timer(ours), timer(peer), self._settings.curve)
            mine += samples[0]
            self._keep(work, who, size, samples[1])
        if not peers:
            mine, _ = alternate(timer(ours), lambda: 0.0, self._settings.curve)
        self._keep(work, OURS, size, mine)

    def _keep(self, work: str, who: str, size: int, samples: Sequence[float]) -> None:
        self._points.setdefault((work, who), []).append((size, Times.of(samples).minimum))

    def _too_slow(self, work: str, who: str, size: int) -> bool:
        key = (work, who)
        if key in self._stopped:
            return True
        if key not in self._points:
            return False
        before, seconds = self._points[key][-1]
        expected = seconds * size / before  # nothing here is faster than linear
        if expected <= self._settings.patience:
            return False
        self._stopped[key] = (
            f"not beyond {before:,}: a call would take more than {self._settings.patience:g} s"
        )
        return True

    def finished(self) -> list[Curve]:
        """Ours first in each work."""
        keys = sorted(self._points, key=lambda key: (key[0], key[1] != OURS))
        return [self._curve(*key) for key in keys]

    def _curve(self, work: str, who: str) -> Curve:
        points = self._points[work, who]
        sizes, seconds = [n for n, _ in points], [s for _, s in points]
        stopped = self._stopped.get((work, who), "")
        return Curve(self._panel, work, who, sizes, seconds, stopped)
