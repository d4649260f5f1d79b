# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recognised views calibrate odometry: factors of distances and turns, and how sure they are."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

from drives import same, unchanged
from fusionslam.errors import DataError
from fusionslam.geometry.odometry_calibration import Factors, OdometryCalibration
from rows import rows
from worlds import seen_from

Pose = tuple[float, float, float]

DRIFT = {"drift_turn": 0.01, "drift_heading": 0.005}
SD_M, SD_RAD = 0.01, 0.005
"""Of the measured poses."""
NEAR, FAR = 4, 40
"""Steps of half a metre since the view that is recognised: 2 m, and about six radians of turns."""
PRIOR = 0.03
"""Standard deviation of the factors of a robot that nobody has calibrated."""
STEP = 0.002
"""Smaller changes of a factor are not applied."""


class Leg(NamedTuple):
    """A step of the robot: a turn, then half a metre. The pose after it is true."""

    way: float
    turn: float
    pose: Pose


def course(count: int, seed: int = 0) -> Iterator[Leg]:
    """Random turns, more of them to the left."""
    random = np.random.default_rng([41, seed])
    x = y = heading = 0.0
    for turn in random.normal(0.15, 0.15, count).tolist():
        heading += turn
        x, y = x + 0.5 * math.cos(heading), y + 0.5 * math.sin(heading)
        yield Leg(0.5, turn, (x, y, heading))


class Robot:
    """A robot whose odometry is too long by known factors. It stores a view a step, and recognises
    one that is near on even steps, and one of the last lap on odd ones."""

    def __init__(self, way: float, turn: float, noise: float = 1.0, seed: int = 0) -> None:
        self.scales, self.noise = (way, turn), noise
        self.random = np.random.default_rng([43, seed])
        self.calibration = OdometryCalibration(**DRIFT)
        self.poses: list[Pose] = []
        self.changes: list[Factors] = []
        self.deviations: list[Factors] = []

    def drive(self, legs: Iterator[Leg], wrong: float = 0.0) -> OdometryCalibration:
        """Go on, with this share of grossly wrong poses."""
        for leg in legs:
            self.calibration.move(leg.way * self.scales[0], leg.turn * self.scales[1])
            since = FAR if len(self.poses) % 2 else NEAR
            if len(self.poses) >= since:
                self.observe(len(self.poses) - since, leg.pose, wrong)
            self.calibration.store()
            self.poses.append(leg.pose)
            self.deviations.append(self.calibration.deviations)
        return self.calibration

    def observe(self, number: int, pose: Pose, wrong: float) -> None:
        x, y, turn = seen_from(self.poses[number], pose)
        measured = np.array([x, y, math.atan2(math.sin(turn), math.cos(turn))])
        measured += self.noise * self.random.normal(0, (SD_M, SD_M, SD_RAD))
        if self.random.random() < wrong:
            measured += self.random.choice([-1, 1], 3) * (2.0, 2.0, 2.0)
        changed = self.calibration.observe([(number, tuple(measured.tolist()))])
        if changed is not None:
            self.changes.append(changed)


def bounds(count: int, scales: tuple[float, float]) -> tuple[float, float]:
    """How far the factors may be off after so many steps: four standard deviations of a mean, what
    the prior of 1 still counts, and changes that are not applied.

    Distances: 2 m each second step. Their curves are bent by the error of turns, which shortens
    the chord by the mean square of the headings on the way. Turns: six radians each second step.
    """
    pairs = (count - FAR) / 2
    error = max(abs(1 / scale - 1) for scale in scales)
    far, bent = FAR * 0.15, (NEAR * 0.15) ** 2 / 12 + NEAR * 0.15**2 / 6
    way = 4 * SD_M / (2.0 * math.sqrt(pairs)) + error * bent
    turn = 4 * SD_RAD / (far * math.sqrt(pairs))
    # Counted are a quarter of each near pose, measured to 2 cm, and an eightieth of each far one.
    prior = PRIOR**-2 / (pairs * 2.0**2 / 4 / 0.02**2)
    drift = SD_RAD**2 + DRIFT["drift_turn"] ** 2 * 2 * far + DRIFT["drift_heading"] ** 2 * 20
    prior_turn = PRIOR**-2 / (pairs * far**2 / 40 / drift)
    return way + error * prior + STEP, turn + error * prior_turn + STEP


