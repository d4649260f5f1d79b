# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Alignment of scenes: true poses in made rooms, the index, and views matched by it."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import fails
from fusionslam import ConfigError, DataError
from fusionslam.config import merged
from fusionslam.sensors.frame import Cloud
from fusionslam.views import (
    Alignment,
    AlignmentConfig,
    AlignmentIndex,
    Scene,
    SceneConfig,
    ViewMatcher,
    ViewMatcherConfig,
    align_scenes,
    build_scene,
)
from fusionslam.views.alignment_comparison import AlignmentComparison
from fusionslam.views.match import NO_VIEW
from fusionslam.views.recognisers import ALIGNMENT_THRESHOLD
from refusals import refuses
from rows import rows
from scenes import LAPS, drive, place
from worlds import AHEAD, AROUND, BEHIND, Pose, room, scan, seen_from

SECTORS = {"ahead": AHEAD, "behind": BEHIND, "around": AROUND}
NEAR_M, NEAR_RAD = 0.03, np.radians(0.6)


def scene_of(cloud: Cloud, **values: Any) -> Scene:
    return build_scene(cloud.points, cloud.colors, **values)


def two_poses(seed: int) -> tuple[Pose, Pose]:
    """Somewhere in the middle of a room, and a little beside it."""
    rng = np.random.default_rng([37, seed])
    x, y, yaw = (float(v) for v in (*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)))
    dx, dy = rng.uniform(-0.35, 0.35, 2)
    return (x, y, yaw), (x + dx, y + dy, yaw + np.radians(rng.uniform(-12, 12)))


def is_at(found: tuple[float, float, float], true: Pose) -> bool:
    near = np.hypot(found[0] - true[0], found[1] - true[1]) < NEAR_M
    return bool(near and abs(found[2] - true[2]) < NEAR_RAD)


def values_of(alignment: Alignment) -> tuple[float, ...]:
    place = (alignment.x, alignment.y, alignment.yaw, alignment.probability)
    return (*place, *alignment.evidence.values())


@rows("sector", SECTORS)
@rows("seed", range(5))
def test_the_pose_is_found_and_another_room_is_told_apart(sector: str, seed: int) -> None:
    stored, current = two_poses(seed)
    kept = scene_of(scan(room(seed), stored, SECTORS[sector], seed=1))
    found = align_scenes(scene_of(scan(room(seed), current, SECTORS[sector], seed=2)), kept)
    assert is_at((found.x, found.y, found.yaw), seen_from(stored, current))
    assert found.probability > ALIGNMENT_THRESHOLD
    other = scene_of(scan(room(seed + 50), current, SECTORS[sector], seed=2))
    assert align_scenes(other, kept).probability < 0.2


def test_the_same_shapes_in_other_colors_are_less_probable() -> None:
    stored, current = two_poses(3)
    cloud, kept = scan(room(3), current, seed=2), scene_of(scan(room(3), stored, seed=1))
    assert cloud.colors is not None
    painted = scene_of(Cloud(cloud.points, 255 - cloud.colors))
    probability = align_scenes(scene_of(cloud), kept).probability
    assert align_scenes(painted, kept).probability < 0.5 < probability


@rows(
    "moved, limit",
    [
        ((0.2 + 0.3 * np.cos(0.4), 0.1 + 0.3 * np.sin(0.4), 0.4), {"reach": 0.25}),
        ((0.2, 0.1, 0.4 + np.radians(8)), {"turn": 6.0}),
    ],
)
def test_beyond_reach_and_turn_it_is_another_view(moved: Pose, limit: dict[str, float]) -> None:
    stored = (0.2, 0.1, 0.4)
    kept = scene_of(scan(room(4), stored, seed=1))
    scene = scene_of(scan(room(4), moved, seed=2))
    assert align_scenes(scene, kept).probability > ALIGNMENT_THRESHOLD
    found = align_scenes(scene, kept, config=AlignmentConfig(**limit))
    assert found.probability == 0
    assert is_at((found.x, found.y, found.yaw), seen_from(stored, moved))


