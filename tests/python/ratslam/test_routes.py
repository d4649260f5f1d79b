# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The quickest way over a map, and its picture."""

from itertools import pairwise

import numpy as np
import pytest

from fusionslam.errors import DataError
from fusionslam.evaluation.maps.run import LINK
from fusionslam.ratslam.experience_map import quickest_route
from reported_maps import CORNERS, alone, drifting_run


def links_of(*links: tuple[int, int, float]) -> np.ndarray:
    """Links of source, target, seconds."""
    made = np.zeros(len(links), LINK)
    for row, (source, target, seconds) in zip(made, links, strict=True):
        row["source"], row["target"], row["duration"] = source, target, seconds
    return made


def relaxed_seconds(links: np.ndarray, count: int, a: int) -> np.ndarray:
    """Seconds to every node, by going over all links until nothing changes (Bellman 1958)."""
    known = np.full(count, np.inf)
    known[a] = 0
    for _ in range(count):
        for link in links:
            for one, other in (("source", "target"), ("target", "source")):
                through = known[link[one]] + link["duration"]
                known[link[other]] = min(known[link[other]], through)
    return known


def test_the_quickest_way_is_by_time_and_not_by_links() -> None:
    links = links_of((0, 1, 1.0), (1, 2, 1.0), (2, 3, 1.0), (0, 3, 9.0))
    assert quickest_route(links, 4, 0, 3) == ([0, 1, 2, 3], 3.0)
    assert quickest_route(links, 4, 3, 0) == ([3, 2, 1, 0], 3.0)
    assert quickest_route(links, 4, 2, 2) == ([2], 0.0)


def test_of_two_links_the_quicker_counts_and_one_of_no_time_is_a_link() -> None:
    links = links_of((0, 1, 5.0), (1, 0, 2.0), (1, 2, 0.0))
    ids, seconds = quickest_route(links, 3, 0, 2)
    assert ids == [0, 1, 2] and seconds == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(5))
def test_ways_are_as_quick_as_going_over_all_links_says(seed: int) -> None:
    draw = np.random.default_rng(seed)
    chain = [(k, k + 1, draw.uniform(1, 5)) for k in range(19)]
    more = [(*draw.choice(20, 2, replace=False).tolist(), draw.uniform(1, 9)) for _ in range(15)]
    links = links_of(*chain, *more)
    known = relaxed_seconds(links, 20, 3)
    joined = {frozenset((int(one["source"]), int(one["target"]))) for one in links}
    for goal in range(20):
        ids, seconds = quickest_route(links, 20, 3, goal)
        assert seconds == pytest.approx(known[goal]) and (ids[0], ids[-1]) == (3, goal)
        assert all(frozenset(pair) in joined for pair in pairwise(ids))


def test_nodes_that_are_unknown_or_apart_are_refused() -> None:
    links = links_of((0, 1, 1.0))
    for a, b, words in ((0, 2, "no links join them"), (0, 3, "there are 3"), (-1, 0, "node -1")):
        with pytest.raises(DataError, match=words):
            quickest_route(links, 3, a, b)
    with pytest.raises(DataError, match="no links join them"):
        quickest_route(links[:0], 2, 0, 1)


def test_the_picture_shows_the_way_over_the_map() -> None:
    pytest.importorskip("matplotlib")
    from fusionslam.report import path_figure

    axis = path_figure(drifting_run(), 3, 1).axes[0]
    assert axis.get_title(loc="left") == "from node 3 to node 1: 2 links, 20.0 m, 4.0 s"
    (way,) = [line for line in axis.lines if line.get_label() == "quickest way"]
    corners = np.array(CORNERS)[:, :2]
    passed = np.stack(way.get_data(), axis=1)
    assert np.allclose(passed[[0, 2]], corners[[3, 1]], atol=1e-6)
    assert np.allclose(passed[1], corners[0], atol=1e-6) or np.allclose(passed[1], corners[2])
    still = path_figure(alone(truth=None), 2, 2).axes[0]
    assert still.get_title(loc="left") == "from node 2 to node 2: 0 links, 0.0 m, 0.0 s"
    with pytest.raises(DataError, match="there are 4 nodes"):
        path_figure(alone(), 0, 4)