@rows("seed, scales", [(0, (0.95, 1.05)), (1, (1.04, 0.97))])
def test_factors_become_the_inverse_of_how_much_too_long_odometry_is(
    seed: int, scales: tuple[float, float]
) -> None:
    robot = Robot(*scales, seed=seed)
    factors = robot.drive(course(500, seed)).factors
    way, turn = bounds(500, scales)
    assert max(way, turn) < 0.006
    assert factors.way == pytest.approx(1 / scales[0], abs=way)
    assert factors.turn == pytest.approx(1 / scales[1], abs=turn)


def test_what_is_returned_are_the_changes_of_the_factors() -> None:
    robot = Robot(0.95, 1.05)
    factors = robot.drive(course(300)).factors
    assert robot.changes
    assert np.prod(np.array(robot.changes), axis=0) == pytest.approx(np.array(factors))
    assert all(max(abs(way - 1), abs(turn - 1)) >= STEP for way, turn in robot.changes)


def test_perfect_odometry_is_left_exactly_as_it_is() -> None:
    robot = Robot(1.0, 1.0, noise=0.0)
    assert robot.drive(course(300)).factors == Factors(1.0, 1.0) and robot.changes == []


def test_noise_alone_changes_perfect_odometry_by_no_more_than_it_explains() -> None:
    for seed in range(3):
        factors = Robot(1.0, 1.0, seed=seed).drive(course(500, seed)).factors
        way, turn = bounds(500, (1.0, 1.0))
        assert abs(factors.way - 1) <= way and abs(factors.turn - 1) <= turn


def test_driving_backwards_tells_as_much_as_driving_ahead() -> None:
    calibration = OdometryCalibration(**DRIFT)
    for step in range(100):
        calibration.store()
        calibration.move(-1.03, 0.0)
        calibration.observe([(step, (-1.0, 0.0, 0.0))])
    assert calibration.factors.way == pytest.approx(1 / 1.03, abs=STEP)
    assert calibration.factors.turn == 1.0


def test_a_few_grossly_wrong_poses_change_little() -> None:
    scales = (1.02, 1.01)
    factors = Robot(*scales).drive(course(500), wrong=0.05).factors
    way, turn = bounds(475, scales)
    assert factors.way == pytest.approx(1 / scales[0], abs=way)
    assert factors.turn == pytest.approx(1 / scales[1], abs=turn)


def test_places_beside_a_wrong_view_change_nothing_though_headings_fit() -> None:
    calibration = OdometryCalibration(**DRIFT)
    for step in range(200):
        calibration.store()
        calibration.move(1.0, 0.0)
        # Corridors look the same a little farther on: always ahead, never behind.
        calibration.observe([(step, (1.4 if step % 10 == 9 else 1.0, 0.0, 0.0))])
    assert calibration.factors == Factors(1.0, 1.0)


def test_after_an_interruption_earlier_views_tell_nothing() -> None:
    robot = Robot(1.0, 1.0, noise=0.0)
    calibration = robot.drive(course(100))
    before = calibration.state()
    calibration.forget()
    robot.scales = (1.05, 1.05)
    for leg in course(50, seed=1):
        calibration.move(leg.way * 1.05, leg.turn * 1.05)
        for number in range(60, 100):
            assert calibration.observe([(number, (1.0, 0.0, 0.1))]) is None
    assert calibration.factors == Factors(1.0, 1.0)
    assert calibration.state()["sums"].tobytes() == before["sums"].tobytes()
    # Views that are stored now do, and what was learned before still counts.
    for step in range(30):
        calibration.store()
        calibration.move(1.05, 0.0)
        calibration.observe([(100 + step, (1.0, 0.0, 0.0))])
    assert 1 / 1.05 - STEP < calibration.factors.way < 0.99


def test_what_was_learned_stays_after_an_interruption() -> None:
    robot = Robot(1.02, 1.01)
    calibration = robot.drive(course(300))
    factors, deviations = calibration.factors, calibration.deviations
    calibration.forget()
    assert (calibration.factors, calibration.deviations) == (factors, deviations)
    assert len(calibration) == 300


