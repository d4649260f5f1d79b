# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stored views are weighed by odometry: look-alike places are told apart, lost robots found."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.errors import ConfigError, ShapeError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.pipelines.views import run_views
from fusionslam.views.match import NO_VIEW, ViewMatch
from fusionslam.views.matcher import ViewMatcher
from refusals import refuses
from rows import rows
from scenes import APART, LOOKS, NOTHING, THERE_AND_BACK, matcher, place
from scenes import drive as scene_drive


def at(x: float, y: float = 0.0, heading: float = 0.0) -> Matrix:
    return np.asarray(ground_poses(np.array([x]), np.array([y]), np.array([heading]))[0])


def drive(
    one: ViewMatcher, places: Iterable[int], start: Matrix | None = None, scale: float = 1.0
) -> list[ViewMatch]:
    """Visit places of the corridor, with odometry from anywhere that is too long."""
    first = np.eye(4) if start is None else start
    return [one.process(place(LOOKS[k]), odometry=first @ at(scale * APART * k)) for k in places]


def ids(matches: list[ViewMatch]) -> list[int]:
    return [match.id for match in matches]


@rows("start, scale", [(at(100.0, -7.0, 2.5), 1.0), (at(0.0), 1.02), (at(0.0, 0.0, -3.1), 1.02)])
def test_only_relative_motion_counts(start: Matrix, scale: float) -> None:
    assert ids(drive(ViewMatcher(), THERE_AND_BACK, start, scale)) == list(THERE_AND_BACK)


def test_a_match_says_what_was_considered_and_how_probable_it_is() -> None:
    matches = drive(ViewMatcher(), THERE_AND_BACK)
    again = matches[7]
    assert again.id == 5 and again.similarity > 0.96
    assert again.candidates[0] == (5, pytest.approx(again.similarity, abs=1e-3))
    # The other place that looks like it is too far away.
    assert dict(again.candidates)[2] < 1e-6
    assert matches[4].is_new and matches[4].similarity > 0.9


def corridor(count: int, **values: Any) -> ViewMatcher:
    """A matcher after places that all look different, a metre apart."""
    one = matcher(**values)
    for k in range(count):
        one.process(place(k), odometry=at(float(k)))
    return one


def test_a_lost_robot_is_doubtful_until_it_is_found_and_then_says_where_it_was() -> None:
    one = corridor(20)
    # Odometry begins anew at its origin, where the robot sees what it saw at the sixth place.
    one.process(place(5))
    found = [one.process(place(5 + k), odometry=at(float(k))) for k in range(12)]
    first = next(k for k, match in enumerate(found) if match.id != NO_VIEW)
    assert 2 <= first <= 8 and all(match.is_ambiguous for match in found[:first])
    assert ids(found[first:]) == list(range(5 + first, 17))
    # The scans before it are answered now: scan 21 was the first after the loss.
    revised = {scan: id for match in found for scan, id in match.revised}
    assert {21 + k: 5 + k for k in range(1, first)}.items() <= revised.items()
    assert one.stats.revised == sum(len(match.revised) for match in found)
    # And goes on from there.
    assert one.process(place(15), odometry=at(10.0)).id == 15


def test_a_robot_that_stands_still_is_not_found() -> None:
    one = corridor(12)
    found = [one.process(place(5), odometry=at(500.0)) for _ in range(20)]
    assert all(match.is_ambiguous for match in found)


def test_a_robot_at_a_known_place_that_the_scan_does_not_show_is_there() -> None:
    one = corridor(6)
    # Somebody stands before the scanner, where the robot stood a moment ago.
    assert one.process(place(5), odometry=at(5.0)).id == 5
    hidden = one.process(place(30), odometry=at(5.0))
    assert (hidden.id, hidden.by_odometry, hidden.stored) == (5, True, False)
    assert one.stats.by_odometry == 1


def test_odometry_that_is_too_long_is_corrected() -> None:
    one = ViewMatcher()
    for k in range(20):
        cloud = place(k)
        for ahead in (0.0, 0.25, 0.5):
            seen = replace(cloud, points=cloud.points - np.float32([ahead, 0, 0]))
            one.process(seen, odometry=at(1.05 * (k + ahead)))
    assert one.odometry_factors[0] == pytest.approx(1 / 1.05, abs=0.015)


