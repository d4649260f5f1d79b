# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The experience map: actions, relaxation, routes, and input that is refused."""

import re
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from drives import drive, laps, same, unchanged, weighted_errors
from fusionslam import DataError
from fusionslam.evaluation.maps.run import LINK
from fusionslam.ratslam import Action, ActionKind, ExperienceMap, Route
from fusionslam.ratslam.experience_map import quickest_route
from maps import CORNERS, alone, drifting_run
from refusals import refuses
from rows import rows

NODE, EDGE = ActionKind.CREATE_NODE, ActionKind.CREATE_EDGE


def start_map(**changes: object) -> ExperienceMap:
    graph = ExperienceMap(**changes)
    graph.apply(Action(NODE))
    return graph


def wander(graph: ExperienceMap, random: np.random.Generator, count: int) -> None:
    """So many nodes more, each after one stretch of odometry."""
    for number in range(count):
        graph.on_odometry(random.uniform(0.2, 2.0), random.uniform(-1, 1), 1.0)
        graph.apply(Action(NODE, number, number + 1))


def huber(graph: ExperienceMap) -> float:
    """The sum that relaxation minimises: only links of loops may be wrong."""
    squares = (weighted_errors(graph.nodes, graph.links) ** 2).sum(axis=1)
    limit = graph.config.outlier
    far = (graph.state()["loops"] == 1) & (squares > limit**2)
    return float(np.where(far, limit * (2 * np.sqrt(squares) - limit), squares).sum())


def test_a_link_is_what_odometry_measured_since_the_node() -> None:
    graph = start_map(initial_heading=0.5)
    graph.on_odometry(2.0, 0.0, 1.0)
    graph.on_odometry(1.0, np.pi / 2, 1.0)
    graph.apply(Action(NODE, 0, 1))
    link = graph.links[0]
    assert (link["source"], link["target"], link["duration"]) == (0, 1, 2.0)
    assert link["distance"] == pytest.approx(np.hypot(2, 1))
    assert link["heading"] == pytest.approx(np.arctan2(1, 2))
    assert link["facing"] == pytest.approx(np.pi / 2)
    assert graph.pose == pytest.approx(tuple(graph.nodes[1]))


def test_each_link_has_its_own_duration_and_longer_ones_are_less_certain() -> None:
    graph = start_map()
    for number, (v, w, dt) in enumerate(((1.0, 0.0, 1.0), (2.0, 0.0, 2.0), (2.0, 4.0, 0.5))):
        graph.on_odometry(v, w, dt)
        graph.apply(Action(NODE, number, number + 1))
    assert graph.links["duration"].tolist() == [1.0, 2.0, 0.5]
    short, far, turned = graph.links
    assert far["sd_m"] > 1.9 * short["sd_m"]
    assert turned["sd_rad"] > short["sd_rad"]


def test_the_offset_is_the_pose_in_the_frame_of_the_node() -> None:
    graph = start_map(initial_heading=2.0)
    graph.on_odometry(3.0, 0.0, 1.0)
    graph.on_odometry(0.0, 0.25, 1.0)
    assert graph.offset == pytest.approx((3.0, 0.0, 0.25))


@rows(
    "sure, offset",
    [
        ({"place_m": 0.001, "place_rad": 0.001}, (0.3, -0.2, 0.1)),
        ({"place_m": 100.0, "place_rad": 10.0}, (0.0, 0.0, 0.0)),
    ],
)
def test_a_loop_puts_the_robot_where_the_surer_of_view_and_odometry_has_it(
    sure: dict[str, float], offset: tuple[float, float, float]
) -> None:
    graph = start_map(**sure)
    graph.on_odometry(2.0, 0.0, 1.0)
    graph.apply(Action(NODE, 0, 1))
    graph.on_odometry(-2.0, 0.0, 1.0)
    graph.apply(Action(EDGE, 1, 0, 0.1, (0.3, -0.2)))
    assert graph.current == 0 and graph.offset == pytest.approx(offset, abs=1e-3)
    assert len(graph.links) == 1  # the same two nodes: their link is better known


