# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views online: ids, what is stored and forgotten, files, second stages and threads."""

import io
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.pipelines.views import run_views
from fusionslam.sensors.frame import Cloud
from fusionslam.views.comparison import ObjectComparison
from fusionslam.views.descriptor_comparison import distance_at, similarity_at
from fusionslam.views.match import NO_VIEW, ViewMatch
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import complete_config, scene_config, similarity_config
from fusionslam.views.scenes import build_scene
from refusals import refuses
from rows import rows
from scenes import (
    LAPS,
    NOTHING,
    MeanColor,
    check_going_on,
    config_of,
    drive,
    matcher,
    painted,
    place,
    two_stages,
)
from stored import change_archive, check_damaged_files

SCENES = {"method": "objects"}
DESCRIPTOR = {"method": "cm2dp", "max_distance": 0.24}


def ids(one: ViewMatcher, places: tuple[int, ...] = LAPS) -> list[int]:
    return run_views(drive(places), one).ids.tolist()


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """The file of a matcher that drove three laps."""
    one = matcher()
    ids(one)
    one.save(tmp_path / "views")
    return tmp_path / "views"


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
    values = config_of(**SCENES, threshold=1.0)
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


@rows("least, expected", [(1, 0), (2, NO_VIEW)])
def test_single_objects_are_taken_unless_more_are_needed(least: int, expected: int) -> None:
    one = matcher(min_objects=least)
    assert one.process(place(0, objects=1)).id == expected
    assert one.stats.single == 1 and one.stats.nothing == int(least == 2)


# Nothing cannot be laid over nothing.
@rows("method, expected", [("objects", [0, 1, 0]), ("alignment", [0, 1, 2])])
def test_scans_without_objects_may_match_each_other(method: str, expected: list[int]) -> None:
    one = matcher(method=method, min_objects=0)
    assert [one.process(cloud).id for cloud in (NOTHING, place(0), NOTHING)] == expected


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
    assert (one.stats.dropped, one.stats.stored, len(one), len(one.comparison)) == (1, 3, 3, 3)
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
    found = tour_ids(one, list(range(places)) * 8)
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


def test_similarities_are_distances_in_another_form() -> None:
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


@rows("values", [{}, {"policy": "several", "store_below": 0.999}, SCENES, DESCRIPTOR])
def test_a_stored_matcher_goes_on_the_same(values: dict[str, Any], tmp_path: Path) -> None:
    scenes, values = drive((0, 1, 2, 3, 0, 1, 6, -1, 7, 1, 0, 6)), {**values, "max_views": 3}
    one = check_going_on(scenes, tmp_path / "views", 3, **values)
    assert one.config == complete_config(config_of(**values))


@rows("values, where", [({}, r"\b5\b"), (DESCRIPTOR, "NaN")])
def test_bad_scans_are_refused_and_change_nothing(values: dict[str, Any], where: str) -> None:
    one = matcher(**values)
    one.process(place(0))
    before, bad = one.stats, place(1)
    bad.points[5, 1] = np.nan
    with pytest.raises(DataError, match=where):
        one.process(bad)
    with refuses("no-colors"):
        one.process(Cloud(place(1).points))
    with pytest.raises(ShapeError, match="str"):
        one.process("scene")
    assert one.stats == before and one.process(place(0)).id == 0


def test_descriptors_of_another_length_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"\(576,\).*\(3,\)"):
        matcher(**DESCRIPTOR).process(np.zeros(3, np.float32))


@rows(
    "name, value",
    [
        ("threshold", 1.1),
        ("threshold", -0.1),
        ("threshold", float("nan")),
        ("max_distance", -1.0),
        ("min_objects", -1),
        ("policy", "all"),
        ("max_views", -1),
    ],
)
def test_values_out_of_range_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(ConfigError, match=name):
        config_of(**{name: value})


def test_a_file_that_is_cut_foreign_or_missing_is_refused(saved: Path) -> None:
    check_damaged_files(saved, ViewMatcher.load)


