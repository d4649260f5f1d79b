# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The experience map: places, links, relaxation, and its state."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from fusionslam.ratslam import Action, ActionKind, ExperienceMap
from ratslam_drives import drive, laps, rmse, weighted_errors

NODE, EDGE = ActionKind.CREATE_NODE, ActionKind.CREATE_EDGE


def started(**changes: object) -> ExperienceMap:
    graph = ExperienceMap(**changes)
    graph.apply(Action(NODE))
    return graph


def huber(graph: ExperienceMap) -> float:
    """What relaxation lessens: only links of loops may be wrong."""
    squares = (weighted_errors(graph.nodes, graph.links) ** 2).sum(axis=1)
    limit = graph.config.outlier
    far = (graph.state()["loops"] == 1) & (squares > limit**2)
    return float(np.where(far, limit * (2 * np.sqrt(squares) - limit), squares).sum())


def test_a_link_is_what_odometry_measured_since_the_node() -> None:
    graph = started(initial_heading=0.5)
    graph.on_odometry(2.0, 0.0, 1.0)
    graph.on_odometry(1.0, np.pi / 2, 1.0)
    graph.apply(Action(NODE, 0, 1))
    link = graph.links[0]
    assert (link["source"], link["target"], link["duration"]) == (0, 1, 2.0)
    assert link["distance"] == pytest.approx(np.hypot(2, 1))
    assert link["heading"] == pytest.approx(np.arctan2(1, 2))
    assert link["facing"] == pytest.approx(np.pi / 2)
    assert graph.pose == pytest.approx(tuple(graph.nodes[1]))


def test_each_link_has_its_own_duration() -> None:
    graph = started()
    for number, dt in enumerate((1.0, 2.5, 0.5)):
        graph.on_odometry(1.0, 0.0, dt)
        graph.apply(Action(NODE, number, number + 1))
    assert graph.links["duration"].tolist() == [1.0, 2.5, 0.5]


def test_a_longer_way_is_less_certain() -> None:
    graph = started()
    for number, (way, turn) in enumerate(((1.0, 0.0), (4.0, 0.0), (1.0, 2.0))):
        graph.on_odometry(way, turn, 1.0)
        graph.apply(Action(NODE, number, number + 1))
    short, far, turned = graph.links
    assert far["sd_m"] > 1.9 * short["sd_m"]
    assert turned["sd_rad"] > short["sd_rad"]


def test_the_offset_is_the_pose_in_the_frame_of_the_node() -> None:
    graph = started(initial_heading=2.0)
    graph.on_odometry(3.0, 0.0, 1.0)
    graph.on_odometry(0.0, 0.25, 1.0)
    assert graph.offset == pytest.approx((3.0, 0.0, 0.25))


@pytest.mark.parametrize(
    ("sure", "offset"),
    [
        ({"place_m": 0.001, "place_rad": 0.001}, (0.3, -0.2, 0.1)),
        ({"place_m": 100.0, "place_rad": 10.0}, (0.0, 0.0, 0.0)),
    ],
)
def test_a_loop_puts_the_robot_where_the_surer_of_view_and_odometry_has_it(
    sure: dict[str, float], offset: tuple[float, float, float]
) -> None:
    graph = started(**sure)
    graph.on_odometry(2.0, 0.0, 1.0)
    graph.apply(Action(NODE, 0, 1))
    graph.on_odometry(-2.0, 0.0, 1.0)
    graph.apply(Action(EDGE, 1, 0, 0.1, (0.3, -0.2)))
    assert graph.current == 0
    assert graph.offset == pytest.approx(offset, abs=1e-3)
    assert len(graph.links) == 1  # the same two nodes: their link is better known


def test_a_second_way_makes_a_link_more_certain() -> None:
    graph = started(place_m=0.01, place_rad=0.01)
    graph.on_odometry(2.0, 0.0, 1.0)
    graph.apply(Action(NODE, 0, 1))
    before = graph.links[0]["sd_m"]
    for here, there in ((1, 0), (0, 1), (1, 0)):
        graph.on_odometry(2.0 if there else -2.0, 0.0, 1.0)
        graph.apply(Action(EDGE, here, there))
    assert len(graph.links) == 1
    assert graph.links[0]["sd_m"] < before


def test_where_no_loop_is_the_map_is_dead_reckoning() -> None:
    graph = started()
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


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), outlier=st.sampled_from([0.5, 3.0]))
def test_relaxation_never_increases_the_summed_error(seed: int, outlier: float) -> None:
    random = np.random.default_rng(seed)
    graph = started(outlier=outlier)
    for number in range(30):
        graph.on_odometry(random.uniform(0.2, 2.0), random.uniform(-1, 1), 1.0)
        graph.apply(Action(NODE, number, number + 1))
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


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_sweep_of_small_corrections_never_increases_the_summed_error(seed: int) -> None:
    random = np.random.default_rng(seed)
    graph = started(preset="openratslam", correction=0.02, loops=1)
    for number in range(20):
        graph.on_odometry(random.uniform(0.2, 2.0), random.uniform(-1, 1), 1.0)
        graph.apply(Action(NODE, number, number + 1))
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
    assert first.pose == second.pose
    for name, values in first.state().items():
        assert values.tobytes() == second.state()[name].tobytes(), name


def test_two_maps_of_one_drive_are_the_same_bit_for_bit() -> None:
    one, other = (drive(ExperienceMap(), laps(2)).graph for _ in range(2))
    assert one.nodes.tobytes() == other.nodes.tobytes()
    assert one.links.tobytes() == other.links.tobytes()


def test_a_hundred_thousand_nodes_take_no_more_than_200_megabytes() -> None:
    program = """
import resource
from fusionslam.ratslam import Action, ActionKind, ExperienceMap
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
graph = ExperienceMap()
graph.apply(Action(ActionKind.CREATE_NODE))
before = peak()
for number in range(1, 100_000):
    graph.on_odometry(0.5, 0.01, 1.0)
    graph.apply(Action(ActionKind.CREATE_NODE, number - 1, number))
for target in range(0, 20_000, 50):
    graph.on_odometry(0.5, 0.01, 1.0)
    graph.apply(Action(ActionKind.CREATE_EDGE, graph.current, target))
held = peak() - before
graph.relax(whole=True)
print(len(graph), held, peak() - before)
"""
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    count, held, relaxed = out.stdout.split()
    assert int(count) == 100_000
    assert float(held) < 60
    assert float(relaxed) < 200


def test_a_drive_is_judged_like_any_other(capfd: pytest.CaptureFixture[str]) -> None:
    driven = drive(ExperienceMap(), laps(2))
    assert rmse(driven.graph.nodes, driven.truth) == driven.rmse()
    assert capfd.readouterr() == ("", "")
