# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The quickest way between two nodes."""

from typing import Any

import numpy as np
import pytest

from fusionslam import DataError
from fusionslam.ratslam import Action, ActionKind, ExperienceMap, Route
from ratslam_drives import drive, laps

NODE, EDGE = ActionKind.CREATE_NODE, ActionKind.CREATE_EDGE


def line(*seconds: float) -> ExperienceMap:
    graph = ExperienceMap()
    graph.apply(Action(NODE))
    for number, dt in enumerate(seconds):
        graph.on_odometry(0.5, 0.0, dt)
        graph.apply(Action(NODE, number, number + 1))
    return graph


def test_a_way_takes_as_long_as_its_links_forth_and_back() -> None:
    graph = line(1.0, 2.0, 4.0)
    assert graph.path(0, 3) == Route([0, 1, 2, 3], 7.0)
    assert graph.path(3, 1) == Route([3, 2, 1], 6.0)
    assert graph.path(2, 2) == Route([2], 0.0)


def test_seconds_decide_not_the_number_of_links() -> None:
    graph = line(1.0, 1.0, 1.0)
    graph.on_odometry(0.1, 0.0, 100.0)
    graph.apply(Action(EDGE, 3, 0))
    assert graph.path(0, 3) == Route([0, 1, 2, 3], 3.0)


def test_a_loop_is_a_short_cut() -> None:
    graph = line(*[1.0] * 9)
    graph.on_odometry(0.5, 0.0, 0.5)
    graph.apply(Action(EDGE, 9, 0))
    assert graph.path(1, 8) == Route([1, 0, 9, 8], 2.5)


def test_links_that_take_no_time_are_ways_too() -> None:
    assert line(0.0, 1.0).path(0, 2) == Route([0, 1, 2], pytest.approx(1.0))


def test_networkx_finds_ways_as_quick() -> None:
    networkx = pytest.importorskip("networkx", reason="networkx is not installed")
    graph = drive(ExperienceMap(), laps(2.3)).graph
    peer = networkx.Graph()
    for link in graph.links:
        known = peer.get_edge_data(link["source"], link["target"], {"seconds": np.inf})
        peer.add_edge(
            link["source"], link["target"], seconds=min(known["seconds"], link["duration"])
        )
    random = np.random.default_rng(0)
    for a, b in random.integers(len(graph), size=(30, 2)).tolist():
        route = graph.path(a, b)
        wanted = networkx.shortest_path_length(peer, a, b, weight="seconds")
        assert route.seconds == pytest.approx(wanted)
        each = [peer.edges[pair]["seconds"] for pair in zip(route.ids, route.ids[1:], strict=False)]
        assert sum(each) == pytest.approx(route.seconds)
        assert (route.ids[0], route.ids[-1]) == (a, b)


@pytest.mark.parametrize(("a", "b"), [(-1, 0), (0, 3), (7, 9), (0.5, 0), (0, None)])
def test_unknown_nodes_are_errors_that_say_how_many_there_are(a: Any, b: Any) -> None:
    with pytest.raises(DataError, match=f"from node {a} to node {b}: there are 3 nodes"):
        line(1.0, 1.0).path(a, b)


def test_an_empty_map_has_no_way() -> None:
    with pytest.raises(DataError, match="there are 0 nodes"):
        ExperienceMap().path(0, 0)


def test_nodes_that_no_links_join_are_an_error() -> None:
    graph = line(1.0, 1.0)
    state = graph.state()
    state["ends"] = np.array([[0, 1], [1, 0]])  # as if the last link led back
    graph.restore(state)
    with pytest.raises(DataError, match="from node 0 to node 2: no links join them"):
        graph.path(0, 2)
