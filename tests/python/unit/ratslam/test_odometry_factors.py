# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The map is told how much odometry is off as a whole; views that follow closely count less."""

import math
from typing import Any

import numpy as np
import pytest

from drives import same, unchanged, weighted_errors
from fusionslam import DataError
from fusionslam._core import ExperienceMap as CoreMap
from fusionslam._core import ExperienceMapConfig
from fusionslam.base.arrays import Floats
from fusionslam.ratslam import Action, ActionKind, ExperienceMap
from rows import rows

NODE, EDGE = ActionKind.CREATE_NODE, ActionKind.CREATE_EDGE
QUARTER = math.pi / 2
SIDE = 6.0

Map = ExperienceMap | CoreMap


def core_map(**changes: Any) -> CoreMap:
    return CoreMap(ExperienceMapConfig(**changes))


def add_node(graph: Map) -> None:
    action = (NODE, graph.current, len(graph), 0.0, (0.0, 0.0))
    if isinstance(graph, CoreMap):
        graph.apply(*action)
    else:
        graph.apply(Action(*action))


def go(graph: Map, *motions: tuple[float, float]) -> None:
    """Drive so many metres, then turn by so many radians; there is a node after each."""
    if not len(graph):
        add_node(graph)
    for way, turn in motions:
        graph.on_odometry(way, 0.0, 1.0)
        graph.on_odometry(0.0, turn, 1.0)
        add_node(graph)


def square(graph: ExperienceMap, way: float = 1.0, turn: float = 1.0) -> ExperienceMap:
    """Twice round a square of three nodes a side, with odometry that is too long."""
    go(graph, *[(2 * way, 0.0), (2 * way, 0.0), (2 * way, QUARTER * turn)] * 8)
    return graph


def square_nodes() -> Floats:
    """Where the nodes are: the walls of the square one after the other, by hand."""
    along = [(0.0, 0), (2.0, 0), (4.0, 0)]
    east = [(s, 0.0, t) for s, t in along]
    north = [(SIDE, s, t + QUARTER) for s, t in along]
    west = [(SIDE - s, SIDE, t + math.pi) for s, t in along]
    south = [(0.0, SIDE - s, t - QUARTER) for s, t in along]
    return np.array([*(east + north + west + south) * 2, (0.0, 0.0, 0.0)])


def assert_near(nodes: Floats, wanted: Floats, atol: float = 1e-5) -> None:
    apart = nodes - wanted
    assert np.abs(apart[:, :2]).max() < atol
    assert np.abs(np.angle(np.exp(1j * apart[:, 2]))).max() < atol


def test_a_square_of_true_odometry_is_where_it_is_by_hand() -> None:
    assert_near(square(ExperienceMap()).nodes, square_nodes(), 1e-9)


@rows("scales", [(1.02, 1.0), (1.0, 1.03), (0.95, 1.05)])
def test_rescaled_odometry_gives_the_true_map(scales: tuple[float, float]) -> None:
    way, turn = scales
    graph = square(ExperienceMap(tolerance=1e-9), way, turn)
    assert np.abs(graph.nodes - square_nodes())[:, :2].max() > 0.1
    graph.rescale_odometry(1 / way, 1 / turn)
    done = graph.relax(whole=True)
    assert_near(graph.nodes, square_nodes())
    assert done.residual_m < 1e-5 and done.residual_rad < 1e-5


def test_loops_that_views_measured_are_not_rescaled() -> None:
    graph = square(ExperienceMap(tolerance=1e-9), 1.02)
    # At the end of both laps the robot is at its first node, as the view says.
    graph.apply(Action(EDGE, graph.current, 0))
    before = graph.links
    graph.rescale_odometry(1 / 1.02, 1.0)
    after = graph.links
    is_loop = graph.state()["loops"] == 1
    assert is_loop.sum() == 1 and after[is_loop] == before[is_loop]
    assert after["distance"][~is_loop] == pytest.approx(before["distance"][~is_loop] / 1.02)
    done = graph.relax(whole=True)
    assert_near(graph.nodes, square_nodes())
    assert done.residual_m < 1e-6 and graph.pose == pytest.approx((0, 0, 0), abs=1e-6)


def test_factors_multiply() -> None:
    once, twice = (square(ExperienceMap(tolerance=1e-9)) for _ in range(2))
    once.rescale_odometry(1.1 * 0.95, 0.9 * 1.05)
    twice.rescale_odometry(1.1, 0.9)
    twice.rescale_odometry(0.95, 1.05)
    for graph in (once, twice):
        graph.relax(whole=True)
    assert_near(once.nodes, twice.nodes, 1e-6)