def test_the_evidence_names_what_speaks_for_it() -> None:
    stored, current = two_poses(1)
    kept = scene_of(scan(room(1), stored, seed=1))
    found = align_scenes(scene_of(scan(room(1), current, seed=2)), kept)
    shares = [found.evidence[name] for name in ("agreeing", "behind", "before", "empty")]
    assert sum(shares) == pytest.approx(1) and found.evidence["agreeing"] > 0.8
    assert found.evidence["shift"] == pytest.approx(np.hypot(found.x, found.y))
    assert found.evidence["turn"] == pytest.approx(abs(found.yaw))
    assert f"probability {found.probability:.6g}"[:16] in repr(found)


@cache
def many_scenes() -> list[Scene]:
    """Two sights of each of six rooms."""
    return [scene_of(scan(room(n // 2), two_poses(n // 2)[n % 2], seed=n)) for n in range(12)]


@cache
def another_sight() -> Scene:
    """Of the third room."""
    return scene_of(scan(room(2), (0.1, 0.2, 0.3), seed=77))


def index_of(scenes: list[Scene], **config: Any) -> AlignmentIndex:
    index = AlignmentIndex(AlignmentConfig(**config))
    assert [index.add(scene) for scene in scenes] == list(range(len(scenes)))
    return index


def results(found: list[tuple[int, Alignment]]) -> list[tuple[int, tuple[float, ...]]]:
    return [(number, values_of(alignment)) for number, alignment in found]


def check(found: list[tuple[int, Alignment]], current: Scene) -> None:
    """What is found is what pairs give, the most probable first."""
    for number, values in results(found):
        assert values == values_of(align_scenes(current, many_scenes()[number]))
    order = [(-alignment.probability, number) for number, alignment in found]
    assert order == sorted(order)


def test_the_index_aligns_as_pairs_are_aligned() -> None:
    index = index_of(many_scenes(), candidates=100)
    found = index.query(another_sight())
    assert sorted(number for number, _ in found) == list(range(12)) and len(index) == 12
    check(found, another_sight())


def test_threads_do_not_change_what_is_found() -> None:
    index, current = index_of(many_scenes()), many_scenes()[4]
    one, four, all_cores = (results(index.query(current, threads=n)) for n in (1, 4, 0))
    assert one == four == all_cores and one[0][0] == 4 and one[0][1][3] > ALIGNMENT_THRESHOLD
    near = [10, 7, 0]
    one, four, all_cores = (
        results(index.query_near(current, near, 6, threads=n)) for n in (1, 4, 0)
    )
    assert one == four == all_cores and {*near, 4} <= {number for number, _ in one}


def test_only_the_views_that_look_most_alike_are_aligned() -> None:
    found = index_of(many_scenes(), candidates=2).query(many_scenes()[6])
    assert len(found) == 2 and found[0][0] == 6


def test_removed_scenes_are_not_found_and_later_ones_move_up() -> None:
    scenes, index = many_scenes(), index_of(many_scenes())
    index.remove(3)
    assert len(index) == 11 and index.query(scenes[4])[0][0] == 3
    assert index.query(scenes[2])[0][0] == 2
    with pytest.raises(ConfigError, match="11"):
        index.remove(11)


@rows("most", [2, 3, 7, 12, 100])
def test_views_that_are_near_are_aligned_however_they_look(most: int) -> None:
    current = another_sight()
    apart = [align_scenes(current, scene).evidence["thumbnail"] for scene in many_scenes()]
    ranked = np.argsort(apart, kind="stable").tolist()
    near = [ranked[-1], ranked[-4]]
    others = [number for number in ranked if number not in near]
    found = index_of(many_scenes(), candidates=3).query_near(current, near, most)
    # The rest are the most similar others.
    assert {number for number, _ in found} == {*near, *others[: most - 2]}
    check(found, current)


@rows("candidates", [1, 4, 12, 50])
def test_without_views_that_are_near_the_most_similar_ones_are_aligned(candidates: int) -> None:
    index = index_of(many_scenes(), candidates=candidates)
    for current in many_scenes()[:3]:
        assert results(index.query_near(current, [], candidates)) == results(index.query(current))


def test_no_more_than_so_many_are_aligned_even_if_more_are_near() -> None:
    index, current = index_of(many_scenes()), many_scenes()[6]
    near = [1, 9, 4, 11, 6]
    for most in range(6):
        found = [number for number, _ in index.query_near(current, near, most)]
        assert len(found) == len(set(found)) == most and set(found) <= set(near)
    # The order does not count, nor does a number that is given twice.
    for same in (near[::-1], near * 2):
        for most in (5, 8):
            again = index.query_near(current, same, most)
            assert results(again) == results(index.query_near(current, near, most))


@rows("near", [[12], [0, 1, 99], [2**40]])
def test_near_views_that_are_not_stored_are_refused(near: list[int]) -> None:
    index, current = index_of(many_scenes()), many_scenes()[0]
    before = results(index.query(current))
    with pytest.raises(ConfigError, match=f"no scene {near[-1]} among 12"):
        index.query_near(current, near, 5)
    assert results(index.query(current)) == before


def test_an_empty_index_has_no_near_views() -> None:
    with pytest.raises(ConfigError):
        AlignmentIndex().query_near(another_sight(), [0], 5)
    assert AlignmentIndex().query_near(another_sight(), [], 5) == []


def test_a_comparison_says_where_the_robot_is_beside_near_views() -> None:
    comparison = AlignmentComparison(SceneConfig(), AlignmentConfig(candidates=2), 0.5)
    for scene in many_scenes():
        comparison.add(comparison.view(scene))
    view = comparison.view(many_scenes()[6])
    found = comparison.compare_near(view, [3, 9], 4)
    assert len(found) == 4 and {3, 9, 6} <= {one.slot for one in found}
    for one in found:
        alignment = align_scenes(view.content, many_scenes()[one.slot])
        assert one.relative_pose == (alignment.x, alignment.y, alignment.yaw)
        assert one.similarity == alignment.probability
    assert comparison.compare_near(view, [], 2) == comparison.compare(view, 2)


def points_of(count: int) -> Cloud:
    """So many points in as many cells of one object."""
    azimuth = np.radians(2.0 * np.arange(count))
    place = [2 * np.cos(azimuth), 2 * np.sin(azimuth), np.full(count, 0.4)]
    return Cloud(np.stack(place, axis=1).astype(np.float32), np.full((count, 3), 80, np.uint8))


@rows("count", [0, 1, 9])
def test_too_few_cells_are_never_aligned_or_stored(count: int) -> None:
    few, whole = scene_of(points_of(count)), another_sight()
    for pair in ((few, few), (few, whole), (whole, few)):
        assert align_scenes(*pair).probability == 0
    index = AlignmentIndex()
    assert index.query(few) == [] and index.add(few) == 0
    assert all(alignment.probability == 0 for _, alignment in index.query(whole))
    matcher = ViewMatcher(merged(ViewMatcherConfig(), {"scene": {"min_points": 2, "min_size": 1}}))
    for _ in range(2):
        match = matcher.process(points_of(count))
        assert (match.id, match.stored, match.is_new) == (NO_VIEW, False, False)
    assert matcher.stats.nothing == 2 and len(matcher) == 0
    assert matcher.process(points_of(12)).id == 0


def drive_through_rooms(visits: tuple[int, ...]) -> list[Cloud]:
    """The middle of a room a visit, from a little beside on each."""
    clouds = []
    for visit, number in enumerate(visits):
        stored, current = two_poses(number)
        share = (visit % 3) / 2
        pose = tuple(a + share * (b - a) for a, b in zip(stored, current, strict=True))
        clouds.append(scan(room(number), pose, seed=visit))
    return clouds


VISITS = (0, 1, 2, 0, 3, 1, 0, 4)


def test_the_matcher_says_where_the_robot_is_beside_the_stored_view() -> None:
    matcher = ViewMatcher()
    stored, current = two_poses(5)
    first = matcher.process(scan(room(5), stored, seed=1))
    again = matcher.process(scan(room(5), current, seed=2))
    assert first.relative_pose is None and (again.id, again.matched) == (0, 0)
    assert again.relative_pose is not None
    assert is_at(again.relative_pose, seen_from(stored, current))
    assert again.similarity >= ALIGNMENT_THRESHOLD


def test_rooms_get_their_ids_and_a_matcher_that_is_stored_goes_on_the_same(tmp_path: Path) -> None:
    whole, parts = ViewMatcher(), ViewMatcher()
    for number, cloud in zip(VISITS, drive_through_rooms(VISITS), strict=True):
        expected = whole.process(cloud)
        assert expected.id == number and parts.process(cloud) == expected
        parts.save(tmp_path / "views.npz")
        parts = ViewMatcher.load(tmp_path / "views.npz")
    assert parts.stats == whole.stats and parts.comparison.kind == "alignment"


def test_scenes_from_clouds_bytes_and_with_floor_match_alike() -> None:
    matchers = [ViewMatcher() for _ in range(3)]
    for cloud in drive_through_rooms(VISITS[:6]):
        assert cloud.colors is not None
        floor = np.array([[1.0, 0.2, 0.05], [2, -0.3, -0.1]], np.float32)
        colors = np.concatenate([cloud.colors, np.full((2, 3), 9, np.uint8)])
        on_floor = Cloud(np.concatenate([cloud.points, floor]), colors)
        back = Scene.from_bytes(scene_of(cloud).to_bytes())
        one, two, three = (
            matcher.process(item)
            for matcher, item in zip(matchers, (cloud, on_floor, back), strict=True)
        )
        assert one == two == three


def test_items_that_cannot_be_compared_are_refused_and_change_nothing() -> None:
    cloud, spoilt = (scan(room(0), (0, 0, 0)) for _ in range(2))
    spoilt.points[9, 2] = np.nan
    matcher = ViewMatcher()
    matcher.process(cloud)
    before = matcher.stats
    with refuses("no-range-image"):
        matcher.process(scene_of(cloud, preset="author"))
    with pytest.raises(DataError, match=r"\b9\b"):
        matcher.process(spoilt)
    with refuses("no-colors"):
        matcher.process(Cloud(cloud.points))
    assert matcher.stats == before and matcher.process(cloud).id == 0


def test_objects_out_of_range_leave_nothing_to_recognise_and_stop_no_drive() -> None:
    points = np.random.default_rng(5).uniform(-0.4, 0.4, (400, 3)) + np.array([40.0, 0, 1])
    far = Cloud(points.astype(np.float32), np.full((400, 3), 120, np.uint8))
    scene = scene_of(far)
    assert len(scene) == 1 and not len(scene.image)
    one = ViewMatcher()
    found = [one.process(item).id for item in (place(0), far, scene, place(0))]
    assert found == [0, NO_VIEW, NO_VIEW, 0] and one.stats.nothing == 2
    # Read from a file a scene is the same.
    assert one.process(Scene.from_bytes(scene.to_bytes())).id == NO_VIEW


@rows("values", [{"preset": "author"}, {"scene": {"image": False}}])
def test_alignment_of_scenes_that_have_no_image_is_refused_at_once(values: dict[str, Any]) -> None:
    with refuses("no-range-image", error=ConfigError):
        ViewMatcher(merged(ViewMatcherConfig(), {"method": "alignment", **values}))


def test_the_command_line_says_so_before_data_are_read(tmp_path: Path) -> None:
    drive(LAPS).save(tmp_path / "set.npz")
    words = ("--set", "views.method=alignment", "--set", "views.preset=paper")
    line = fails(2, "views", "match", tmp_path / "set.npz", "-o", tmp_path / "out", *words)
    assert "scene.image" in line


@rows(
    "values",
    [
        {"candidates": 0},
        {"iterations": 0},
        {"points": 3},
        {"first_scale": 0.0},
        {"last_scale": -1.0},
        {"tolerance": float("nan")},
        {"reach": 0.0},
        {"turn": 181.0},
        {"tilt": 1.0},
    ],
)
def test_bad_configurations_are_refused_by_name(values: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(values))):
        AlignmentConfig(**values)
    with pytest.raises(ConfigError, match=next(iter(values))):
        merged(ViewMatcherConfig(), {"alignment": values})
