# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of whole courses, simulated and recorded, and the paths that they follow."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.accuracy.ratslam_courses import Course, with_false_matches
from drives import LittleCourse, drive, lap_course, laps
from fusionslam import DataError
from fusionslam.config import merged
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig
from fusionslam.pipelines.drives import open_drive
from fusionslam.pipelines.maps import run_ratslam
from fusionslam.ratslam import (
    Action,
    ActionKind,
    ExperienceMap,
    RatSlam,
    RatSlamConfig,
    Route,
    Sighting,
    StampOrder,
)
from fusionslam.ratslam.events import Event

ROBUST = RatSlamConfig(preset="robust")
ORIGINAL = RatSlamConfig(preset="openratslam")
UNCHECKED = merged(ROBUST, {"map": {"sigmas": 1e6}})


def metres(report: MapReport) -> tuple[float, float]:
    """RMSE of the nodes on the map, and by dead reckoning."""
    assert report.nodes is not None
    assert report.nodes_by_odometry is not None
    return report.nodes.rmse_m, report.nodes_by_odometry.rmse_m


@pytest.mark.parametrize("measured", [True, False])
@pytest.mark.parametrize("times", [1, 2])
def test_a_map_beats_the_drift_and_the_original(times: int, measured: bool) -> None:
    course = lap_course(measured=measured).drifting(times)
    found, reckoned = metres(course.judged(ROBUST))
    original, _ = metres(course.judged(ORIGINAL))
    assert found < 0.75 * reckoned
    assert found < 0.9 * original


def test_views_that_say_where_they_are_leave_exact_odometry_exact() -> None:
    found, reckoned = metres(lap_course().judged(ROBUST))
    assert reckoned < 0.001
    assert found < 0.02


def test_views_that_only_say_what_they_are_cost_exact_odometry_centimetres() -> None:
    found, _ = metres(lap_course(measured=False).judged(ROBUST))
    assert found < 0.08


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_false_loops_do_not_fold_the_map(share: float) -> None:
    course = lap_course().drifting().misled(share)
    report = course.judged(ROBUST)
    found, reckoned = metres(report)
    assert report.false_loops == 0
    assert found < 0.5 * reckoned


def test_it_is_the_check_that_keeps_the_map_from_folding() -> None:
    course = lap_course().drifting().misled(0.2)
    report = course.judged(ROBUST)
    assert report.refused > 0
    unchecked, _ = metres(course.judged(UNCHECKED))
    original, _ = metres(course.judged(ORIGINAL))
    assert min(unchecked, original) > 5 * metres(report)[0]


def test_rooms_that_all_look_alike_do_not_fold_the_map() -> None:
    # A corridor whose second half looks like the first, in the same order: the loops agree.
    course = twins(lap_course(1))
    found, _ = metres(course.judged(ROBUST))
    assert found < 0.1
    assert metres(course.judged(ORIGINAL))[0] > 5 * found


def twins(course: LittleCourse) -> LittleCourse:
    """The second half of a lap, views in the same order as in the first."""
    half = len(course.sightings) // 2
    told = [
        Sighting(one.stamp_ns, course.sightings[i % half].view_id)
        for i, one in enumerate(course.sightings)
    ]
    return LittleCourse(course.speeds, course.poses, told)


def test_the_map_is_the_same_however_late_views_arrive() -> None:
    course = lap_course(2).drifting().misled(0.1)
    at_once = mapped(course, delay_s=0.0)
    late = mapped(course, delay_s=0.4)
    assert np.array_equal(at_once.nodes, late.nodes)
    assert np.array_equal(at_once.links, late.links)


def mapped(course: LittleCourse, delay_s: float) -> ExperienceMap:
    """What comes of events that arrive in another order than that of their stamps."""
    arriving: list[tuple[float, Event]] = [(motion.stamp_ns, motion) for motion in course.motions]
    arriving += [(view.stamp_ns + delay_s * 1e9, view) for view in course.sightings]
    slam, order = RatSlam(ROBUST), StampOrder(wait=0.5)
    for _, event in sorted(arriving, key=lambda pair: pair[0]):
        for ready in order.add(event):
            slam.step(ready)
    for ready in order.flush():
        slam.step(ready)
    return slam.map


@pytest.fixture(scope="module")
def warehouse(test_data: Path) -> Course:
    return Course(open_drive(test_data / "recordings" / "warehouse.npz"), "objects")


def errors_of(report: MapReport) -> tuple[float, float, float]:
    """RMSE of the nodes, of dead reckoning at the same moments, and of the final trajectory."""
    assert report.nodes is not None
    assert report.nodes_by_odometry is not None
    assert report.trajectory is not None
    return report.nodes.rmse_m, report.nodes_by_odometry.rmse_m, report.trajectory.rmse_m


def test_views_that_are_looked_at_once_give_the_map_of_a_run(
    warehouse: Course, test_data: Path
) -> None:
    recording = test_data / "recordings" / "warehouse.npz"
    again = run_ratslam(recording, "objects", "truth+noise", ROBUST, errors=DRIFT)
    once = warehouse.run(ROBUST, DRIFT)
    assert np.array_equal(again.nodes, once.nodes)
    assert np.array_equal(again.links, once.links)
    assert np.array_equal(again.final_poses, once.final_poses)


def test_the_map_of_the_warehouse_beats_its_odometry_and_the_original(warehouse: Course) -> None:
    report = judge_map(warehouse.run(ROBUST, DRIFT))
    nodes, reckoned, trajectory = errors_of(report)
    assert nodes < 0.6 * reckoned
    assert trajectory < 0.6 * reckoned
    assert report.false_loops == 0
    assert report.linked_revisits > 0.8 * report.revisits
    original = judge_map(warehouse.run(RatSlamConfig(preset="openratslam"), DRIFT))
    assert nodes < 0.6 * errors_of(original)[0]


def test_odometry_without_errors_suffers_little(warehouse: Course) -> None:
    nodes, reckoned, _ = errors_of(judge_map(warehouse.run(ROBUST, OdometryConfig())))
    assert reckoned < 0.01
    assert nodes < 0.1


def test_wrong_views_in_the_warehouse_do_not_fold_its_map(warehouse: Course) -> None:
    told, wrong = with_false_matches(warehouse, 0.2)
    assert wrong > 50
    report = judge_map(warehouse.run(ROBUST, DRIFT, told))
    nodes, reckoned, _ = errors_of(report)
    assert nodes < 0.75 * reckoned
    # One that is no farther off than odometry may be is believed.
    assert report.false_loops < 0.05 * wrong


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
