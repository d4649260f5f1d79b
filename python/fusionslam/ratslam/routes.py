# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ways over a map of places and links: the quickest one between two nodes."""

from typing import NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError


class Route(NamedTuple):
    """A way over a map: ids of the nodes, both ends among them, and how long it takes."""

    ids: list[int]
    seconds: float


def quickest_route(links: NDArray[np.void], count: int, a: int, b: int) -> Route:
    """The quickest way from node a to node b along links, in either direction (Dijkstra 1959).

    Args:
        links: of dtype ``LINK``.
        count: how many nodes there are.
        a, b: ids.

    Raises:
        DataError: a node that there is not, or two that no links join.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    for node in (a, b):
        if not isinstance(node, SupportsIndex) or not 0 <= node < count:
            raise DataError(f"path from node {a} to node {b}: there are {count} nodes")
    ends = np.sort(np.stack([links["source"], links["target"]], axis=1), axis=1)
    # The quickest first: a matrix adds up what stands in it twice.
    order = np.lexsort((links["duration"], ends[:, 1], ends[:, 0]))
    pairs, first = np.unique(ends[order], axis=0, return_index=True)
    # A link that takes no time is one all the same, and an entry of 0 would be none.
    seconds = np.maximum(links["duration"][order][first], np.finfo(np.float64).tiny)
    graph = csr_array((seconds, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    took, before = dijkstra(graph, directed=False, indices=a, return_predecessors=True)
    if not np.isfinite(took[b]):
        raise DataError(f"path from node {a} to node {b}: no links join them")
    ids = [b]
    while ids[-1] != a:
        ids.append(int(before[ids[-1]]))
    return Route(ids[::-1], float(took[b]))
