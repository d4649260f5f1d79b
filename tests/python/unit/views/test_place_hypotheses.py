# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Hypotheses of where the robot is are weighed by driving: the right one is confirmed again."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.views.place_hypotheses import NO_NODE, Evidence, PlaceHypotheses
from rows import rows

LOST = Evidence(NO_NODE, NO_NODE, True)
NEW = Evidence(NO_NODE, NO_NODE, False)
"""Nothing is stored where the filter has the robot."""
PRIOR, LEAST = 0.05, 0.95
NODE = 50
"""Node that is made next; those before are old."""
OLD, SINCE = 3, NODE + 3
CONFIRMED, MISSED = Evidence(OLD, OLD, False), Evidence(NO_NODE, OLD, False)
"""Old views are where the filter has the robot, and the scan shows them or does not."""

RIGHT, WRONG = (0.0, 0.0, 0.0), (100.0, 40.0, 0.0)
"""Where the robot starts, and where it looks alike."""
UP, DOWN = 0.85 * 3, 0.15 * 3 / 2
"""Factors on the odds. A scan confirms the right place in 85 % of cases, and before anything is
learned a wrong one in one of three."""

STORED = np.array([(x + k, y, 0.0) for x, y, _ in (RIGHT, WRONG) for k in range(60)])
"""Views a metre apart along the robot's way, and along the wrong one."""


class Drive:
    """A robot that goes a metre along x between scans."""

    def __init__(self, hypotheses: PlaceHypotheses | None = None) -> None:
        self.hypotheses = PlaceHypotheses() if hypotheses is None else hypotheses
        self.way = 0

    def scan(
        self,
        *starts: tuple[float, float, float],
        evidence: Evidence = LOST,
        moved: bool = True,
        probability: float = 0.9,
        views: Floats = STORED,
        node: int = NODE,
    ) -> int | None:
        """Look at places that the scan resembles, given by where the robot started there."""
        if moved:
            self.hypotheses.move((1.0, 0.0, 0.0))
            self.way += 1
        claims = np.array([(x + self.way, y, t) for x, y, t in starts]).reshape(-1, 3)
        probabilities = np.full(len(claims), probability)
        self.hypotheses.weigh(claims, probabilities, views, evidence, node, PRIOR)
        return self.hypotheses.find(LEAST)

    def start(self, *starts: tuple[float, float, float]) -> "Drive":
        assert self.scan(*starts, moved=False) is None
        return self

    def scans_until_found(
        self, *starts: tuple[float, float, float], evidence: Evidence = LOST
    ) -> int:
        """Number of scans after the first that it takes; 50 if it is not found."""
        self.start(*starts)
        for number in range(1, 50):
            if self.scan(*starts, evidence=evidence) is not None:
                return number
        return 50


def shares_of(*odds: float) -> Any:
    return pytest.approx([one / (1 + sum(odds)) for one in odds])


def test_a_hypothesis_that_every_scan_confirms_wins_over_one_confirmed_once() -> None:
    drive = Drive().start(RIGHT, WRONG)
    found = [drive.scan(RIGHT) for _ in range(8)]
    first = next(k for k, number in enumerate(found) if number is not None)
    number = found[first]
    assert number is not None and 2 <= first <= 6
    pose = drive.hypotheses.pose(number)
    assert pose.tolist() == pytest.approx([drive.way, 0.0, 0.0])
    assert drive.hypotheses.first_node(number) == NODE
    # The other one was given up.
    assert len(drive.hypotheses) == 1


def test_odds_follow_from_how_often_scans_confirm_the_right_and_a_wrong_place() -> None:
    drive = Drive().start(RIGHT, WRONG)
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR, PRIOR)
    drive.scan(RIGHT)
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR * UP, PRIOR * DOWN)
    drive.scan(RIGHT, WRONG)
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR * UP**2, PRIOR * DOWN * UP)
    # It is found by the first scan after which it has this probability.
    needed = np.log(LEAST / (1 - LEAST) / PRIOR) / np.log(UP)
    assert Drive().scans_until_found(RIGHT) == int(np.ceil(needed))


def test_where_no_view_is_stored_a_hypothesis_need_not_be_confirmed() -> None:
    drive = Drive().start(RIGHT)
    for _ in range(5):
        drive.scan(views=STORED[60:])
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR)
    drive.scan(views=STORED)
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR * DOWN)
    # Again and again, it is given up.
    for _ in range(10):
        drive.scan(views=STORED)
    assert len(drive.hypotheses) == 0


def test_two_hypotheses_that_are_confirmed_equally_never_win() -> None:
    drive = Drive()
    assert drive.scans_until_found(RIGHT, WRONG) == 50
    assert drive.hypotheses.shares == pytest.approx(0.5, abs=1e-6)
    # Once only one of them is confirmed, it does.
    found = [drive.scan(WRONG) for _ in range(4)]
    assert found[0] is None and found[-1] is not None
    assert drive.hypotheses.pose(found[-1])[1] == WRONG[1]