def test_a_second_way_makes_a_link_more_certain() -> None:
    graph = start_map(place_m=0.01, place_rad=0.01)
    graph.on_odometry(2.0, 0.0, 1.0)
    graph.apply(Action(NODE, 0, 1))
    before = graph.links[0]["sd_m"]
    for here, there in ((1, 0), (0, 1), (1, 0)):
        graph.on_odometry(2.0 if there else -2.0, 0.0, 1.0)
        graph.apply(Action(EDGE, here, there))
    assert len(graph.links) == 1 and graph.links[0]["sd_m"] < before


def test_where_no_loop_is_the_map_is_dead_reckoning() -> None:
    graph = start_map()
    x = y = heading = 0.0
    for number, leg in enumerate(laps(1)):
        graph.on_odometry(leg.way, leg.turn, 1.0)
        graph.apply(Action(NODE, number, number + 1))
        done = graph.relax()
        assert done.settled and done.residual_m == done.residual_rad == 0
        heading += leg.turn
        x, y = x + leg.way * np.cos(heading), y + leg.way * np.sin(heading)
    assert graph.nodes[-1, :2] == pytest.approx([x, y], abs=1e-9)


def test_scipy_finds_the_same_map() -> None:
    graph = drive(ExperienceMap(outlier=1e6, tolerance=1e-9), laps(1.6)).graph
    done = graph.relax(whole=True)
    nodes, links = graph.nodes, graph.links

    def errors(free: np.ndarray) -> np.ndarray:
        return weighted_errors(np.vstack([nodes[:1], free.reshape(-1, 3)]), links).ravel()

    start = nodes[1:] + np.random.default_rng(0).normal(0, 0.05, (len(nodes) - 1, 3))
    found = least_squares(errors, start.ravel(), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    apart = found.x.reshape(-1, 3) - nodes[1:]
    assert np.abs(apart[:, :2]).max() < 1e-5
    assert np.abs(np.angle(np.exp(1j * apart[:, 2]))).max() < 1e-5
    residual = weighted_errors(nodes, links) * np.stack([links["sd_m"]] * 2 + [links["sd_rad"]], 1)
    place = np.sqrt((residual[:, :2] ** 2).sum(axis=1).mean())
    assert done.settled and done.residual_m == pytest.approx(place, rel=1e-6)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), outlier=st.sampled_from([0.5, 3.0]))
def test_relaxation_never_increases_the_summed_error(seed: int, outlier: float) -> None:
    random = np.random.default_rng(seed)
    graph = start_map(outlier=outlier)
    wander(graph, random, 30)
    for _ in range(10):
        graph.on_odometry(random.uniform(0.2, 2.0), random.uniform(-1, 1), 1.0)
        target = int(random.integers(31))
        if target != graph.current:
            graph.apply(Action(EDGE, graph.current, target, random.uniform(-0.3, 0.3)))
        before = huber(graph)
        done = graph.relax()
        assert huber(graph) <= before * (1 + 1e-12) + 1e-12
        squares = weighted_errors(graph.nodes, graph.links) * np.stack(
            [graph.links["sd_m"]] * 2 + [graph.links["sd_rad"]], 1
        )
        assert done.residual_rad == pytest.approx(np.sqrt((squares[:, 2] ** 2).mean()), abs=1e-9)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_sweep_of_small_corrections_never_increases_the_summed_error(seed: int) -> None:
    random = np.random.default_rng(seed)
    graph = start_map(preset="openratslam", correction=0.02, loops=1)
    wander(graph, random, 20)
    for _ in range(5):
        graph.on_odometry(random.uniform(0.2, 2.0), random.uniform(-1, 1), 1.0)
        target = int(random.integers(20))
        if target != graph.current:
            # Headings that fit: a sweep treats them apart, and would turn ways about.
            turn = graph.nodes[target][2] - graph.pose[2]
            graph.apply(Action(EDGE, graph.current, target, turn))
    for _ in range(20):
        before = (weighted_errors(graph.nodes, graph.links) ** 2).sum()
        graph.relax()
        assert (weighted_errors(graph.nodes, graph.links) ** 2).sum() <= before * (1 + 1e-12)


