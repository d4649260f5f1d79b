# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which loops the experience map believes, and what that prevents."""

from typing import Any

import numpy as np
import pytest

from drives import NODES_A_LAP, drive, drive_by_odometry, laps, right
from fusionslam.ratslam import Action, ActionKind, ExperienceMap
from rows import rows

EDGE = ActionKind.CREATE_EDGE
CERTAIN = {
    "drift_m": 0.01,
    "drift_turn": 0.005,
    "drift_heading": 0.003,
    "place_m": 0.1,
    "place_rad": 0.05,
}
"""More than odometry is here."""


def once_wrong(number: int, nodes: Any, place: Any) -> Any:
    return nodes[10] if number == NODES_A_LAP + 45 else right(number, nodes, place)


def always_ten(number: int, nodes: Any, place: Any) -> Any:
    return nodes.get(10)


def random_claims(seed: int) -> Any:
    """A false loop on every frame, to any node."""
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
        drive(ExperienceMap(preset=preset), laps(2), random_claims(seed) if seed else always_ten)
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