def test_hypotheses_that_meet_become_one_and_do_not_count_twice() -> None:
    behind, ahead = (-0.4, 0.0, 0.0), (0.4, 0.0, 0.0)
    both, one = Drive().start(behind, ahead), Drive().start(behind)
    for _ in range(6):
        both.scan(RIGHT)
        one.scan(RIGHT)
    assert both.hypotheses.shares.tolist() == one.hypotheses.shares.tolist()


def test_a_hypothesis_must_be_confirmed_three_times_however_probable_it_is() -> None:
    hypotheses = PlaceHypotheses()
    claim, views = np.array([RIGHT]), np.array([RIGHT])
    found = []
    for _ in range(4):
        hypotheses.weigh(claim, np.array([0.9]), views, LOST, NODE, 1e4)
        found.append(hypotheses.find(LEAST))
        hypotheses.move((0.0, 0.0, 0.6))
        claim += (0.0, 0.0, 0.6)
        views = claim.copy()
    assert found == [None, None, 0, 0]


@rows("motion", [(0.0, 0.0, 0.0), (0.004, 0.003, 0.0), (0.0, 0.0, -0.005)])
def test_standing_still_is_no_evidence(motion: tuple[float, float, float]) -> None:
    drive = Drive().start(RIGHT, WRONG)
    for _ in range(50):
        drive.hypotheses.move(motion)
        assert drive.scan(RIGHT, moved=False) is None
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR, PRIOR)


def test_many_small_steps_are_as_much_evidence_as_one_large_one() -> None:
    drive = Drive().start(RIGHT)
    for step in range(1, 9):
        drive.hypotheses.move((0.125, 0.0, 0.0))
        claim = np.array([(0.125 * step, 0.0, 0.0)])
        drive.hypotheses.weigh(claim, np.array([0.9]), STORED, LOST, NODE, PRIOR)
        assert drive.hypotheses.shares.tolist() == shares_of(PRIOR * UP ** (step // 4))


def test_hypotheses_move_with_odometry_and_are_set_right_by_views() -> None:
    hypotheses = PlaceHypotheses()
    start = np.array([(1.0, 2.0, np.pi / 2)])
    hypotheses.weigh(start, np.array([0.9]), start, LOST, NODE, PRIOR)
    hypotheses.move((3.0, 1.0, -0.5))
    assert hypotheses.pose(0).tolist() == pytest.approx([0.0, 5.0, np.pi / 2 - 0.5])
    seen = np.array([(0.3, 5.2, 1.0), (0.2, 4.9, 1.0), (40.0, 0.0, 0.0)])
    hypotheses.weigh(seen, np.array([0.9, 0.8, 0.3]), seen, LOST, NODE, PRIOR)
    assert len(hypotheses) == 1 and hypotheses.pose(0).tolist() == seen[1].tolist()


def test_improbable_alignments_begin_and_confirm_nothing() -> None:
    drive = Drive()
    drive.scan(RIGHT, moved=False, probability=0.4)
    assert len(drive.hypotheses) == 0 and drive.hypotheses.find(LEAST) is None
    drive.start(RIGHT)
    drive.scan(RIGHT, probability=0.4)
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR * DOWN)


@rows("evidence", [NEW, Evidence(SINCE, SINCE, False), Evidence(NO_NODE, SINCE, False)])
def test_nothing_and_views_stored_since_are_no_evidence(evidence: Evidence) -> None:
    drive = Drive()
    assert drive.scans_until_found(RIGHT, evidence=evidence) == 50
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR)


def test_where_old_views_are_missed_a_hypothesis_that_is_confirmed_wins() -> None:
    drive = Drive().start(RIGHT)
    drive.scan(RIGHT, evidence=MISSED)
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR * UP / DOWN)
    needed = np.log(LEAST / (1 - LEAST) / PRIOR) / np.log(UP / DOWN)
    fewest = max(2, int(np.ceil(needed)))
    assert Drive().scans_until_found(RIGHT, evidence=MISSED) == fewest


def test_where_old_views_confirm_the_filter_a_look_alike_never_wins() -> None:
    drive = Drive()
    assert drive.scans_until_found(RIGHT, evidence=CONFIRMED) == 50
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR)
    drive.scan(evidence=CONFIRMED)
    # A scan that confirms the filter alone speaks against it.
    assert (drive.hypotheses.shares < PRIOR / (1 + PRIOR)).all()


def drive_views(drive: Drive) -> Floats:
    """Views where the hypothesis is now and will be."""
    return np.array([(drive.way + float(k), 0.0, 0.0) for k in range(3)])


def learned(hits: int, misses: int) -> PlaceHypotheses:
    """After as many scans that confirm, or do not, a hypothesis that is wrong: old views confirm
    the filter meanwhile."""
    drive = Drive().start(RIGHT)
    drive.scan(RIGHT)  # confirmed twice, so that it may count
    for _ in range(hits):
        drive.scan(RIGHT, evidence=CONFIRMED, views=drive_views(drive))
    for _ in range(misses):
        # Begun anew before it is given up.
        if not len(drive.hypotheses) or drive.hypotheses.shares[0] < PRIOR:
            drive.hypotheses.clear()
            drive.scan(RIGHT, moved=False, views=drive_views(drive))
            drive.scan(RIGHT, views=drive_views(drive))
        drive.scan(evidence=CONFIRMED, views=drive_views(drive))
    drive.hypotheses.clear()
    return drive.hypotheses