def test_a_map_of_no_links_is_left_as_it_is() -> None:
    graph = ExperienceMap()
    graph.rescale_odometry(1.1, 0.9)
    add_node(graph)
    graph.rescale_odometry(1.1, 0.9)
    assert graph.relax(whole=True).settled and graph.pose == (0.0, 0.0, 0.0)


WRONG = [np.nan, np.inf, -np.inf, -0.1, 1e13]


def test_invalid_factors_and_deviations_are_refused_and_change_nothing() -> None:
    graph = square(ExperienceMap())
    graph.set_odometry_deviations(0.02, 0.03)
    for value in (0.0, *WRONG):
        for factors in ((value, 1.0), (1.0, value)):
            with unchanged(graph), pytest.raises(DataError, match="factors"):
                graph.rescale_odometry(*factors)
    for value in WRONG:
        for deviations in ((value, 0.0), (0.0, value)):
            with unchanged(graph), pytest.raises(DataError, match="deviations"):
                graph.set_odometry_deviations(*deviations)


def allowed(
    graph: ExperienceMap, toward: tuple[float, float], deviations: tuple[float, float]
) -> tuple[float, float]:
    """What a loop to the first node may be off by, if it is off in this direction."""
    x, y, heading = graph.pose
    graph.set_odometry_deviations(*deviations)
    place = (x + 0.1 * toward[0], y + 0.1 * toward[1])
    check = graph.check(Action(EDGE, graph.current, 0, heading + 0.1, place))
    assert check.error_m == pytest.approx(0.1) and check.error_rad == pytest.approx(0.1)
    return check.allowed_m, check.allowed_rad


def added(
    graph: ExperienceMap, toward: tuple[float, float], deviations: tuple[float, float]
) -> tuple[float, float]:
    """The deviations by which the factors widen it, metres and radians, one sigma."""
    alone, both = (allowed(graph, toward, two) for two in ((0.0, 0.0), deviations))
    metres, radians = (
        math.sqrt(max(0.0, b**2 - a**2)) / graph.config.sigmas
        for a, b in zip(alone, both, strict=True)
    )
    return metres, radians


AHEAD, LEFT, ASLANT = (1.0, 0.0), (0.0, 1.0), (math.sqrt(0.5), math.sqrt(0.5))


STRAIGHT = [(2.0, 0.0)] * 10
THERE_AND_BACK = [(5.0, 0.0), (5.0, math.pi), (5.0, 0.0), (5.0, 0.0)]
CORNER = [(10.0, QUARTER), (4.0, 0.0), (4.0, 0.0)]
WAY, TURN = 0.02, 0.03
HALF = math.sqrt(0.5)


@rows(
    "course, toward, deviations, metres, radians",
    [
        # On a straight course the way is unsure by its share of the distance.
        (STRAIGHT, AHEAD, (WAY, 0.05), WAY * 20, 0.0),
        (STRAIGHT, LEFT, (WAY, 0.05), 0.0, 0.0),
        (STRAIGHT, ASLANT, (WAY, 0.05), WAY * 20 * HALF, 0.0),
        # A way there and back is as long as it may be.
        (THERE_AND_BACK, AHEAD, (WAY, 0.0), 0.0, 0.0),
        (THERE_AND_BACK, LEFT, (WAY, 0.0), 0.0, 0.0),
        # The turn moves the end, 8 m to the left of it, backwards along the first leg.
        (CORNER, AHEAD, (0.0, TURN), TURN * QUARTER * 8, TURN * QUARTER),
        (CORNER, LEFT, (0.0, TURN), 0.0, TURN * QUARTER),
        (CORNER, AHEAD, (WAY, 0.0), WAY * 10, 0.0),
        (CORNER, LEFT, (WAY, 0.0), WAY * 8, 0.0),
        (CORNER, AHEAD, (WAY, TURN), math.hypot(WAY * 10, TURN * QUARTER * 8), TURN * QUARTER),
        # Each of both factors moves the end in one direction, whatever the error is.
        (
            *(CORNER, ASLANT, (WAY, TURN)),
            *(math.hypot(WAY * (10 + 8), TURN * QUARTER * 8) * HALF, TURN * QUARTER),
        ),
    ],
)
def test_the_factors_of_odometry_move_the_end_of_a_course(
    course: Any, toward: Any, deviations: Any, metres: float, radians: float
) -> None:
    graph = ExperienceMap()
    go(graph, *course)
    assert added(graph, toward, deviations) == pytest.approx((metres, radians), rel=1e-6, abs=1e-6)


@rows("turns, net", [([0.7, 0.7, 0.7], 2.1), ([0.7, -0.7], 0.0), ([2.0] * 4, 8.0)])
def test_only_the_sum_of_all_turns_is_unsure(turns: list[float], net: float) -> None:
    graph = ExperienceMap()
    go(graph, *[(1.0, turn) for turn in turns])
    assert added(graph, AHEAD, (0.0, 0.03))[1] == pytest.approx(0.03 * net, abs=1e-6)