def test_parts_of_a_map_end_where_the_whole_does() -> None:
    online = drive(ExperienceMap(work=40), laps(3))
    whole = ExperienceMap(tolerance=1e-9)
    whole.restore(online.graph.state())
    online.graph.relax(whole=True)
    whole.relax(whole=True)
    assert np.abs(online.graph.nodes - whole.nodes)[:, :2].max() < 2e-3


def test_a_map_that_goes_on_from_its_state_is_the_same_bit_for_bit() -> None:
    legs = list(laps(2.5))
    first = drive(ExperienceMap(), iter(legs[:170])).graph
    second = ExperienceMap()
    second.restore(first.state())
    for graph in (first, second):
        for leg in legs[170:]:
            graph.on_odometry(leg.way, leg.turn, 1.0)
            graph.check(Action(EDGE, graph.current, (leg.place + 60) % 120))
            graph.apply(Action(EDGE, graph.current, leg.place + 1))
            graph.relax()
    assert first.pose == second.pose and same(first.state(), second.state())


def links_of(*links: tuple[int, int, float]) -> np.ndarray:
    """Links of source, target, seconds."""
    rows = np.zeros(len(links), LINK)
    for row, (source, target, seconds) in zip(rows, links, strict=True):
        row["source"], row["target"], row["duration"] = source, target, seconds
    return rows


def relax_seconds(links: np.ndarray, count: int, a: int) -> np.ndarray:
    """Seconds to every node, by going over all links until nothing changes (Bellman 1958)."""
    known = np.full(count, np.inf)
    known[a] = 0
    for _ in range(count):
        for link in links:
            for one, other in (("source", "target"), ("target", "source")):
                through = known[link[one]] + link["duration"]
                known[link[other]] = min(known[link[other]], through)
    return known


@rows(
    "links, ends, ids, seconds",
    [
        # Time decides, not the number of links, in both directions.
        ([(0, 1, 1.0), (1, 2, 1.0), (2, 3, 1.0), (0, 3, 9.0)], (0, 3), [0, 1, 2, 3], 3.0),
        ([(0, 1, 1.0), (1, 2, 1.0), (2, 3, 1.0), (0, 3, 9.0)], (3, 0), [3, 2, 1, 0], 3.0),
        ([(0, 1, 1.0)], (1, 1), [1], 0.0),
        # The faster of two links counts, and one of no duration is a link.
        ([(0, 1, 5.0), (1, 0, 2.0), (1, 2, 0.0)], (0, 2), [0, 1, 2], 2.0),
    ],
)
def test_the_fastest_route_is_found(
    links: list[tuple[int, int, float]], ends: tuple[int, int], ids: list[int], seconds: float
) -> None:
    assert quickest_route(links_of(*links), 4, *ends) == Route(ids, pytest.approx(seconds))


@rows("seed", range(5))
def test_routes_are_as_fast_as_going_over_all_links_says(seed: int) -> None:
    draw = np.random.default_rng(seed)
    chain = [(k, k + 1, draw.uniform(1, 5)) for k in range(19)]
    more = [(*draw.choice(20, 2, replace=False).tolist(), draw.uniform(1, 9)) for _ in range(15)]
    links = links_of(*chain, *more)
    known = relax_seconds(links, 20, 3)
    joined = {frozenset((int(one["source"]), int(one["target"]))) for one in links}
    for goal in range(20):
        ids, seconds = quickest_route(links, 20, 3, goal)
        assert seconds == pytest.approx(known[goal]) and (ids[0], ids[-1]) == (3, goal)
        assert all(frozenset(pair) in joined for pair in pairwise(ids))