def test_views_that_are_removed_move_later_ones_down() -> None:
    whole, fewer = OdometryCalibration(**DRIFT), OdometryCalibration(**DRIFT)
    for calibration in (whole, fewer):
        for way in (1.0, 2.0, 0.5):
            calibration.store()
            calibration.move(way, 0.1)
    fewer.remove(0)
    assert (len(whole), len(fewer)) == (3, 2)
    for _ in range(5):
        for calibration, number in ((whole, 2), (fewer, 1)):
            calibration.move(0.5, 0.0)
            calibration.observe([(number, (0.9, 0.02, 0.1))])
    assert whole.factors == fewer.factors and whole.deviations == fewer.deviations


def test_deviations_fall_as_it_learns_and_hold_the_true_error() -> None:
    robot = Robot(1.02, 1.01)
    calibration = robot.drive(course(500))
    found = np.array(robot.deviations)
    assert found[0].tolist() == pytest.approx([PRIOR, PRIOR])
    assert (np.diff(found, axis=0) <= 0).all() and (found[-1] < PRIOR / 10).all()
    errors = np.array(calibration.factors) - (1 / 1.02, 1 / 1.01)
    assert (np.abs(errors) < 3 * found[-1] + STEP).all()


def test_standing_still_tells_nothing_new() -> None:
    calibration = OdometryCalibration(**DRIFT)
    calibration.store()
    calibration.move(2.0, 0.3)
    calibration.observe([(0, (1.9, 0.6, 0.3))])
    once = calibration.deviations, calibration.factors
    for _ in range(50):
        assert calibration.observe([(0, (1.9, 0.6, 0.3))]) is None
    assert (calibration.deviations, calibration.factors) == once


def test_a_calibration_that_is_restored_goes_on_the_same() -> None:
    whole, again = Robot(0.97, 1.03), Robot(0.97, 1.03)
    legs = list(course(300))
    whole.drive(iter(legs))
    again.drive(iter(legs[:170]))
    again.calibration.forget()
    whole_after = again.calibration
    restored = OdometryCalibration(**DRIFT)
    restored.restore(whole_after.state(), len(whole_after))
    assert len(restored) == 170 and restored.factors == whole_after.factors
    assert restored.deviations == whole_after.deviations
    for calibration in (whole_after, restored):
        again.calibration, again.poses = calibration, again.poses[:170]
        again.random = np.random.default_rng(5)
        again.drive(iter(legs[170:]))
    assert same(whole_after.state(), restored.state())
    assert whole_after.factors == restored.factors


def test_a_state_does_not_change_as_the_calibration_goes_on() -> None:
    robot = Robot(1.02, 1.01)
    legs = list(course(200))
    state = robot.drive(iter(legs[:100])).state()
    before = {name: values.copy() for name, values in state.items()}
    restored = OdometryCalibration(**DRIFT)
    restored.restore(state, 100)
    robot.drive(iter(legs[100:]))
    restored.move(1.0, 0.1)
    restored.observe([(98, (1.4, 0.0, 0.2))])
    assert same(state, before)


@rows(
    "name, value",
    [
        *[("tracks", np.zeros(shape)) for shape in ((3, 5), (5, 5), (4, 4))],
        ("tracks", np.zeros((4, 5), np.float32)),
        ("tracks", np.full((4, 5), np.nan)),
        ("factors", np.ones(2, np.int64)),
        *[("factors", np.array(values)) for values in ([1.0] * 3, [1.0, np.nan], [0.0, -1.0])],
        ("factors", np.array([np.inf, 1.0])),
        *[("seen_way", value) for value in (np.zeros(1), np.array(np.nan), np.array(np.inf))],
        ("sums", np.zeros(4)),
        *[("sums", np.full((2, 2), value)) for value in (np.nan, -2000.0)],
    ],
)
def test_an_invalid_state_is_refused_and_changes_nothing(name: str, value: Any) -> None:
    calibration = OdometryCalibration(**DRIFT)
    for _ in range(3):
        calibration.store()
        calibration.move(1.0, 0.1)
    with unchanged(calibration), pytest.raises(DataError, match=f"{name}|0 or less"):
        calibration.restore(calibration.state() | {name: value}, 3)


@rows("scale", [1.03, 1.05])
def test_turns_over_many_laps_keep_the_factor(scale: float) -> None:
    calibration = OdometryCalibration(0.01, 0.005)
    for lap in range(30):
        for number in range(32):
            calibration.move(1.0, scale * math.tau / 32)
            if lap == 0:
                calibration.store()
            else:
                calibration.observe([(number, (0.0, 0.0, 0.0))])
    assert calibration.factors.turn == pytest.approx(1 / scale, abs=0.004)