def test_without_deviations_loops_are_checked_as_ever() -> None:
    plain, told = (square(ExperienceMap()) for _ in range(2))
    told.set_odometry_deviations(0.0, 0.0)
    loop = Action(EDGE, plain.current, 2, 0.1, (0.2, 0.1))
    assert plain.check(loop) == told.check(loop)


def test_a_loop_that_only_a_wrong_factor_explains_is_accepted_if_it_may_be_wrong() -> None:
    graph = ExperienceMap()
    go(graph, *[(2.0, 0.0)] * 30)
    loop = Action(EDGE, graph.current, 0, 0.0, (60 / 1.05, 0.0))
    assert not graph.check(loop).accepted
    graph.set_odometry_deviations(0.03, 0.03)
    assert graph.check(loop).accepted


def drive_past(steps: list[float], **config: Any) -> ExperienceMap:
    """Recognise a node each after so many metres, on a straight course that a view joins with the
    first one: new nodes, of which each has a loop to an old one."""
    graph = ExperienceMap(**config)
    go(graph, *[(way, 0.0) for way in steps], (20.0, 0.0))
    graph.apply(Action(EDGE, graph.current, 0))
    for number, way in enumerate(steps, start=1):
        go(graph, (way, 0.0))
        graph.apply(Action(EDGE, graph.current, number))
    return graph


LEAST = 1e-6
"""Variance of odometry of no motion, in squared metres and radians."""


def loops_of(graph: ExperienceMap) -> Any:
    return graph.links[graph.state()["loops"] == 1]


@rows("place_m", [0.4, 0.1])
def test_loops_that_follow_closely_count_less(place_m: float) -> None:
    # In units of twice the deviation of a place; a loop counts at least as a fiftieth.
    shares = [3.0, 1.0, 0.5, 0.25, 0.1, 0.02, 0.01, 0.5]
    graph = drive_past([2 * place_m * share for share in shares], place_m=place_m, place_rad=0.2)
    loops = loops_of(graph)
    repeats = np.array([1, 1, 1, 2, 4, 10, 50, 50, 2])
    assert loops["target"].tolist() == list(range(9))
    assert loops["sd_m"] == pytest.approx(np.sqrt(LEAST + repeats * place_m**2))
    assert loops["sd_rad"] == pytest.approx(np.sqrt(LEAST + repeats * 0.2**2))


def test_loops_in_quick_succession_weigh_together_as_one() -> None:
    far = loops_of(drive_past([0.8] * 2))[1:]
    quick = loops_of(drive_past([0.1] * 16))[1:]
    assert (quick["sd_m"] > 2.8 * far["sd_m"][0]).all()
    for name in ("sd_m", "sd_rad"):
        assert (1 / far[name] ** 2).sum() == pytest.approx((1 / quick[name] ** 2).sum(), rel=1e-3)


def test_deviations_and_the_way_since_the_last_loop_are_part_of_the_state() -> None:
    graph = drive_past([0.8, 0.8])
    graph.on_odometry(-0.3, 0.2, 1.0)
    graph.set_odometry_deviations(0.02, 0.03)
    state = graph.state()
    assert state["robot"].shape == (14,)
    assert state["robot"][11:].tolist() == pytest.approx([0.3, 0.02, 0.03])
    restored = ExperienceMap()
    restored.restore(state)
    assert same(restored.state(), state)
    for each in (graph, restored):
        go(each, (0.1, 0.0))
        each.apply(Action(EDGE, each.current, 1))
    assert graph.links.tobytes() == restored.links.tobytes() and graph.pose == restored.pose


@rows("count", [0, 11, 13, 15])
def test_a_state_with_another_number_of_values_is_refused(count: int) -> None:
    graph = drive_past([0.8])
    state = graph.state()
    state["robot"] = np.resize(state["robot"], count)
    with unchanged(graph), pytest.raises(DataError, match="robot"):
        graph.restore(state)


def carried(before: int | None) -> CoreMap:
    """Ten nodes a metre apart in a row; a robot that may have been carried before one of them."""
    graph = core_map(tolerance=1e-9)
    go(graph, *[(1.0, 0.0)] * 9)
    if before is not None:
        graph.mark_interruption_before(before)
    return graph


ROW = np.array([(float(x), 0.0, 0.0) for x in range(10)])
TURNED = (EDGE, 9, 1, QUARTER, (0.0, 0.5))
"""A loop that has the robot half a metre beside the second node, turned to the left."""


