# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views online: ids, what is stored, what is forgotten, and going on from a file."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.config import merged
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.pipelines.views import run_views
from fusionslam.sensors.frame import Cloud
from fusionslam.views.descriptor_comparison import distance_at, similarity_at
from fusionslam.views.match import NO_VIEW, ViewMatch
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.object_comparison import ObjectComparison
from fusionslam.views.recognisers import (
    ViewMatcherConfig,
    complete_config,
    scene_config,
    similarity_config,
)
from fusionslam.views.scenes import build_scene
from refusals import refuses
from rows import rows
from scenes import LAPS, NOTHING, drive, place
from stored import change_archive

SCENES = {"method": "objects"}
DESCRIPTOR = {"method": "cm2dp", "max_distance": 0.24}


def config(**values: Any) -> ViewMatcherConfig:
    return merged(ViewMatcherConfig(), values)


def matcher(**values: Any) -> ViewMatcher:
    return ViewMatcher(config(**values))


def ids(one: ViewMatcher, places: tuple[int, ...] = LAPS) -> list[int]:
    return run_views(drive(places), one).ids.tolist()


@rows("values", [{}, SCENES, {"preset": "paper"}, DESCRIPTOR])
def test_places_seen_again_get_their_id_and_others_a_new_one(values: dict[str, Any]) -> None:
    assert ids(matcher(**values)) == list(LAPS)


def test_scan_contexts_are_recognised_at_another_turn() -> None:
    again = place(0)
    turned = again.points @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    one = matcher(method="scan_context", max_distance=0.05)
    assert [one.process(cloud).id for cloud in (again, place(1), Cloud(turned))] == [0, 1, 0]


@rows("method, word", [("alignment", "probability"), ("objects", "similarity")])
def test_a_match_tells_what_was_compared_and_why(method: str, word: str) -> None:
    one = matcher(method=method, threshold=0.7)
    first, other, again = (one.process(place(*seen)) for seen in ((0, 0), (1, 0), (0, 1)))
    assert first == ViewMatch(0, 0.0, True, "new view 0: nothing is stored yet", True)
    assert other.id == 1 and other.is_new and other.stored and other.similarity < 0.7
    assert f"{word} {other.similarity:.4g} < 0.7" in other.reason
    assert again.id == 0 and again.matched == 0 and not again.is_new and not again.stored
    assert f"{word} {again.similarity:.4g} >= 0.7" in again.reason
    assert (again.relative_pose is not None) == (method == "alignment")


def test_the_similarity_is_that_of_the_best_stored_scene() -> None:
    values = config(**SCENES, threshold=1.0)
    clouds = [place(number) for number in range(5)]
    scenes = [build_scene(c.points, c.colors, config=scene_config(values)) for c in clouds]
    stored = ObjectComparison(scene_config(values), similarity_config(values), 1.0)
    one = ViewMatcher(values)
    for number, scene in enumerate(scenes[:-1]):
        one.process(scene)
        stored.add(stored.view(scene))
        assert len(one) == number + 1
    best, *rest = stored.compare(stored.view(scenes[-1]), 9)
    assert one.process(scenes[-1]).similarity == best.similarity
    assert [r.similarity for r in rest] == sorted((r.similarity for r in rest), reverse=True)
    assert len({candidate.slot for candidate in (best, *rest)}) == 4


def test_a_distance_is_compared_with_the_largest_allowed_one() -> None:
    one = matcher(**DESCRIPTOR)
    one.process(place(0))
    found = one.process(place(0))
    assert found.similarity == 1.0 and "0 <= 0.24" in found.reason
    assert one.threshold == similarity_at(0.24) and "> 0.24" in one.process(place(1)).reason


def test_scans_with_nothing_to_recognise_have_no_view_and_are_not_stored() -> None:
    one = matcher()
    places = (0, -1, 1, -1, 0)
    assert ids(one, places) == [0, NO_VIEW, 1, NO_VIEW, 0]
    assert (one.stats.nothing, one.stats.stored, one.stats.processed) == (2, 2, 5)
    assert "2 stored views" in repr(one) and "5 scans" in repr(one)
    found = one.process(NOTHING)
    assert (found.id, found.is_new, found.stored) == (-1, False, False)
    assert "min_objects" in found.reason


