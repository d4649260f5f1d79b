# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which loops the experience map believes, and how they find a robot that was carried."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drives import (
    NODES_A_LAP,
    RATE,
    SECOND,
    Leg,
    drive,
    drive_by_odometry,
    lap_course,
    laps,
    process_and_flush,
    right,
    rmse,
)
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.pipelines.map_events import RunEvents
from fusionslam.pipelines.maps import RunRecorder
from fusionslam.ratslam import (
    Action,
    ActionKind,
    ExperienceMap,
    Look,
    LoopCheck,
    OnlineRatSlam,
    RatSlam,
    RatSlamConfig,
)
from fusionslam.ratslam.external_views import GivenViews
from fusionslam.sensors.messages import Odometry
from rows import rows

EDGE = ActionKind.CREATE_EDGE
CERTAIN = {"drift_m": 0.01, "drift_turn": 0.005, "drift_heading": 0.003}
CERTAIN |= {"place_m": 0.1, "place_rad": 0.05}
"""More than odometry is here."""


def once_wrong(number: int, nodes: Any, place: Any) -> Any:
    return nodes[10] if number == NODES_A_LAP + 45 else right(number, nodes, place)


def random_claims(seed: int | None) -> Any:
    """A false loop on every frame, to any node; without a seed always to that of place 10."""
    if seed is None:
        return lambda number, nodes, place: nodes.get(10)
    random = np.random.default_rng(seed)
    return lambda number, nodes, place: int(random.choice(list(nodes.values()))) if nodes else None


def test_true_loops_are_accepted_and_correct_drift() -> None:
    driven = drive(ExperienceMap(), laps(3))
    assert driven.accepted == len(driven.checks) == 2 * NODES_A_LAP
    assert len(driven.graph) == NODES_A_LAP + 1
    assert driven.rmse() < 0.5 * drive_by_odometry(laps(3)).rmse()


def test_one_wrong_match_is_refused_and_folds_the_map_of_the_reference_only() -> None:
    driven, without = drive(ExperienceMap(), laps(2), once_wrong), drive(ExperienceMap(), laps(2))
    assert [k for k, check in enumerate(driven.checks) if not check.accepted] == [45]
    refused = driven.checks[45]
    assert refused.error_m > refused.allowed_m or refused.error_rad > refused.allowed_rad
    assert driven.rmse() == pytest.approx(without.rmse(), abs=0.02)
    folded = drive(ExperienceMap(preset="openratslam"), laps(2), once_wrong)
    assert folded.rmse() > 5 * drive(ExperienceMap(preset="openratslam"), laps(2)).rmse()


@rows("seed", [1, 2, 3, None])
def test_a_false_loop_on_every_frame_does_not_fold_the_map(seed: int | None) -> None:
    # The few that fit what odometry allows after a lap, some 2 m, pull a little.
    driven, folded = (
        drive(ExperienceMap(preset=preset), laps(2), random_claims(seed))
        for preset in ("robust", "openratslam")
    )
    assert driven.accepted < 0.1 * len(driven.checks) and driven.rmse() < 1.25
    assert folded.rmse() > 3 * driven.rmse()


def test_a_street_that_looks_like_another_is_not_taken_for_it_however_long() -> None:
    def opposite(number: int, nodes: Any, place: Any) -> Any:
        # The north side in the second lap is taken for the south side, place by place.
        if number > NODES_A_LAP and 60 <= place < 100:
            return nodes[place - 60]
        return right(number, nodes, place)

    driven, without = drive(ExperienceMap(), laps(2), opposite), drive(ExperienceMap(), laps(2))
    assert driven.accepted == len(driven.checks) - 40
    assert driven.rmse() == pytest.approx(without.rmse(), abs=0.05)


def test_loops_that_agree_are_believed_where_odometry_is_worse_than_it_should_be() -> None:
    legs = {"scale": 1.08, "turn": 1.02}
    graph = ExperienceMap(**CERTAIN, agreed_sigmas=30)
    driven = drive(graph, laps(2, **legs))
    first = [check.accepted for check in driven.checks].index(True)
    assert first >= graph.config.agreeing - 1
    check = driven.checks[first]
    assert check.error_m > check.allowed_m or check.error_rad > check.allowed_rad
    assert all(check.accepted for check in driven.checks[first + 20 :])
    # The loop and those that were refused before it, which it brought along.
    sources = driven.graph.links["source"], driven.graph.links["target"]
    closing = np.abs(sources[0] - sources[1]) > 20
    assert closing.sum() >= graph.config.agreeing


def test_agreement_does_not_help_beyond_its_own_limit() -> None:
    graph = ExperienceMap(**CERTAIN, agreed_sigmas=3)
    assert drive(graph, laps(1.5, scale=1.08, turn=1.02)).accepted == 0