def test_after_an_interruption_before_a_node_a_contradicting_loop_moves_the_nodes_since() -> None:
    graph = carried(5)
    np.testing.assert_array_equal(graph.state()["interruptions"], [5])
    graph.apply(*TURNED)
    # As one piece, so that the last one is where the loop has the robot.
    moved = np.array([(1.0, x - 9 + 0.5, QUARTER) for x in range(5, 10)])
    for _ in range(2):
        assert_near(graph.nodes, np.concatenate([ROW[:5], moved]), 1e-6)
        graph.relax(True)
    assert graph.current == 1 and graph.pose == pytest.approx((1.0, 0.5, QUARTER))
    assert not graph.state()["interruptions"].size
    # Odometry between both parts no longer counts.
    between = next(link for link in graph.links if (link["source"], link["target"]) == (4, 5))
    assert between["sd_m"] > 10 and between["sd_rad"] > 1


@rows(
    "before, loop, links, interruptions",
    [
        (None, TURNED, 10, []),
        (10, TURNED, 9, []),  # after it there is no node yet, so that the loop makes no link
        (5, (EDGE, 9, 1, 0.0, (8.0, 0.0)), 10, []),  # it fits odometry, which ends the doubt
        (5, (EDGE, 9, 6, 0.5, (0.0, 0.0)), 10, [5]),  # among the nodes since: it says nothing
    ],
)
def test_a_loop_that_contradicts_no_interruption_moves_no_node(
    before: int | None, loop: Any, links: int, interruptions: list[int]
) -> None:
    graph = carried(before)
    graph.apply(*loop)
    assert_near(graph.nodes, ROW, 1e-9)
    assert len(graph.links) == links and (graph.links["sd_m"] < 1).all()
    assert graph.state()["interruptions"].tolist() == interruptions
    if before == 10:
        assert graph.pose == pytest.approx((1.0, 0.5, QUARTER))


def test_an_earlier_interruption_is_kept_and_later_ones_are_forgotten() -> None:
    graph = core_map()
    go(graph, (1.0, 0.0), (1.0, 0.0))
    graph.mark_interruption()  # before node 3
    go(graph, *[(1.0, 0.0)] * 3)
    graph.mark_interruption()  # before node 6
    go(graph, *[(1.0, 0.0)] * 4)
    for node, kept in ((7, [3, 6, 7]), (7, [3, 6, 7]), (5, [3, 5]), (3, [3]), (1, [1])):
        graph.mark_interruption_before(node)
        np.testing.assert_array_equal(graph.state()["interruptions"], kept)


@rows("node", [-1, 0, 11, 2**40])
def test_an_interruption_before_no_node_is_refused(node: int) -> None:
    graph = carried(7)
    with unchanged(graph), pytest.raises(DataError, match=f"{node}.*1 to 10"):
        graph.mark_interruption_before(node)
    for empty in (core_map(), core_map(preset="openratslam")):
        with pytest.raises(DataError):
            empty.mark_interruption_before(node)


def test_the_original_preset_knows_no_interruptions_before_nodes_either() -> None:
    graph = core_map(preset="openratslam")
    go(graph, *[(1.0, 0.0)] * 3)
    graph.mark_interruption_before(2)
    assert not graph.state()["interruptions"].size


def arc(turn: float) -> ExperienceMap:
    graph = ExperienceMap(tolerance=1e-9)
    graph.apply(Action(NODE))
    for number in range(16):
        for _ in range(40):
            graph.on_odometry(0.05, turn * math.tau / 16 / 40, 1.0)
        graph.apply(Action(NODE, number, number + 1))
    return graph


def test_rescaled_turns_bend_the_links_too() -> None:
    graph, true = arc(1.03), arc(1.0)
    graph.rescale_odometry(1.0, 1 / 1.03)
    graph.relax(whole=True)
    assert np.abs(graph.nodes - true.nodes)[:, :2].max() < 0.005


def test_links_of_wrong_loops_since_an_interruption_before_a_node_do_not_hold_it_back() -> None:
    graph = core_map(tolerance=1e-9)
    go(graph, *[(1.0, 0.0)] * 7)
    graph.apply(EDGE, 7, 3, 0.0, (4.0, 0.0))  # wrong: it was carried before node 5
    go(graph, *[(1.0, 0.0)] * 2)
    graph.mark_interruption_before(5)
    graph.apply(*TURNED)
    moved = graph.nodes
    relaxed = graph.relax(True)
    links = graph.links
    errors = weighted_errors(graph.nodes, links)[:, :2] * links["sd_m"][:, None]
    residual = math.sqrt((errors**2).sum(axis=1).mean())
    assert relaxed[0] == pytest.approx(residual, rel=0.01, abs=1e-6)
    assert np.abs(graph.nodes - moved)[:, :2].max() < 0.5
