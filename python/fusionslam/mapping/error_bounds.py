# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How sure keyframes are while a map grows: bounds that need no solution of the graph."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from heapq import heappop, heappush
from itertools import count
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.geometry.se3 import carry_covariance, inverse
from fusionslam.mapping.edge import Edge, reverse


class Bound(NamedTuple):
    """How sure a keyframe's pose is at least.

    Attributes:
        covariance: float64 (6, 6), as of ``Edge``, of the pose's error against the first keyframe
            of its part, by one chain of believed edges from there. What the whole graph leaves is
            less.
        unconfirmed_m: metres of way since a believed loop confirmed the position, or since the
            stretch of odometry began.
    """

    covariance: Floats
    unconfirmed_m: float


class ErrorBounds:
    """Bounds on the errors of keyframes by their numbers, kept up as a map grows.

    Args:
        roots: numbers of the first keyframes of parts.
        keyframes: numbers of all, ascending.
        edges: that are believed, each within a part.
    """

    def __init__(
        self, roots: Iterable[int], keyframes: Iterable[int], edges: Iterable[Edge]
    ) -> None:
        self._covariances: dict[int, Floats] = {}
        self._unconfirmed: dict[int, float] = {}
        earlier: defaultdict[int, list[Edge]] = defaultdict(list)
        for edge in edges:
            earlier[max(edge.a, edge.b)].append(edge)
        around: defaultdict[int, list[Edge]] = defaultdict(list)
        for number in keyframes:
            for way in self._drive(number, earlier[number]):
                around[way.a].append(way)
                around[way.b].append(way)
        # Dijkstra 1959; lengths are the variances of positions.
        order = count()  # of what is equally long
        waiting = [(0.0, next(order), root, np.zeros((6, 6))) for root in roots]
        while waiting:
            _, _, number, covariance = heappop(waiting)
            if number in self._covariances:
                continue
            self._covariances[number] = covariance
            for way in around[number]:
                if not {way.a, way.b} <= self._covariances.keys():
                    on = way if way.a == number else reverse(way)
                    ahead = _extend(covariance, on)
                    heappush(waiting, (_size(ahead), next(order), on.b, ahead))

    def __getitem__(self, keyframe: int) -> Bound:
        return Bound(self._covariances[keyframe], self._unconfirmed[keyframe])

    def add(self, keyframe: int, edges: Iterable[Edge]) -> None:
        """Take in a keyframe with its believed edges to earlier ones; without any it is a root."""
        chains = [_extend(self._covariances[way.a], way) for way in self._drive(keyframe, edges)]
        self._covariances[keyframe] = min(chains, key=_size, default=np.zeros((6, 6)))

    def _drive(self, keyframe: int, edges: Iterable[Edge]) -> list[Edge]:
        """Note how far a keyframe is from the last confirmation; its ways from earlier ones."""
        ways: dict[int, Edge] = {}
        driven = None
        for edge in edges:
            way = edge if edge.b == keyframe else reverse(edge)
            if edge.kind == "odometry":
                driven = way
            ways[way.a] = _fuse(ways[way.a], way) if way.a in ways else way
        self._unconfirmed[keyframe] = 0.0
        if driven is not None and len(ways) == 1:
            moved = float(np.linalg.norm(driven.pose[:3, 3]))
            self._unconfirmed[keyframe] = self._unconfirmed[driven.a] + moved
        return [*ways.values()]


def _fuse(one: Edge, other: Edge) -> Edge:
    """Two measurements of the same way as one, at the pose of the better one."""
    information = np.linalg.inv(one.covariance) + np.linalg.inv(other.covariance)
    better = min(one, other, key=lambda each: _size(each.covariance))
    return replace(better, covariance=np.linalg.inv(information))


def _extend(covariance: Floats, way: Edge) -> Floats:
    """Covariance of the error at the end of a way, of that at its begin."""
    return carry_covariance(inverse(way.pose), covariance) + way.covariance


def _size(covariance: Floats) -> float:
    return float(np.trace(covariance[:3, :3]))