def test_asking_twice_changes_nothing() -> None:
    graph = drive(ExperienceMap(), laps(0.5)).graph
    loop = Action(EDGE, graph.current, 3)
    first, after_first = graph.check(loop), graph.state()
    again = graph.check(loop)
    assert again == first and not first.accepted
    for name, values in graph.state().items():
        np.testing.assert_array_equal(values, after_first[name])


@rows("kind", [ActionKind.NONE, ActionKind.CREATE_NODE])
def test_actions_other_than_loops_are_accepted(kind: ActionKind) -> None:
    assert ExperienceMap().check(Action(kind)).accepted


def test_the_reference_preset_accepts_every_loop_and_measures_its_error() -> None:
    graph = drive(ExperienceMap(preset="openratslam"), laps(0.5)).graph
    check = graph.check(Action(EDGE, graph.current, 3))
    assert check.accepted and check.error_m > check.allowed_m


def test_the_error_of_a_loop_is_the_way_between_both_places() -> None:
    graph = ExperienceMap()
    graph.apply(Action(ActionKind.CREATE_NODE))
    graph.on_odometry(3.0, 0.0, 1.0)
    graph.apply(Action(ActionKind.CREATE_NODE, 0, 1))
    graph.on_odometry(0.0, 0.5, 1.0)
    check = graph.check(Action(EDGE, 1, 0, 0.2, (1.0, 2.0)))
    assert check.error_m == pytest.approx(np.hypot(2.0, 2.0))
    assert check.error_rad == pytest.approx(0.3)


OFF, ON = 130, 185
"""Steps after which the robot is switched off, and where it is put down."""


def carry(graph: ExperienceMap, *parts: tuple[int, int]) -> Iterator[Leg]:
    """These parts of the laps, with an interruption before each but the first."""
    legs = list(laps(4))
    for number, (first, last) in enumerate(parts or ((0, OFF), (ON, 300))):
        if number:
            graph.mark_interruption()
        yield from legs[first:last]


def test_loops_that_agree_put_a_carried_robot_back_on_its_map() -> None:
    graph = ExperienceMap()
    driven = drive(graph, carry(graph))
    late = [check.accepted for check in driven.checks[OFF - 120 :]]
    first = late.index(True)
    # Four loops at least 0.8 m from each other, at steps of 0.5 m, after the first node since the
    # interruption.
    assert first == 1 + 2 * (graph.config.rejoin - 1)
    assert all(late[first:])
    assert driven.rmse() < 0.4
    # The refused loops that agree are linked, too, beside the way by odometry.
    ends = np.sort(np.stack([graph.links["source"], graph.links["target"]], axis=1))
    between = (ends[:, 0] <= NODES_A_LAP) & (ends[:, 1] > NODES_A_LAP)
    assert np.count_nonzero(between) >= graph.config.rejoin + 1


def test_without_an_interruption_the_same_loops_are_refused_for_ever() -> None:
    graph = ExperienceMap()
    legs = list(laps(2.5))
    driven = drive(graph, iter(legs[:OFF] + legs[ON:]))
    assert not any(check.accepted for check in driven.checks[OFF - 120 :][:60])


def test_a_robot_that_was_not_carried_goes_on_as_before() -> None:
    graph = ExperienceMap()
    driven = drive(graph, carry(graph, (0, OFF), (OFF, 300)))
    plain = drive(ExperienceMap(), laps(2.5))
    np.testing.assert_array_equal(graph.nodes, plain.graph.nodes)
    assert not graph.state()["interruptions"].size
    assert driven.checks == plain.checks


def test_wrong_loops_that_do_not_agree_do_not_move_a_robot() -> None:
    random = np.random.default_rng(3)

    def claim(number: int, nodes: Any, place: Any) -> Any:
        if number < OFF:
            return right(number, nodes, place)
        return int(random.choice(list(nodes.values())[:100]))

    graph = ExperienceMap()
    driven = drive(graph, carry(graph), claim)
    accepted = driven.checks[OFF - 120 :]
    fitting = [c for c in accepted if c.error_m <= c.allowed_m and c.error_rad <= c.allowed_rad]
    assert [c for c in accepted if c.accepted] == fitting


def test_a_robot_that_is_carried_twice_is_found_twice() -> None:
    graph = ExperienceMap()
    driven = drive(graph, carry(graph, (0, OFF), (ON, ON + 40), (ON + 90, ON + 160)))
    assert driven.rmse() < 0.4 and not graph.state()["interruptions"].size


def test_a_part_that_no_loop_joined_is_found_by_later_loops() -> None:
    # Day one is half of the block, day two the next side without a loop, day three all of it.
    graph = ExperienceMap()
    driven = drive(graph, carry(graph, (0, 55), (65, 95), (125, 245)))
    assert driven.rmse() < 0.6 and not graph.state()["interruptions"].size
    assert all(check.accepted for check in driven.checks[-20:])