def test_networkx_finds_routes_as_fast_on_a_map() -> None:
    networkx = pytest.importorskip("networkx", reason="networkx is not installed")
    graph = drive(ExperienceMap(), laps(2.3)).graph
    peer = networkx.Graph()
    for source, target, seconds in graph.links[["source", "target", "duration"]].tolist():
        known = peer.get_edge_data(source, target, {"seconds": np.inf})["seconds"]
        peer.add_edge(source, target, seconds=min(known, seconds))
    for a, b in np.random.default_rng(0).integers(len(graph), size=(30, 2)).tolist():
        route = graph.path(a, b)
        wanted = networkx.shortest_path_length(peer, a, b, weight="seconds")
        assert route.seconds == pytest.approx(wanted)
        assert route.seconds == pytest.approx(networkx.path_weight(peer, route.ids, "seconds"))
        assert (route.ids[0], route.ids[-1]) == (a, b)


@rows(
    "links, ends, code",
    [
        ([(0, 1, 1.0)], (0, 2), "nodes-not-linked"),
        ([], (0, 1), "nodes-not-linked"),
        ([(0, 1, 1.0)], (0, 3), "unknown-node"),
        ([(0, 1, 1.0)], (-1, 0), "unknown-node"),
        ([(0, 1, 1.0)], (0.5, 0), "unknown-node"),
        ([(0, 1, 1.0)], (0, None), "unknown-node"),
    ],
)
def test_routes_between_unknown_or_separate_nodes_are_refused(
    links: list[tuple[int, int, float]], ends: tuple[Any, Any], code: str
) -> None:
    with refuses(code):
        quickest_route(links_of(*links), 3, *ends)


def test_the_picture_shows_the_way_over_the_map() -> None:
    pytest.importorskip("matplotlib")
    from fusionslam.report import path_figure

    axis = path_figure(drifting_run(), 3, 1).axes[0]
    assert re.findall(r"[\d.]+", axis.get_title(loc="left")) == ["3", "1", "2", "20.0", "4.0"]
    (way,) = [line for line in axis.lines if line.get_label() == "quickest way"]
    corners = np.array(CORNERS)[:, :2]
    passed = np.stack(way.get_data(), axis=1)
    assert np.allclose(passed[[0, 2]], corners[[3, 1]], atol=1e-6)
    assert np.allclose(passed[1], corners[0], atol=1e-6) or np.allclose(passed[1], corners[2])
    still = path_figure(alone(truth=None), 2, 2).axes[0]
    assert re.findall(r"[\d.]+", still.get_title(loc="left")) == ["2", "2", "0", "0.0", "0.0"]
    with refuses("unknown-node"):
        path_figure(alone(), 0, 4)


@pytest.fixture(params=["robust", "openratslam"])
def graph(request: pytest.FixtureRequest) -> ExperienceMap:
    made = drive(ExperienceMap(preset=request.param), laps(1.2)).graph
    made.check(Action(EDGE, made.current, 70))
    return made


@rows(
    "values",
    [
        *[(np.nan, 0, 1), (0, np.inf, 1), (0, 0, np.nan), (1, 0, -0.1)],
        # Beyond 1e12, where sums of squares could overflow.
        *[(1e300, 0.0, 1e300), (1e100, 0.1, 1.0), (0.0, 1e100, 1.0), (0.0, 0.0, 1e100)],
    ],
)
def test_invalid_odometry_is_refused(graph: ExperienceMap, values: Any) -> None:
    with unchanged(graph), pytest.raises(DataError, match="odometry"):
        graph.on_odometry(*values)


def test_odometry_of_no_duration_is_no_motion(graph: ExperienceMap) -> None:
    before = graph.pose
    graph.on_odometry(5.0, 3.0, 0.0)
    assert graph.pose == before


@rows("target", [0, 122, 121.5])
def test_a_node_that_is_not_the_next_one_is_refused(graph: ExperienceMap, target: Any) -> None:
    with unchanged(graph), pytest.raises(DataError):
        graph.apply(Action(NODE, graph.current, target))


@rows(
    "changes",
    [
        *[{"target": target} for target in (121, -1)],
        *[{"source": source} for source in (3, None)],
        *[{name: np.nan} for name in ("kind", "relative_rotation")],
        *[{"relative_place": place} for place in ((np.inf, 0.0), (0.0, 1e300))],
    ],
)
def test_an_invalid_edge_is_refused(graph: ExperienceMap, changes: dict[str, Any]) -> None:
    action = Action(EDGE, graph.current, 5)._replace(**changes)
    for work in (graph.apply, graph.check):
        with unchanged(graph), pytest.raises(DataError):
            work(action)


