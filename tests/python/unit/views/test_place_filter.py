# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stored views are weighed by odometry: look-alike places are told apart, lost robots found."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import ConfigError, ShapeError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.pipelines.views import run_views
from fusionslam.storage.arrays import Floats, Matrix
from fusionslam.views.match import NO_VIEW, ViewMatch
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from rows import rows
from scenes import NOTHING, place
from scenes import drive as scene_drive

LOOKS = (0, 1, 2, 3, 1, 2, 4)
"""What the places along a corridor look like: two of them twice."""
APART = 4.0
"""Metres between places."""


def at(x: float, y: float = 0.0, heading: float = 0.0) -> Matrix:
    return np.asarray(ground_poses(np.array([x]), np.array([y]), np.array([heading]))[0])


def drive(
    matcher: ViewMatcher, places: Any, start: Matrix | None = None, scale: float = 1.0
) -> list[ViewMatch]:
    """Visit places of the corridor, with odometry from anywhere that is too long."""
    first = np.eye(4) if start is None else start
    return [
        matcher.process(place(LOOKS[k]), odometry=first @ at(scale * APART * k)) for k in places
    ]


def ids(matches: list[ViewMatch]) -> list[int]:
    return [match.id for match in matches]


THERE_AND_BACK = (0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0)


def test_places_that_look_alike_are_told_apart_by_odometry_and_not_without() -> None:
    assert ids(drive(ViewMatcher(), THERE_AND_BACK)) == list(THERE_AND_BACK)
    alone = ViewMatcher()
    found = [alone.process(place(LOOKS[k])).id for k in THERE_AND_BACK]
    assert found[4:6] == [1, 2]


@rows("scale", [1.0, 1.02])
@rows("start", [at(0.0), at(100.0, -7.0, 2.5), at(0.0, 0.0, -3.1)])
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


def corridor(matcher: ViewMatcher, count: int, **options: Any) -> list[ViewMatch]:
    """Places that all look different, a metre apart."""
    return [matcher.process(place(k), odometry=at(float(k)), **options) for k in range(count)]


def test_a_lost_robot_is_doubtful_until_it_is_found_and_then_says_where_it_was() -> None:
    matcher = ViewMatcher()
    corridor(matcher, 20)
    # Odometry begins anew at its origin, where the robot sees what it saw at the sixth place.
    matcher.process(place(5))
    found = [matcher.process(place(5 + k), odometry=at(float(k))) for k in range(12)]
    first = next(k for k, match in enumerate(found) if match.id != NO_VIEW)
    assert 2 <= first <= 8 and all(match.is_ambiguous for match in found[:first])
    assert [match.id for match in found[first:]] == list(range(5 + first, 17))
    # The scans before it are answered now: scan 21 was the first after the loss.
    revised = {scan: id for match in found for scan, id in match.revised}
    assert {21 + k: 5 + k for k in range(1, first)}.items() <= revised.items()
    assert matcher.stats.revised == sum(len(match.revised) for match in found)
    # And goes on from there.
    assert matcher.process(place(15), odometry=at(10.0)).id == 15


def test_a_robot_that_stands_still_is_not_found() -> None:
    matcher = ViewMatcher()
    corridor(matcher, 12)
    found = [matcher.process(place(5), odometry=at(500.0)) for _ in range(20)]
    assert all(match.is_ambiguous for match in found)


def test_a_robot_at_a_known_place_that_the_scan_does_not_show_is_there() -> None:
    matcher = ViewMatcher()
    corridor(matcher, 6)
    # Somebody stands before the scanner, where the robot stood a moment ago.
    assert matcher.process(place(5), odometry=at(5.0)).id == 5
    hidden = matcher.process(place(30), odometry=at(5.0))
    assert (hidden.id, hidden.by_odometry, hidden.stored) == (5, True, False)
    assert matcher.stats.by_odometry == 1


def test_odometry_that_is_too_long_is_corrected() -> None:
    matcher = ViewMatcher()
    for k in range(60):
        cloud = place(k)
        for ahead in (0.0, 0.25, 0.5):
            seen = replace(cloud, points=cloud.points - np.float32([ahead, 0, 0]))
            matcher.process(seen, odometry=at(1.05 * (k + ahead)))
    assert matcher.odometry_factors[0] == pytest.approx(1 / 1.05, abs=0.01)