def test_the_more_places_look_alike_the_longer_it_takes() -> None:
    lengths = [Drive(learned(hits, 0)).scans_until_found(RIGHT) for hits in (0, 4, 30)]
    assert lengths[0] < lengths[1] < lengths[2]


@rows(
    "hits, misses, factor",
    [
        # Of three scans one confirmed a wrong one before; of seven five do after four more.
        (4, 0, 0.85 * 7 / 5),
        # Never so many that being confirmed says nothing.
        (50, 0, 0.85 / 0.8),
        (0, 7, 0.85 * 10),
    ],
)
def test_a_scan_counts_by_how_many_places_look_alike(hits: int, misses: int, factor: float) -> None:
    drive = Drive(learned(hits, misses)).start(RIGHT)
    drive.scan(RIGHT)
    assert drive.hypotheses.shares.tolist() == shares_of(PRIOR * factor)


def test_the_fewer_places_look_alike_the_sooner_it_is_found() -> None:
    assert Drive(learned(0, 7)).scans_until_found(RIGHT) < Drive().scans_until_found(RIGHT)


def test_of_a_lost_robot_nothing_is_learned() -> None:
    drive = Drive()
    drive.scans_until_found(RIGHT, WRONG)
    drive.hypotheses.clear()
    assert len(drive.hypotheses) == 0 and drive.hypotheses.shares.size == 0
    assert Drive(drive.hypotheses).scans_until_found(RIGHT) == Drive().scans_until_found(RIGHT)


def test_no_more_than_a_hundred_are_kept_the_most_probable_ones() -> None:
    drive = Drive().start(RIGHT)
    drive.scan(RIGHT)
    starts = [(float(x), 200.0, 0.0) for x in range(150)]
    drive.scan(RIGHT, *starts)
    assert len(drive.hypotheses) == 100
    assert drive.hypotheses.shares.argmax() == 0
    assert drive.hypotheses.pose(0).tolist() == pytest.approx([drive.way, 0.0, 0.0])


SCANS: Sequence[tuple[tuple[float, float, float], ...]] = [
    (RIGHT, WRONG), (RIGHT,), (WRONG,), (), (RIGHT, WRONG), (RIGHT,), (RIGHT,), (RIGHT,)
]  # fmt: skip
SEEN = [LOST, LOST, CONFIRMED, NEW, MISSED, LOST, LOST, NEW]


def arrays_of(hypotheses: PlaceHypotheses) -> dict[str, tuple[Any, ...]]:
    """Everything of the state, to be compared bit for bit."""
    return {
        name: (rows.dtype, rows.shape, rows.tobytes()) for name, rows in hypotheses.state().items()
    }


def test_hypotheses_that_are_restored_go_on_the_same() -> None:
    whole, parts = Drive(), Drive()
    for scan, evidence in zip(SCANS, SEEN, strict=True):
        found = whole.scan(*scan, evidence=evidence)
        assert parts.scan(*scan, evidence=evidence) == found
        again = PlaceHypotheses()
        again.restore(parts.hypotheses.state())
        assert arrays_of(again) == arrays_of(whole.hypotheses)
        parts.hypotheses = again


def test_a_state_shares_no_array_with_hypotheses_that_go_on() -> None:
    drive = Drive().start(RIGHT)
    drive.scan(RIGHT, evidence=NEW)
    state = drive.hypotheses.state()
    before = {name: array.tobytes() for name, array in state.items()}
    for restored in (False, True):
        if restored:
            drive.hypotheses.restore(state)
        for _ in range(3):
            drive.scan(RIGHT, evidence=CONFIRMED)
        assert {name: array.tobytes() for name, array in state.items()} == before


@rows(
    "name, values",
    [
        ("poses", [np.zeros((1, 3)), np.zeros((2, 2)), np.zeros((2, 3), np.float32)]),
        ("poses", [np.full((2, 3), np.nan)]),
        ("logs", [np.zeros(1), np.zeros((2, 1)), np.zeros(2, np.int64), np.array([0.0, np.inf])]),
        ("counts", [np.ones((1, 2), np.int64), np.ones((2, 3), np.int64), np.ones((2, 2))]),
        ("counts", [np.array([[1, 1], [0, 1]]), np.array([[1, 1], [1, 0]])]),
        ("wrong", [np.ones(3), np.ones(2, np.int64)]),
        ("wrong", [np.array([0.0, 1.0]), np.array([1.0, -1.0]), np.array([1.0, np.nan])]),
        ("since", [np.zeros(1), np.array(np.nan), np.array(0)]),
    ],
)
def test_an_invalid_state_is_refused_and_changes_nothing(name: str, values: list[Any]) -> None:
    drive = Drive().start(RIGHT, WRONG)
    before = arrays_of(drive.hypotheses)
    for value in values:
        with pytest.raises(DataError):
            drive.hypotheses.restore(drive.hypotheses.state() | {name: value})
        assert arrays_of(drive.hypotheses) == before, value
