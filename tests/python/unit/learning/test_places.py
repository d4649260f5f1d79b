# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which sights are the same place, pairs of them, and what scores of pairs are worth."""

import numpy as np
import pytest

from fusionslam.errors import DataError, FusionSlamError, ShapeError
from fusionslam.learning.places import (
    PairConfig,
    Places,
    SamePlaceConfig,
    make_pairs,
    measure_gaps,
    same_places,
    split_places,
)
from fusionslam.sensors.frame import Cloud
from fusionslam.views.second_stage.scores import area_under_curve, calibrate, probability_of
from learning import cloud, line, worlds
from refusals import refuses
from rows import rows


def test_a_place_is_the_same_within_half_a_metre_and_36_degrees() -> None:
    deg = np.pi / 180
    seen = line(
        (0, 0, 0), (0.49, 0, 0), (0.51, 0, 0), (0, 0, 35 * deg), (0, 0, 37 * deg), (0.3, 0.3, 0)
    )
    same, doubtful = same_places(Places.of([("w", *seen)]), np.zeros(6, int), np.arange(6))
    assert same.tolist() == [True, True, False, True, False, True]
    assert doubtful.tolist() == [False, False, True, False, True, False]


def test_headings_are_compared_around_the_circle() -> None:
    _, angle = measure_gaps(np.array([0, 0, np.pi - 0.1]), np.array([0, 0, -np.pi + 0.1]))
    assert angle == pytest.approx(0.2)
    _, angle = measure_gaps(np.array([0, 0, 7 * np.pi]), np.array([0, 0, 0]))
    assert angle == pytest.approx(np.pi)


def test_equal_poses_in_other_worlds_are_other_places() -> None:
    clouds, poses = line((0, 0, 0))
    places = Places.of([("a", clouds, poses), ("b", clouds, poses)])
    same, doubtful = same_places(places, np.array([0]), np.array([1]))
    assert not same[0] and not doubtful[0]


def test_limits_of_a_place_are_configuration() -> None:
    places = Places.of([("w", *line((0, 0, 0), (0.8, 0, 0)))])
    same, _ = same_places(places, np.array([0]), np.array([1]), SamePlaceConfig(radius_m=0.9))
    assert same[0]


def test_sights_come_back_as_they_were_given() -> None:
    places = worlds(2)
    part = places.subset(np.array([5, 40]))
    for row, index in enumerate((5, 40)):
        np.testing.assert_array_equal(part[row].points, places[index].points)
        np.testing.assert_array_equal(part[row].colors, places[index].colors)
    assert part.worlds.tolist() == [0, 1] and part.names == ("w0", "w1")


def test_sights_with_few_points_are_left_out() -> None:
    clouds = [cloud(n, n) for n in (3, 10, 9)]
    places = Places.of([("w", clouds, np.arange(9.0).reshape(3, 3))], least=9)
    assert len(places) == 2
    np.testing.assert_array_equal(places.poses[:, 0], [3, 6])


@rows(
    "clouds, poses, error, code",
    [
        ([cloud(5, 0)], None, DataError, "no-poses"),
        ([cloud(5, 0)], np.zeros((2, 3)), ShapeError, "shape"),
        ([Cloud(cloud(5, 0).points)], np.zeros((1, 3)), DataError, "no-colors"),
        ([], np.zeros((0, 3)), DataError, "data"),
    ],
)
def test_worlds_that_cannot_be_learned_from_are_refused(
    clouds: list[Cloud], poses: np.ndarray | None, error: type[FusionSlamError], code: str
) -> None:
    with refuses(code, error=error):
        Places.of([("hall", clouds, poses)])


def test_the_held_out_part_of_a_world_lies_apart() -> None:
    places = worlds(2)
    train, test = split_places(places, 0.34)
    assert len(train) + len(test) == len(places)
    for number in range(2):
        near, far = (part.poses[part.worlds == number, 0] for part in (train, test))
        assert len(far) and near.max() < far.min() - 2


def test_pairs_are_labelled_within_their_world_and_repeat_with_their_seed() -> None:
    places, config = worlds(2), PairConfig(most=20, unlike=2)
    pairs, again = (make_pairs(places, config, np.random.default_rng(1)) for _ in range(2))
    assert pairs.same.sum() == 20 and (~pairs.same).sum() == 40
    same, _ = same_places(places, pairs.first, pairs.second)
    np.testing.assert_array_equal(same, pairs.same)
    np.testing.assert_array_equal(places.worlds[pairs.first], places.worlds[pairs.second])
    np.testing.assert_array_equal(again.first, pairs.first)
    distance, _ = measure_gaps(places.poses[pairs.first], places.poses[pairs.second])
    # Half of the others are the near ones, which are hard to tell.
    assert (distance[~pairs.same] < config.near_m).sum() >= 20


def test_pairs_need_places_seen_twice() -> None:
    places = Places.of([("w", *line((0, 0, 0), (5, 0, 0), (10, 0, 0)))])
    with refuses("no-pairs"):
        make_pairs(places, PairConfig(), np.random.default_rng(0))


def test_the_area_under_the_curve_counts_pairs_in_the_right_order() -> None:
    rng = np.random.default_rng(0)
    scores, same = rng.integers(0, 5, 60) / 4, rng.random(60) < 0.4
    gap = scores[same][:, None] - scores[~same][None, :]
    assert area_under_curve(scores, same) == pytest.approx(((gap > 0) + 0.5 * (gap == 0)).mean())
    assert area_under_curve([1, 2, 3], [False, True, True]) == 1.0
    with refuses("no-pairs"):
        area_under_curve([1, 2], [True, True])


def test_calibrated_distances_mean_probabilities() -> None:
    rng = np.random.default_rng(0)
    same = rng.random(6_000) < 0.2
    distances = np.where(same, rng.normal(0.4, 0.1, 6_000), rng.normal(0.8, 0.1, 6_000))
    offset, slope = calibrate(distances, same)
    # Normal distributions of equal width: the exact log odds are a line, 24 - 40 d.
    assert slope == pytest.approx(40, rel=0.08) and offset == pytest.approx(24, rel=0.08)
    chance = probability_of([0.0, 0.6, 2.0], offset, slope)
    assert chance[0] > 0.999 and abs(chance[1] - 0.5) < 0.1 and chance[2] < 0.001


def test_distances_that_never_overlap_still_have_a_finite_slope() -> None:
    offset, slope = calibrate([0.1, 0.2, 0.9, 1.0], [True, True, False, False])
    assert np.isfinite([offset, slope]).all() and slope > 0
    assert np.isfinite(probability_of([1e6, -1e6], offset, slope)).all()