def test_a_cloud_that_no_descriptor_fits_has_nothing_to_recognise() -> None:
    line = np.zeros((50, 3), np.float32)
    line[:, 0] = np.arange(50)
    one = matcher(**DESCRIPTOR)
    assert one.process(Cloud(line, np.zeros((50, 3), np.uint8))).id == NO_VIEW


def test_single_objects_are_taken_and_counted_unless_more_are_asked_for() -> None:
    for least, expected in ((1, 0), (2, NO_VIEW)):
        one = matcher(min_objects=least)
        assert one.process(place(0, objects=1)).id == expected
        assert one.stats.single == 1 and one.stats.nothing == int(least == 2)


def test_scans_without_objects_match_each_other_if_that_is_asked_for() -> None:
    one = matcher(**SCENES, min_objects=0)
    assert [one.process(cloud).id for cloud in (NOTHING, place(0), NOTHING)] == [0, 1, 0]
    # Nothing cannot be laid over nothing.
    two = matcher(method="alignment", min_objects=0)
    assert [two.process(cloud).id for cloud in (NOTHING, place(0), NOTHING)] == [0, 1, 2]


def test_several_views_of_a_place_are_stored_if_they_differ_enough() -> None:
    seen = [place(3, visit, shift=0.2) for visit in range(12)]
    values = {**SCENES, "threshold": 0.2, "policy": "several", "store_below": 0.95}
    several, first = matcher(**values, per_place=3), matcher(**SCENES, threshold=0.2)
    found = [several.process(cloud) for cloud in seen]
    assert {match.id for match in found} == {0} == {first.process(cloud).id for cloud in seen}
    assert len(several) == 3 and len(first) == 1
    assert [match.stored for match in found].count(True) == 3
    for match in found[1:]:
        assert not match.is_new and (match.similarity < 0.95 or not match.stored)


def test_memory_is_bounded_by_dropping_what_never_came_back() -> None:
    one = matcher(max_views=3)
    # 0 came back after three scans, so 1 or 2 makes room for 3, and the other for it.
    found = ids(one, (0, 1, 2, 0, 3, 0))
    assert found == [0, 1, 2, 0, 3, 0]
    assert (one.stats.dropped, one.stats.stored, len(one)) == (1, 3, 3)
    assert [one.process(place(number, 9)).id for number in (0, 3)] == [0, 3]


def test_a_view_that_stays_away_for_twice_its_longest_absence_is_dropped() -> None:
    one = matcher(max_views=3)
    # 0 is away for three scans, then for more than six, in which others come and go.
    assert ids(one, (0, 1, 2, 0))[-1] == 0
    for number in range(3, 12):
        one.process(place(number))
    assert one.process(place(0, 1)).is_new


# A vector for each place of a tour, all of them farther apart than two views of a place.
def tour_ids(one: ViewMatcher, places: Iterable[int]) -> list[int]:
    length = one.comparison.view(place(0)).content.shape[0]
    rows = np.random.default_rng(5).normal(size=(700, length)).astype(np.float32)
    return [one.process(rows[number]).id for number in places]


@rows("places, share", [(60, 0.3), (33, 0.75)])
def test_a_tour_of_more_places_than_fit_is_recognised_in_part(places: int, share: float) -> None:
    one = matcher(method="m2dp", max_views=30)
    found = tour_ids(one, list(range(places)) * 12)
    late = found[2 * places :]
    known = sum(id in found[: index + 2 * places] for index, id in enumerate(late))
    # Dropping the least recently used recognises none.
    assert known / len(late) > share and len(one) == 30


def test_a_tour_that_fits_is_recognised_wherever_the_robot_was_before() -> None:
    one = matcher(method="m2dp", max_views=30)
    tour_ids(one, list(range(100, 120)) * 5)
    tour_ids(one, list(range(20)) * 10)
    assert len(set(tour_ids(one, range(20)))) == 20
    assert one.stats.new < 20 + 5 * 20
    before = one.stats.new
    tour_ids(one, list(range(20)) * 3)
    assert one.stats.new == before


@rows("method", ["m2dp", "objects", "alignment"])
def test_with_a_threshold_of_0_everything_matches(method: str) -> None:
    one = matcher(method=method, threshold=0)
    assert [one.process(place(number)).id for number in range(3)] == [0, 0, 0]
    assert distance_at(0.0) == np.inf and distance_at(similarity_at(0.24)) == pytest.approx(0.24)