def test_an_edge_of_an_empty_map_is_refused() -> None:
    empty = ExperienceMap()
    with unchanged(empty), pytest.raises(DataError, match="node 0"):
        empty.apply(Action(EDGE, 0, 0))


def test_an_edge_to_the_node_itself_makes_no_link(graph: ExperienceMap) -> None:
    count = len(graph.links)
    graph.apply(Action(EDGE, graph.current, graph.current))
    graph.relax()
    assert len(graph.links) == count


def longer(values: Any) -> Any:
    return np.concatenate([values.ravel(), values.ravel()[:1]])


def put(index: Any, value: Any) -> Callable[[Any], Any]:
    def change(values: Any) -> Any:
        values = values.copy()
        values[index] = value
        return values

    return change


@rows(
    "name, change",
    [
        ("version", lambda _: np.array([7])),
        ("nodes", longer),
        ("nodes", put((3, 1), np.nan)),
        ("nodes", put((3, 2), 1e300)),
        ("nodes", lambda values: values.astype(np.float32)),
        ("ends", put((0, 1), 500)),
        ("ends", put((0, 1), -1)),
        ("ends", longer),
        ("links", put((2, 0), np.inf)),
        ("links", longer),
        ("robot", put(0, np.nan)),
        ("robot", longer),
        ("due", lambda _: np.array([999])),
        ("pending", lambda _: np.zeros((1, 5))),
        # The array that does not fit to it is named.
        ("nodes: ends", lambda values: values[:50]),
        ("loops: ends", longer),
        ("ends: node 0", put((0, 1), 0)),
        ("links: variance", put((2, 4), 0.0)),
        ("links: variance", put((2, 5), 1e-9)),
        ("links: distance", put((2, 0), -1.0)),
        ("links: duration", put((2, 3), -1.0)),
        ("ends: node 1", put((0, 0), 3)),
        *[("robot", put(i, -1.0)) for i in (3, 4, 5, 9, 10, 11, 12, 13)],
        *[("robot", put(i, value)) for i in range(14) for value in (np.inf, 1e13)],
        ("pending_ends", lambda _: np.zeros((65, 2), np.int64)),
        ("counts: current node", put(0, 121)),
    ],
)
def test_an_impossible_state_is_refused(graph: ExperienceMap, name: str, change: Any) -> None:
    array, _, named = name.partition(": ")
    state = graph.state()
    state[array] = change(state[array])
    with unchanged(graph), pytest.raises(DataError, match=named or array):
        graph.restore(state)


@rows("heading", [5.0, -7.0, np.pi, 1.0])
def test_a_map_begun_at_any_heading_is_restored_bit_for_bit(heading: float) -> None:
    begun = ExperienceMap(initial_heading=heading)
    state = begun.state()
    assert np.cos(begun.pose[2] - heading) == pytest.approx(1)
    restored = ExperienceMap(initial_heading=heading)
    restored.restore(state)
    assert same(restored.state(), state)


@rows("name", ["version", "nodes", "ends", "links", "robot", "pending"])
def test_a_state_without_one_of_its_arrays_is_refused(graph: ExperienceMap, name: str) -> None:
    state = graph.state()
    del state[name]
    with unchanged(graph), pytest.raises(DataError, match=name):
        graph.restore(state)


def test_headings_of_many_turns_are_taken_as_the_angles_that_they_are() -> None:
    graph = ExperienceMap(preset="openratslam")
    graph.apply(Action(NODE))
    graph.on_odometry(1.0, 0.1, 1.0)
    graph.apply(Action(NODE, 0, 1))
    state = graph.state()
    state["nodes"][1, 2] += 2e9 * np.pi
    graph.restore(state)
    graph.relax()
    assert np.all(np.abs(graph.nodes[:, 2]) <= np.pi)