def test_an_interruption_is_part_of_the_state() -> None:
    graph = drive(ExperienceMap(), islice(laps(2.5), OFF)).graph
    graph.mark_interruption()
    graph.mark_interruption()
    state = graph.state()
    np.testing.assert_array_equal(state["interruptions"], [len(graph)])
    restored = ExperienceMap()
    restored.restore(state)
    np.testing.assert_array_equal(restored.state()["interruptions"], [len(graph)])
    for wrong in ([0], [len(graph) + 1], [3, 3], [5, 4]):
        with pytest.raises(DataError, match="interruptions"):
            restored.restore({**state, "interruptions": np.array(wrong)})


def test_a_loop_before_the_first_node_after_an_interruption_makes_no_link() -> None:
    # Nothing is known of the way from the last node: a link would claim the opposite.
    graph = drive(ExperienceMap(), laps(0.5)).graph
    graph.mark_interruption()
    links = len(graph.links)
    loop = Action(ActionKind.CREATE_EDGE, graph.current, 3)
    assert not graph.check(loop).accepted
    graph.apply(loop)
    assert len(graph.links) == links and graph.current == 3
    assert not graph.state()["interruptions"].size


NIGHT = 8 * 3600 * SECOND


@pytest.mark.parametrize("measured", [True, pytest.param(False, marks=pytest.mark.nightly)])
def test_carried_at_night_and_odometry_anew_the_robot_is_found_within_20_s(
    measured: bool, tmp_path: Path
) -> None:
    course = lap_course(4, measured=measured)
    lap = len(course.speeds) // 4
    off, on = 2 * lap, 2 * lap + lap // 2
    online = OnlineRatSlam()
    process_and_flush(online, course.messages(0, off))
    online.save(tmp_path / "map.npz")
    again = OnlineRatSlam.load(tmp_path / "map.npz")
    steps = process_and_flush(again, course.messages(on, on + lap, NIGHT))
    assert any("odometry was reset" in step.why for step in steps[:2])
    found = next(step for step in steps if step.action.kind == ActionKind.CREATE_EDGE)
    assert found.stamp_ns - steps[0].stamp_ns < 20 * SECOND
    stamps = np.array(again.slam.memory.node_stamps_ns) % NIGHT
    truth = course.poses[stamps * RATE // SECOND]
    assert rmse(again.slam.map.nodes, truth) < 0.3


def test_the_record_of_a_run_tells_that_a_carried_robot_was_found() -> None:
    course = lap_course(3)
    lap = len(course.speeds) // 3
    slam = RatSlam(views=GivenViews())
    for message in course.messages(0, 2 * lap):
        slam.step(message)
    day = course.messages(lap // 2, lap + lap // 2, NIGHT)
    motions = [message for message in day if isinstance(message, Odometry)]
    looks = [message for message in day if isinstance(message, Look)]
    stamps = np.array([look.stamp_ns for look in looks])
    seconds = np.arange(lap + 1) / RATE + stamps[0] / SECOND
    truth = Trajectory(seconds, *course.poses[lap // 2 : lap + lap // 2 + 1].T)
    events = RunEvents("day", "wheels", motions, stamps, lambda row: looks[row].item, truth)
    recorder = RunRecorder(slam, events)
    steps = [recorder.step(event) for event in events]
    (recovery,) = recorder.recoveries
    found = next(step for step in steps if step is not None and step.found)
    assert steps[0] is not None and steps[0].interrupted
    assert recovery.seconds == (found.stamp_ns - steps[0].stamp_ns) / SECOND
    assert recovery.refused == slam.map.config.rejoin - 1
    run = recorder.record()
    assert any(str(recovery) in note for note in run.notes)


def test_the_original_preset_knows_no_interruptions() -> None:
    slam = RatSlam(preset="openratslam")
    slam.map.apply(Action(ActionKind.CREATE_NODE))
    slam.map.mark_interruption()
    assert not slam.map.state()["interruptions"].size


@rows("error_m, views, accepted", [(4.0, 11111, False), (4.0, 11112, True), (18.0, 11111, True)])
def test_a_view_of_many_places_does_not_override_odometry(
    error_m: float, views: int, accepted: bool
) -> None:
    """Places count that are farther from the target than half of the error."""
    memory = SimpleNamespace(node_views=[int(each) for each in str(views)], view=1)
    nodes = np.array([(x, 0.0, 0.0) for x in (0, 1, 8, 9, 10)])
    slam: Any = SimpleNamespace(
        map=SimpleNamespace(nodes=nodes), memory=memory, config=RatSlamConfig(ambiguous=3)
    )
    loop = LoopCheck(True, error_m, 0.0, 1.0, 1.0, "agrees with others")
    action = Action(EDGE, 4, 0, 0.0)
    assert RatSlam._check_ambiguity(slam, action, loop).accepted is accepted