@rows("values", [{}, SCENES, DESCRIPTOR])
def test_stored_views_are_counted_in_bytes(values: dict[str, Any], tmp_path: Path) -> None:
    one = matcher(**values, max_views=4)
    ids(one)
    state = one.comparison.state()
    held = state["scenes"] if "scenes" in state else state["descriptors"]
    assert one.stats.bytes == held.nbytes == one.stats.bytes_per_view * 4
    one.save(tmp_path / "views")
    assert ViewMatcher.load(tmp_path / "views").stats == one.stats


@rows(
    "values",
    [{}, {"policy": "several", "store_below": 0.999}, SCENES, DESCRIPTOR],
)
def test_going_on_from_a_file_is_like_never_having_stopped(
    values: dict[str, Any], tmp_path: Path
) -> None:
    scenes = drive((*LAPS, 6, -1, 7, 1, 0, 6))
    whole = run_views(scenes, matcher(**values, max_views=5))
    one = matcher(**values, max_views=5)
    found = []
    for half in np.array_split(np.arange(len(scenes)), 3):
        found += list(run_views(scenes.subset(half), one).matches)
        one.save(tmp_path / "views")
        one = ViewMatcher.load(tmp_path / "views")
    assert found == list(whole.matches) and one.stats == whole.stats
    assert one.config == complete_config(config(**values, max_views=5))


def test_a_file_written_before_absences_were_stored_is_read(tmp_path: Path) -> None:
    one, path = matcher(), tmp_path / "views"
    ids(one)
    one.save(path)
    with np.load(path) as stored:
        slots = stored["slots"][:, :3]
    change_archive(path, slots=slots)
    again = ViewMatcher.load(path)
    assert again.stats == one.stats and again.process(place(1, 5)).id == 1


def test_bad_scans_are_refused_and_change_nothing() -> None:
    one = matcher()
    one.process(place(0))
    before = one.stats
    bad = place(1)
    bad.points[5, 1] = np.nan
    with pytest.raises(DataError, match=r"\b5\b"):
        one.process(bad)
    with refuses("no-colors"):
        one.process(Cloud(place(1).points))
    with pytest.raises(ShapeError, match="str"):
        one.process("scene")
    assert one.stats == before and one.process(place(0, 1)).id == 0
    plain = matcher(**DESCRIPTOR)
    with refuses("not-finite"):
        plain.process(bad)
    with refuses("no-colors"):
        plain.process(Cloud(place(1).points))
    with pytest.raises(ShapeError, match=r"\(576,\).*\(3,\)"):
        plain.process(np.zeros(3, np.float32))


@rows(
    "values",
    [
        {"threshold": 1.1},
        {"threshold": -0.1},
        {"threshold": float("nan")},
        {"max_distance": -1.0},
        {"min_objects": -1},
        {"policy": "all"},
        {"max_views": -1},
    ],
)
def test_values_out_of_range_are_refused_by_name(values: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(values))):
        config(**values)


def save_matcher(path: Path) -> Path:
    one = matcher()
    ids(one)
    one.save(path)
    return path


def test_a_file_that_is_cut_foreign_or_missing_is_refused(tmp_path: Path) -> None:
    path = save_matcher(tmp_path / "views")
    whole = path.read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(DataError, match=str(path)):
            ViewMatcher.load(path)
    path.write_text("a text")
    with pytest.raises(DataError, match=str(path)):
        ViewMatcher.load(path)
    with pytest.raises(DataError, match="none"):
        ViewMatcher.load(tmp_path / "none")


def test_a_file_of_another_version_or_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    path = save_matcher(tmp_path / "views")
    change_archive(path, slots=np.zeros((2, 3), np.int64))
    with pytest.raises(DataError, match=r"\(2, 3\)"):
        ViewMatcher.load(path)
    save_matcher(path)
    change_archive(path, lambda about, _: about.update({"comparison": "cm2dp"}))
    with refuses("other-kind", "cm2dp", "alignment"):
        ViewMatcher.load(path)
    save_matcher(path)
    change_archive(path, lambda about, _: about.update({"format": "fusionslam.view_matcher.0"}))
    with pytest.raises(DataError, match=r"view_matcher\.0.*view_matcher\.1"):
        ViewMatcher.load(path)
    save_matcher(path)
    change_archive(path, lambda about, _: about.update({"views": {"threshold": 3.0}}))
    with pytest.raises(DataError, match="threshold"):
        ViewMatcher.load(path)
