# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Shortest paths over an occupancy map, and round trips through many places."""

from typing import Any

import numpy as np

from fusionslam.base.arrays import Floats, Integers
from fusionslam.errors import DataError
from fusionslam.sim.motion.occupancy import OccupancyMap

Place = tuple[float, float]

# Within _COMFORT_M of an inflated obstacle, a path costs up to (1 + _AVERSION) times its length.
_COMFORT_M = 0.5
_AVERSION = 3.0
# Cost limits of the first searches for a path: most paths are short.
_NEAR = (5.0, 20.0)
# Offsets (row, column) to four neighbours of a cell; the other four follow by symmetry.
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


class RouteFinder:
    """Paths between the reachable cells of a map, numbered from 0 by row, then column.

    Attributes:
        room: the map, its obstacles inflated by the requested clearance.
        x, y: float64 (N), centre of each reachable cell, metres.
        comfort: float64 (N), from 0 beside an inflated obstacle to 1 at 0.5 m and beyond.
    """

    def __init__(self, grid: OccupancyMap, clearance_m: float) -> None:
        """Raises DataError if no cell is reachable with this clearance."""
        self.room = grid.inflate(clearance_m)
        cells = np.argwhere(self.room.reachable)
        if not len(cells):
            raise DataError(
                f"the map has no reachable cell {clearance_m:.2f} m from obstacles: "
                "expected a smaller clearance or a map with more room",
                code="no-room",
            )
        self._number = np.full(self.room.reachable.shape, -1)
        self._number[tuple(cells.T)] = np.arange(len(cells))
        self.x, self.y = self.room.centres(cells[:, 0], cells[:, 1])
        apart = self.room.clearance()[tuple(cells.T)]
        self.comfort = np.minimum(apart / _COMFORT_M, 1.0)
        self._graph = self._edges(1 + _AVERSION * (1 - self.comfort))

    def cell(self, place: Place) -> int:
        """The number of the cell that contains a point. Raises DataError if it is not reachable."""
        if not self.room.is_free(*place):
            raise DataError(
                f"({place[0]:.2f}, {place[1]:.2f}) m is not reachable with the requested clearance",
                code="unreachable",
                fields=(f"{place[0]:.2f}", f"{place[1]:.2f}"),
            )
        row, column, _ = self.room.cells(*place)
        return int(self._number[row, column])

    def costs(self, cell: int) -> Floats:
        """Costs of the best paths from a cell to every other one, float64 (N)."""
        return self._search(cell, np.inf)[0]

    def way(self, start: int, end: int) -> Integers:
        """The cells of the best path between two cells, both included."""
        for limit in (*_NEAR, np.inf):
            costs, before = self._search(end, limit)
            if np.isfinite(costs[start]):
                break
        chain = [start]
        while chain[-1] != end:
            chain.append(int(before[chain[-1]]))
        return np.array(chain)

    def _search(self, cell: int, limit: float) -> tuple[Floats, Integers]:
        """Costs of the best paths from a cell, up to a limit, and the predecessor of each cell."""
        from scipy.sparse.csgraph import dijkstra

        found: tuple[Floats, Integers] = dijkstra(
            self._graph, indices=cell, return_predecessors=True, limit=limit
        )
        return found

    def _edges(self, cost: Floats) -> Any:
        """The graph of neighbouring cells; a weight is their distance times their mean cost."""
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
    """Choose cells spread over the reachable area, and compute the path costs between them.

    Each new cell is far from all earlier ones and preferably in the open rather than at a wall
    (farthest point sampling, Gonzalez 1985), until every cell is near a chosen one.

    Args:
        finder: finds the paths.
        spacing_m: no cell costs more than this to reach from the nearest chosen one.
        rng: decides the first cell, and among cells about equally far.

    Returns:
        The cells, int64 (K), and the costs, float64 (K, K).
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
    """Order places into a short closed tour from one of them.

    Cheapest insertion (Rosenkrantz, Stearns and Lewis 1977), each followed by 2-opt exchanges
    (Croes 1958) while they help, until all places are in or the next one would cost too much.

    Args:
        costs: float64 (K, K), symmetric path costs between the places.
        most: upper limit of the tour's cost; a tour has at least two places in any case.
        start: the first place.

    Returns:
        int64 (M), 2 <= M <= K for K >= 2.
    """
    tour = np.array([start])
    while len(tour) < len(costs):
        longer = _insert_place(tour, costs)
        if len(tour) > 1 and tour_cost(longer, costs) > most:
            break
        tour = longer
        while (better := _exchange_legs(tour, costs)) is not None:
            tour = better
    return tour


def tour_cost(tour: Integers, costs: Floats) -> float:
    """Cost of a closed tour."""
    return float(costs[tour, np.roll(tour, -1)].sum())


def _insert_place(tour: Integers, costs: Floats) -> Integers:
    """The tour with one more place, chosen and inserted at the least extra cost."""
    left = np.setdiff1d(np.arange(len(costs)), tour)
    after = np.roll(tour, -1)
    more = costs[np.ix_(tour, left)] + costs[np.ix_(after, left)] - costs[tour, after][:, None]
    where, place = np.unravel_index(np.argmin(more), more.shape)
    return np.insert(tour, where + 1, left[place])


def _exchange_legs(tour: Integers, costs: Floats) -> Integers | None:
    """The tour after the 2-opt reversal that saves most; None if none saves anything."""
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
