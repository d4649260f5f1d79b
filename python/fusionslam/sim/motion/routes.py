# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Shortest ways over an occupancy map, and round trips through many places."""

from typing import Any

import numpy as np

from fusionslam.errors import DataError
from fusionslam.sim.motion.occupancy import OccupancyMap
from fusionslam.storage.arrays import Floats, Integers

Place = tuple[float, float]

# A way costs up to (1 + _AVERSION) times its length within _COMFORT_M of where there is no room.
_COMFORT_M = 0.5
_AVERSION = 3.0
# Costs up to which the search for a way looks first: most ways are short.
_NEAR = (5.0, 20.0)
# Neighbours of a cell in rows and columns; the other four are those of its neighbours.
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


class RouteFinder:
    """Ways between the reachable cells of a map, numbered from 0 by row, then column.

    Attributes:
        room: the map, grown by the clearance that was asked for.
        x, y: float64 (N), middle of each reachable cell, metres.
        comfort: float64 (N), 0 beside an obstacle to 1 at 0.5 m from it and beyond.
    """

    def __init__(self, grid: OccupancyMap, clearance_m: float) -> None:
        """Raises DataError if no cell is reachable with this clearance."""
        self.room = grid.inflated(clearance_m)
        cells = np.argwhere(self.room.reachable)
        if not len(cells):
            raise DataError(
                f"the map has no reachable cell {clearance_m:.2f} m from obstacles: "
                "expected a smaller clearance or a map with more room"
            )
        self._number = np.full(self.room.reachable.shape, -1)
        self._number[tuple(cells.T)] = np.arange(len(cells))
        self.x, self.y = self.room.centres(cells[:, 0], cells[:, 1])
        apart = self.room.clearance()[tuple(cells.T)]
        self.comfort = np.minimum(apart / _COMFORT_M, 1.0)
        self._graph = self._edges(1 + _AVERSION * (1 - self.comfort))

    def cell(self, place: Place) -> int:
        """The number of the cell that holds a place. Raises DataError if it is not reachable."""
        if not self.room.is_free(*place):
            raise DataError(
                f"({place[0]:.2f}, {place[1]:.2f}) m is not reachable with the clearance asked for"
            )
        row, column, _ = self.room.cells(*place)
        return int(self._number[row, column])

    def costs(self, cell: int) -> Floats:
        """What the best way from a cell to each other one costs, float64 (N)."""
        return self._search(cell, np.inf)[0]

    def way(self, start: int, end: int) -> Integers:
        """The cells of the best way between two, both included."""
        for limit in (*_NEAR, np.inf):
            costs, before = self._search(end, limit)
            if np.isfinite(costs[start]):
                break
        chain = [start]
        while chain[-1] != end:
            chain.append(int(before[chain[-1]]))
        return np.array(chain)

    def _search(self, cell: int, limit: float) -> tuple[Floats, Integers]:
        """Costs of the best ways from a cell, up to a limit, and the cell before each."""
        from scipy.sparse.csgraph import dijkstra

        found: tuple[Floats, Integers] = dijkstra(
            self._graph, indices=cell, return_predecessors=True, limit=limit
        )
        return found

    def _edges(self, cost: Floats) -> Any:
        """The graph of neighbouring cells, as long as they are apart times what they cost."""
        from scipy.sparse import coo_matrix

        starts, ends, weights = [], [], []
        rows, columns = self.room.reachable.shape
        for down, across in _NEIGHBOURS:
            here = self._number[: rows - down, max(0, -across) : columns - max(0, across)]
            there = self._number[down:, max(0, across) : columns + min(0, across)]
            both = (here >= 0) & (there >= 0)
            starts.append(here[both])
            ends.append(there[both])
            length = np.hypot(down, across) * self.room.resolution_m
            weights.append(length * (cost[here[both]] + cost[there[both]]) / 2)
        pairs = (np.concatenate(starts), np.concatenate(ends))
        size = len(self.x)
        one_way = coo_matrix((np.concatenate(weights), pairs), (size, size)).tocsr()
        return one_way + one_way.T


def spread_cells(
    finder: RouteFinder, spacing_m: float, rng: np.random.Generator
) -> tuple[Integers, Floats]:
    """Cells spread over the reachable area, and what the ways between them cost.

    Each next one is far from all before it, and rather in the open than at a wall (farthest point
    sampling, Gonzalez 1985), until every cell is near one.

    Args:
        finder: of ways.
        spacing_m: no cell costs more than this to reach from the nearest one chosen.
        rng: decides the first one, and among those about equally far.

    Returns:
        int64 (K), and float64 (K, K).
    """
    taste = (0.5 + 0.5 * finder.comfort) * rng.uniform(0.9, 1.0, len(finder.x))
    chosen: list[int] = []
    rows: list[Floats] = []
    nearest = np.full(len(finder.x), np.inf)
    candidate = int(rng.integers(len(finder.x)))
    while nearest[candidate] > spacing_m:
        chosen.append(candidate)
        costs = finder.costs(candidate)
        rows.append(costs[chosen])
        nearest = np.minimum(nearest, costs)
        candidate = int(np.argmax(nearest * taste))
    matrix = np.zeros((len(chosen), len(chosen)))
    for number, row in enumerate(rows):
        matrix[number, : number + 1] = matrix[: number + 1, number] = row
    return np.array(chosen), matrix


def round_trip(costs: Floats, most: float, start: int = 0) -> Integers:
    """An order of places, from one of them, that makes a short way through them and back.

    Cheapest insertion (Rosenkrantz, Stearns and Lewis 1977), then the exchanges of 2-opt (Croes
    1958) while one helps, until all places are in it or the next one would cost too much.

    Args:
        costs: float64 (K, K), of the ways between them, symmetric.
        most: what the way may cost; two places are in it in any case.
        start: the first place.

    Returns:
        int64 (M), 2 <= M <= K for K >= 2.
    """
    tour = np.array([start])
    while len(tour) < len(costs):
        longer = _inserted(tour, costs)
        if len(tour) > 1 and tour_cost(longer, costs) > most:
            break
        tour = longer
        while (better := _exchanged(tour, costs)) is not None:
            tour = better
    return tour


def tour_cost(tour: Integers, costs: Floats) -> float:
    """What a way through places and back costs."""
    return float(costs[tour, np.roll(tour, -1)].sum())


def _inserted(tour: Integers, costs: Floats) -> Integers:
    """The tour with one more place, where that costs least."""
    left = np.setdiff1d(np.arange(len(costs)), tour)
    after = np.roll(tour, -1)
    more = costs[np.ix_(tour, left)] + costs[np.ix_(after, left)] - costs[tour, after][:, None]
    where, place = np.unravel_index(np.argmin(more), more.shape)
    return np.insert(tour, where + 1, left[place])


def _exchanged(tour: Integers, costs: Floats) -> Integers | None:
    """The tour with the stretch turned round that saves most; None if none saves anything."""
    after = np.roll(tour, -1)
    old = costs[tour, after]
    gain = old[:, None] + old[None, :] - costs[np.ix_(tour, tour)] - costs[np.ix_(after, after)]
    gain[np.tril_indices(len(tour), 1)] = 0
    first, last = np.unravel_index(np.argmax(gain), gain.shape)
    if gain[first, last] < 1e-9:
        return None
    better = tour.copy()
    better[first + 1 : last + 1] = tour[first + 1 : last + 1][::-1]
    return better
