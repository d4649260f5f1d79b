# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bad input to the experience map: an error that says what is wrong, and nothing has changed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fusionslam import ConfigError, DataError
from fusionslam.ratslam import Action, ActionKind, ExperienceMap
from ratslam_drives import drive, laps

NODE, EDGE = ActionKind.CREATE_NODE, ActionKind.CREATE_EDGE


@pytest.fixture(params=["robust", "openratslam"])
def graph(request: pytest.FixtureRequest) -> ExperienceMap:
    made = drive(ExperienceMap(preset=request.param), laps(1.2)).graph
    made.check(Action(EDGE, made.current, 70))
    return made


def unchanged(graph: ExperienceMap, work: Callable[[], object], message: str) -> None:
    before = graph.state()
    with pytest.raises(DataError, match=message):
        work()
    for name, values in graph.state().items():
        assert values.tobytes() == before[name].tobytes(), name


@pytest.mark.parametrize("values", [(np.nan, 0, 1), (0, np.inf, 1), (0, 0, np.nan), (1, 0, -0.1)])
def test_odometry_that_is_not_finite_or_goes_back_in_time_is_an_error(
    graph: ExperienceMap, values: tuple[float, float, float]
) -> None:
    unchanged(graph, lambda: graph.on_odometry(*values), "expected finite values, no way")


def test_no_time_is_no_motion(graph: ExperienceMap) -> None:
    before = graph.pose
    graph.on_odometry(5.0, 3.0, 0.0)
    assert graph.pose == before


def test_odometry_that_overflows_is_an_error(graph: ExperienceMap) -> None:
    for values in ((1e300, 0.0, 1e300), (1e100, 0.1, 1.0), (0.0, 1e100, 1.0), (0.0, 0.0, 1e100)):
        unchanged(graph, lambda values=values: graph.on_odometry(*values), "beyond 1e12")


@pytest.mark.parametrize("target", [0, 122, -1])
def test_a_node_that_is_not_the_next_one_is_an_error(graph: ExperienceMap, target: int) -> None:
    action = Action(NODE, graph.current, target)
    unchanged(graph, lambda: graph.apply(action), f"node {target}: expected 121, the next one")


@pytest.mark.parametrize("values", [(NODE, 0, 121.5), (EDGE, None, 0), (np.nan, 0, 0)])
def test_an_action_that_is_no_whole_numbers_is_an_error(
    graph: ExperienceMap, values: tuple[Any, Any, Any]
) -> None:
    unchanged(graph, lambda: graph.apply(Action(*values)), "expected whole numbers")
    unchanged(graph, lambda: graph.check(Action(*values)), "expected whole numbers")


@pytest.mark.parametrize("target", [121, -1])
def test_an_edge_to_an_unknown_node_is_an_error(graph: ExperienceMap, target: int) -> None:
    action = Action(EDGE, graph.current, target)
    unchanged(graph, lambda: graph.apply(action), f"edge to node {target}: there are 121")


def test_an_edge_of_an_empty_map_is_an_error() -> None:
    empty = ExperienceMap()
    unchanged(empty, lambda: empty.apply(Action(EDGE, 0, 0)), "there are 0")


def test_an_edge_from_where_the_robot_is_not_is_an_error(graph: ExperienceMap) -> None:
    unchanged(graph, lambda: graph.apply(Action(EDGE, 3, 5)), "the robot is at node")


@pytest.mark.parametrize(
    ("rotation", "place"), [(np.nan, (0, 0)), (0.0, (np.inf, 0.0)), (0.0, (0.0, 1e300))]
)
def test_a_rotation_or_place_that_is_not_finite_is_an_error(
    graph: ExperienceMap, rotation: float, place: tuple[float, float]
) -> None:
    action = Action(EDGE, graph.current, 5, rotation, place)
    unchanged(graph, lambda: graph.apply(action), "not finite")
    unchanged(graph, lambda: graph.check(action), "not finite")


def test_an_edge_to_the_node_itself_makes_no_link(graph: ExperienceMap) -> None:
    count = len(graph.links)
    graph.apply(Action(EDGE, graph.current, graph.current))
    graph.relax()
    assert len(graph.links) == count


def longer(values: Any) -> Any:
    return np.concatenate([values.ravel(), values.ravel()[:1]])


def put(index: Any, value: Any) -> Callable[[Any], Any]:
    def changed(values: Any) -> Any:
        values = values.copy()
        values[index] = value
        return values

    return changed


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("version", lambda _: np.array([7]), "version"),
        ("nodes", longer, "three values"),
        ("nodes", put((3, 1), np.nan), "nodes holds a value that is not finite"),
        ("nodes", lambda values: values.astype(np.float32), "dtype"),
        ("nodes", lambda values: values[:50], "there are 50"),
        ("ends", put((0, 1), 500), "ends names node 500"),
        ("ends", put((0, 1), -1), "ends names node -1"),
        ("ends", put((0, 1), 0), "joins node 0 to itself"),
        ("ends", longer, "ends has"),
        ("links", put((2, 0), np.inf), "links holds a value that is not finite"),
        ("nodes", put((3, 2), 1e300), "beyond 1e12"),
        ("links", put((2, 4), 0.0), "variance is not above 0"),
        ("links", longer, "links has"),
        ("loops", longer, "ends has"),
        ("robot", put(0, np.nan), "robot holds a value that is not finite"),
        ("robot", longer, "robot has"),
        ("counts", put(0, 121), "the current node is 121"),
        ("due", lambda _: np.array([999]), "due names node 999"),
        ("pending", lambda _: np.zeros((1, 5)), "pending has"),
    ],
)
def test_a_state_that_no_map_can_have_is_an_error(
    graph: ExperienceMap, name: str, change: Callable[[Any], Any], message: str
) -> None:
    state = graph.state()
    state[name] = change(state[name])
    unchanged(graph, lambda: graph.restore(state), message)


@pytest.mark.parametrize("name", ["version", "nodes", "ends", "links", "robot", "pending"])
def test_a_state_without_one_of_its_arrays_is_an_error(graph: ExperienceMap, name: str) -> None:
    state = graph.state()
    del state[name]
    unchanged(graph, lambda: graph.restore(state), name)


@pytest.mark.parametrize(
    "change",
    [{"correction": 0.6}, {"loops": -1}, {"preset": "best"}, {"drift_m": 0.0}, {"sigma": 3}],
)
def test_a_configuration_out_of_range_is_an_error(change: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(change))):
        ExperienceMap(**change)


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