@rows(
    "change, words",
    [
        ({"comparison": "cm2dp"}, "cm2dp.*alignment"),
        ({"format": "fusionslam.view_matcher.0"}, r"view_matcher\.0.*view_matcher\.1"),
        ({"views": {"threshold": 3.0}}, "threshold"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(change: Any, words: str, tmp_path: Path) -> None:
    matcher().save(tmp_path / "views")
    change_archive(tmp_path / "views", lambda about, _: about.update(change))
    with pytest.raises(DataError, match=words):
        ViewMatcher.load(tmp_path / "views")


def test_rows_of_views_that_do_not_fit_are_refused(saved: Path) -> None:
    change_archive(saved, slots=np.zeros((2, 3), np.int64))
    with pytest.raises(DataError, match=r"\(2, 3\)"):
        ViewMatcher.load(saved)


def seen(shade: int, visit: int = 0) -> Cloud:
    """A place that looks the same to the first stage whatever its shade."""
    return painted(0, visit, shade)


def two_stages_after(*shades: int, **more: Any) -> tuple[ViewMatcher, MeanColor]:
    """A matcher that has seen these shades, and its second stage, not asked so far."""
    second = MeanColor()
    one = two_stages(second, **more)
    for shade in shades:
        one.process(seen(shade))
    second.asked = 0
    return one, second


def test_a_second_stage_turns_matches_into_rejections_only() -> None:
    one, _ = two_stages_after(40)
    rejected = one.process(seen(200, 1))
    assert (rejected.id, rejected.is_new, rejected.similarity) == (1, True, 0.0)
    assert "the second stage rejected" in rejected.reason
    # Not like the first stage's: the second one has no say.
    assert one.process(painted(4, 0, 40)).id == 2


def test_the_next_best_view_is_taken_where_the_best_is_rejected() -> None:
    one, _ = two_stages_after(40, 200)
    assert [one.process(seen(shade)).id for shade in (200, 40)] == [1, 0]


def test_below_its_start_the_second_stage_is_not_asked() -> None:
    one, second = two_stages_after(40, start=1.0)
    assert one.process(seen(200, 1)).id == 0 and second.asked == 0


def test_no_more_candidates_than_allowed_are_looked_at() -> None:
    one, second = two_stages_after(10, 60, 110, 160, most=2)
    assert one.process(seen(160)).is_new and second.asked == 2


def test_both_stages_are_saved_and_go_on(tmp_path: Path) -> None:
    one, _ = two_stages_after(40, 200)
    one.process(NOTHING)
    assert one.stats.nothing == 1
    assert one.stats.bytes > one.comparison.state()["scenes"].nbytes
    one.save(tmp_path / "views")
    with refuses("other-kind", "two_stage.objects", "objects"):
        ViewMatcher.load(tmp_path / "views")
    fresh = two_stages(MeanColor()).comparison
    again = ViewMatcher.load(tmp_path / "views", comparison=fresh)
    assert again.process(seen(200, 1)) == one.process(seen(200, 1))
    assert again.stats == one.stats


def test_dropped_views_are_forgotten_by_both_stages() -> None:
    one = two_stages(MeanColor())
    one.config = one.config.model_copy(update={"max_views": 1})
    for shade in (40, 200):
        one.process(seen(shade))
    assert len(one.comparison) == 1 and one.comparison.state()["features"].shape == (1, 3)
    assert one.process(seen(200)).id == 1


def test_a_second_stage_refuses_scenes_alone_and_values_out_of_range() -> None:
    cloud = place(0)
    with pytest.raises(ShapeError):
        two_stages(MeanColor()).process(build_scene(cloud.points, cloud.colors))
    for name, value in (("threshold", 1.5), ("start", -0.1), ("most", 0)):
        with pytest.raises(ConfigError, match=name):
            two_stages(MeanColor(), **{name: value})


THREADS, BOUND = 3, 4
METHODS: list[dict[str, Any]] = [
    {"method": "alignment"},
    {"method": "objects"},
    {"method": "cm2dp", "max_distance": 0.24},
    {"method": "objects", "policy": "several", "store_below": 1.0, "threshold": 0.2},
]


@pytest.fixture
def eager_switches() -> Iterator[None]:
    """Let threads take turns as often as possible."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def in_threads(work: Callable[[int], list[ViewMatch]]) -> list[ViewMatch]:
    """What the same work gives in several threads that begin together."""
    barrier = threading.Barrier(THREADS)

    def begin(number: int) -> list[ViewMatch]:
        barrier.wait()
        return work(number)

    with ThreadPoolExecutor(THREADS) as pool:
        return [match for matches in pool.map(begin, range(THREADS)) for match in matches]


def check(one: ViewMatcher, matches: list[ViewMatch]) -> None:
    new = sorted(match.id for match in matches if match.is_new)
    assert new == list(range(one.stats.new))
    assert one.stats.processed == len(matches)
    assert one.stats.matched + one.stats.new == len(matches)
    assert len(one) == len(one.comparison) == one.stats.stored <= BOUND


def reload(one: ViewMatcher) -> ViewMatcher:
    stream = io.BytesIO()
    one.save(stream)
    stream.seek(0)
    return ViewMatcher.load(stream)


@pytest.mark.usefixtures("eager_switches")
@rows("values", METHODS)
def test_a_matcher_that_forgets_serves_several_threads(values: dict[str, Any]) -> None:
    one = matcher(**values, max_views=BOUND)
    views = [one.view(place(number)) for number in range(8)]
    order = [np.random.default_rng(seed).integers(0, len(views), 30) for seed in range(THREADS)]
    check(one, in_threads(lambda number: [one.process(views[k]) for k in order[number]]))
    assert one.stats.dropped > BOUND
    again = reload(one)
    assert again.stats == one.stats and again.process(views[0]) == one.process(views[0])


@pytest.mark.usefixtures("eager_switches")
def test_two_stages_serve_several_threads() -> None:
    one = two_stages(MeanColor())
    one.config = one.config.model_copy(update={"max_views": BOUND})
    clouds = [place(number) for number in range(8)]
    check(one, in_threads(lambda _: [one.process(cloud) for cloud in clouds * 2]))


@pytest.mark.usefixtures("eager_switches")
def test_a_matcher_is_saved_between_two_scans() -> None:
    one = matcher(method="objects", max_views=BOUND)
    views = [one.view(place(number)) for number in range(8)]

    def work(number: int) -> list[ViewMatch]:
        if number:
            return [one.process(views[k % 8]) for k in range(60)]
        for _ in range(10):
            again = reload(one)
            assert len(again) == again.stats.stored
            assert again.stats.matched + again.stats.new == again.stats.processed
        return []

    check(one, in_threads(work))