def test_without_odometry_the_robot_may_have_moved() -> None:
    matcher = ViewMatcher()
    corridor(matcher, 5)
    for k in (5, 6):
        matcher.process(place(k))
    matcher.process(place(7), odometry=at(7.0))
    # Nothing is known of the way between the fifth place and the eighth.
    assert [matcher.process(place(k), odometry=at(float(k))).id for k in (8, 9)] == [8, 9]
    assert matcher.process(place(8), odometry=at(8.0)).id == 8


def test_a_lost_robot_is_not_sure_of_a_place_that_looks_like_another() -> None:
    matcher = ViewMatcher()
    drive(matcher, range(6))  # the second and the fifth look alike
    lost = matcher.process(place(LOOKS[4]))
    assert lost.is_ambiguous and {id for id, share in lost.candidates if share > 0.3} == {1, 4}


def test_odometry_that_jumps_is_no_reason_for_a_wrong_place() -> None:
    matcher = ViewMatcher()
    corridor(matcher, 6)
    assert matcher.process(place(2), odometry=at(500.0)).is_ambiguous
    assert matcher.process(NOTHING, odometry=at(500.5)).id == NO_VIEW


def test_a_matcher_that_is_stored_goes_on_the_same(tmp_path: Path) -> None:
    whole = ViewMatcher()
    expected = drive(whole, THERE_AND_BACK)
    matcher, found = ViewMatcher(), list[ViewMatch]()
    for k in THERE_AND_BACK:
        found += drive(matcher, [k])
        matcher.save(tmp_path / "views.npz")
        matcher = ViewMatcher.load(tmp_path / "views.npz")
    assert found == expected


def test_views_that_are_dropped_are_forgotten_by_the_filter_too() -> None:
    matcher = ViewMatcher(ViewMatcherConfig(max_views=4))
    corridor(matcher, 9)
    assert len(matcher) == 4 and matcher.process(place(8), odometry=at(8.0)).id == 8


def test_candidates_are_places_of_which_several_views_may_be_stored() -> None:
    matcher = ViewMatcher(ViewMatcherConfig(policy="several", store_below=1.0))
    for visit in range(4):
        match = matcher.process(place(0, visit), odometry=at(0.1 * visit))
    assert len(matcher) > 1 and [id for id, _ in match.candidates] == [0]


def test_a_scene_set_needs_a_pose_a_scan() -> None:
    with pytest.raises(ShapeError, match="odometry"):
        run_views(scene_drive((0, 1, 2)), ViewMatcher(), odometry=np.stack([np.eye(4)] * 2))


BROKEN = np.diag([2.0, 1.0, 1.0, 1.0])
NAN = np.full((4, 4), np.nan)


@rows("pose, said", [(BROKEN, "no rotation"), (NAN, "not finite")])
def test_odometry_that_is_no_motion_counts_as_none(pose: Floats, said: str) -> None:
    matcher = ViewMatcher()
    corridor(matcher, 3)
    match = matcher.process(place(7), odometry=pose)
    assert said in match.reason and "may be anywhere" in match.reason and len(matcher) == 4
    before = matcher.stats
    with pytest.raises(ShapeError, match="odometry"):
        matcher.process(place(0), odometry=np.eye(3))
    assert matcher.stats == before


def test_odometry_needs_alignment_from_the_first_scan_on() -> None:
    started = ViewMatcher()
    started.process(place(0))
    for matcher in (started, ViewMatcher(ViewMatcherConfig(method="objects"))):
        with pytest.raises(ConfigError) as caught:
            matcher.process(place(1), odometry=np.eye(4))
        assert caught.value.code == "no-filter"


def test_a_robot_that_is_lost_twice_finds_the_part_in_between() -> None:
    matcher = ViewMatcher()
    corridor(matcher, 4)
    elsewhere = [matcher.process(place(k), odometry=at(1000.0 + k)).id for k in range(10, 14)]
    assert elsewhere == [4, 5, 6, 7]
    there_and_back = [*range(10, 14), *range(12, 9, -1), *range(11, 14)]
    found = [matcher.process(place(k), odometry=at(2000.0 + k)).id for k in there_and_back]
    assert found[-3:] == [5, 6, 7] and len(matcher) == 8


def test_candidates_are_named_by_their_place_though_a_view_is_dropped() -> None:
    matcher = ViewMatcher(ViewMatcherConfig(max_views=2))
    for k in range(5):
        match = matcher.process(place(k), odometry=at(float(k)))
        assert all(id < match.id for id, _ in match.candidates)