def test_without_odometry_the_robot_may_have_moved() -> None:
    one = corridor(5)
    for k in (5, 6):
        one.process(place(k))
    one.process(place(7), odometry=at(7.0))
    # Nothing is known of the way between the fifth place and the eighth.
    assert [one.process(place(k), odometry=at(float(k))).id for k in (8, 9)] == [8, 9]
    assert one.process(place(8), odometry=at(8.0)).id == 8


def test_a_lost_robot_is_not_sure_of_a_place_that_looks_like_another() -> None:
    one = ViewMatcher()
    drive(one, range(6))  # the second and the fifth look alike
    lost = one.process(place(LOOKS[4]))
    assert lost.is_ambiguous and {id for id, share in lost.candidates if share > 0.3} == {1, 4}
    assert lost.guess in (1, 4) and one.process(place(30)).guess is None


def test_odometry_that_jumps_is_no_reason_for_a_wrong_place() -> None:
    one = corridor(6)
    assert one.process(place(2), odometry=at(500.0)).is_ambiguous
    assert one.process(NOTHING, odometry=at(500.5)).id == NO_VIEW


def test_a_matcher_that_is_stored_goes_on_the_same(tmp_path: Path) -> None:
    expected = drive(ViewMatcher(), THERE_AND_BACK)
    one, found = ViewMatcher(), list[ViewMatch]()
    for k in THERE_AND_BACK:
        found += drive(one, [k])
        one.save(tmp_path / "views.npz")
        one = ViewMatcher.load(tmp_path / "views.npz")
    assert found == expected


def test_views_that_are_dropped_are_forgotten_by_the_filter_too() -> None:
    one = corridor(9, max_views=4)
    assert len(one) == 4 and one.process(place(8), odometry=at(8.0)).id == 8


def test_candidates_are_places_of_which_several_views_may_be_stored() -> None:
    one = matcher(policy="several", store_below=1.0)
    for visit in range(4):
        match = one.process(place(0, visit), odometry=at(0.1 * visit))
    assert len(one) > 1 and [id for id, _ in match.candidates] == [0]


def test_a_scene_set_needs_a_pose_a_scan() -> None:
    with pytest.raises(ShapeError, match="odometry"):
        run_views(scene_drive((0, 1, 2)), ViewMatcher(), odometry=np.stack([np.eye(4)] * 2))


@rows(
    "pose, said",
    [(np.diag([2.0, 1.0, 1.0, 1.0]), "no rotation"), (np.full((4, 4), np.nan), "not finite")],
)
def test_odometry_that_is_no_motion_counts_as_none(pose: Floats, said: str) -> None:
    one = corridor(3)
    match = one.process(place(7), odometry=pose)
    assert said in match.reason and "may be anywhere" in match.reason and len(one) == 4
    before = one.stats
    with pytest.raises(ShapeError, match="odometry"):
        one.process(place(0), odometry=np.eye(3))
    assert one.stats == before


def test_odometry_needs_alignment_from_the_first_scan_on() -> None:
    started = ViewMatcher()
    started.process(place(0))
    for one in (started, matcher(method="objects")):
        with refuses("no-filter", error=ConfigError):
            one.process(place(1), odometry=np.eye(4))


def test_a_robot_that_is_lost_twice_finds_the_part_in_between() -> None:
    one = corridor(4)
    elsewhere = [one.process(place(k), odometry=at(1000.0 + k)).id for k in range(10, 14)]
    assert elsewhere == [4, 5, 6, 7]
    there_and_back = [*range(10, 14), *range(12, 9, -1), *range(11, 14)]
    found = [one.process(place(k), odometry=at(2000.0 + k)).id for k in there_and_back]
    assert found[-3:] == [5, 6, 7] and len(one) == 8


def test_candidates_are_named_by_their_place_though_a_view_is_dropped() -> None:
    one = matcher(max_views=2)
    for k in range(5):
        match = one.process(place(k), odometry=at(float(k)))
        assert all(id < match.id for id, _ in match.candidates)
