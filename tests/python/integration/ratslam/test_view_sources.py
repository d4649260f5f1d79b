# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sources of views: templates, matchers, and ids that another process gives."""

import logging

import numpy as np
import pytest

from clouds import seen_after_turn
from drives import circle_events, grey_image, on_map, replace_sightings, same, take
from fusionslam.errors import DataError
from fusionslam.ratslam import GivenView, GivenViews, Look, Motion, RatSlam
from fusionslam.ratslam.odometry import Odometry2D
from fusionslam.ratslam.view_sources import (
    KINDS,
    MatcherSource,
    SourceOptions,
    TemplateSource,
    build_view_source,
)
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.sensors.messages import Picture
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import RECOGNISERS, ViewMatcherConfig
from fusionslam.views.visual_templates import VisualTemplates
from rows import rows
from scenes import NOTHING, place


def turn_cloud(cloud: Cloud, x: float, y: float, yaw: float) -> Cloud:
    """The cloud as seen from x, y and yaw in its frame."""
    return Cloud(seen_after_turn(cloud.points - np.float32([x, y, 0]), yaw), cloud.colors)


def test_images_frames_and_what_templates_keep_are_the_same_view() -> None:
    source = TemplateSource(bottom=100)
    kept = VisualTemplates(bottom=100).view(grey_image(70))
    items = [grey_image(70), kept, Frame(images={"left": grey_image(70)})]
    items += [Picture(stamp_ns=0, frame_id="camera", image=grey_image(70))]
    found = [source.look(item, number) for number, item in enumerate(items)]
    assert [one.view_id for one in found] == [0, 0, 0, 0]
    assert [one.stamp_ns for one in found] == [0, 1, 2, 3]
    assert source.look(grey_image(200), 4).view_id == 1
    # Of the same mean as the first, so that it is compared.
    mixed = np.concatenate([grey_image(50)[:, :60], grey_image(90)[:, :60]], axis=1)
    seen = source.look(mixed, 5)
    assert seen.view_id == 2 and "0.0784" in seen.reason


def test_a_turned_panorama_gives_the_rotation() -> None:
    source = TemplateSource(panoramic=True, shift=0, columns=60, rows=4, bottom=None)
    blocks = np.random.default_rng(1).integers(0, 256, (4, 60))
    picture = np.kron(blocks, np.ones((10, 10))).astype(np.uint8)
    assert source.look(picture, 0).relative_rotation == 0
    seen = source.look(np.roll(picture, 150, axis=1), 1)
    # What was ahead lies a quarter to the right: the robot has turned to the left.
    assert seen.view_id == 0 and seen.relative_rotation == pytest.approx(np.pi / 2)


@rows("item", [Frame(index=3), "image.png", Cloud(np.zeros((1, 3), np.float32))])
def test_templates_refuse_what_is_no_image(item: object) -> None:
    source = TemplateSource()
    with pytest.raises(DataError):
        source.look(item, 0)
    assert len(source.templates) == 0


def test_matchers_refuse_images_and_name_their_method() -> None:
    picture = Picture(stamp_ns=5, frame_id="camera", image=grey_image(0))
    with pytest.raises(DataError, match="alignment"):
        MatcherSource().look(picture, 5)


def test_a_scan_with_nothing_to_recognise_is_no_view() -> None:
    source = MatcherSource(ViewMatcher(ViewMatcherConfig(method="objects")))
    assert source.look(place(0), 0).view_id == 0
    seen = source.look(NOTHING, 1)
    assert seen.view_id == -1 and seen.reason
    assert source.look(place(0, 1), 2).view_id == 0


def test_aligned_views_give_the_robots_pose_relative_to_the_first_view_of_the_place() -> None:
    matcher = ViewMatcher(ViewMatcherConfig(method="alignment", policy="several", store_below=1.0))
    source, cloud = MatcherSource(matcher), place(0, objects=5)
    ways = [(0.0, 0.0, 0.0), (0.3, 0.1, 0.2), (0.5, -0.2, 0.3), (0.1, 0.25, -0.1)]
    for number, way in enumerate(ways):
        seen = source.look(turn_cloud(cloud, *way), number)
        assert seen.view_id == 0
        found = (*seen.relative_place, seen.relative_rotation)
        np.testing.assert_allclose(found, way, atol=0.03)
    # Several views are stored, and later ones were matched to others than the first.
    assert matcher.stats.stored > 1


def test_sources_are_built_by_name() -> None:
    names = [name for name in RECOGNISERS if name != "two_stages"]
    titles = {name: build_view_source(name).title for name in names}
    assert titles == {name: name for name in names} | {
        "objects": "objects robust",
        "visual_templates": "visual templates",
    }
    assert {type(build_view_source(name)) for name in names} | {GivenViews} == set(KINDS.values())
    grounded = build_view_source("cm2dp")
    assert isinstance(grounded, MatcherSource) and grounded.matcher.fusion_config.ground == "none"
    author = build_view_source("objects", SourceOptions(ViewMatcherConfig(preset="author")))
    assert author.title == "objects author"


def test_two_stages_have_the_second_stage_of_their_preset() -> None:
    pytest.importorskip("onnxruntime")
    assert build_view_source("two_stages").title == "objects robust, then places"
    paper = build_view_source("two_stages", SourceOptions(ViewMatcherConfig(preset="paper")))
    assert paper.title == "objects paper, then thesis"


@rows("kind", KINDS)
def test_bytes_of_something_else_are_refused(kind: str) -> None:
    for content in (b"", b"\x00" * 7, b"\xff" * 40, b"no views at all"):
        with pytest.raises(DataError):
            KINDS[kind]().restore(content)


def numbers(views: GivenViews, ids: str) -> list[int]:
    """The numbers on the map of ids such as "0+ 1+ 0", where + marks a new one."""
    seen = [GivenView(int(word.rstrip("+")), word.endswith("+")) for word in ids.split()]
    return [views.look(view, k).view_id for k, view in enumerate(seen)]


@rows(
    "ids, wanted, restarts",
    [
        ("0+ 1+ 0 -1 2+ 1 3+", [0, 1, 0, -1, 2, 1, 3], 0),
        # The matcher came back with nothing.
        ("0+ 1+ 2+ 0+ 1+ 0 2+ 3+", [0, 1, 2, 3, 4, 3, 5, 6], 1),
        # It came back with its first two views.
        ("0+ 1+ 2+ 3+ 1 2+ 0 2 3+ 1", [0, 1, 2, 3, 1, 4, 0, 4, 5, 1], 1),
        # Twice.
        ("0+ 0+ 0+ 0", [0, 1, 2, 2], 2),
        # The map began when the matcher had 57 views.
        ("56 57+ 3 56 57 58+ 3", [0, 1, 2, 0, 1, 3, 2], 2),
        # Both.
        ("9 10+ 0+ 9 10 1+", [0, 1, 2, 3, 4, 5], 5),
        # The message about a new view was lost.
        ("0+ 2+ 1 1 3+", [0, 1, 2, 2, 3], 1),
    ],
)
def test_ids_keep_their_numbers_until_a_restart(ids: str, wanted: list[int], restarts: int) -> None:
    views = GivenViews()
    assert numbers(views, ids) == wanted and views.restarts == restarts


def test_numbers_go_on_from_bytes() -> None:
    whole, part = GivenViews(), GivenViews()
    for name in ["0+", "1+", "2+", "3+", "1", "2+", "0", "7", "3+", "1", "9+"]:
        content = part.to_bytes()
        part = GivenViews()
        part.restore(content)
        assert numbers(part, name) == numbers(whole, name)
        assert part.to_bytes() == whole.to_bytes()


def test_a_sighting_keeps_the_values_of_its_view() -> None:
    views = GivenViews()
    seen = views.look(GivenView(0, True, 0.5, (1.0, -2.0), "it is like nothing"), 7)
    assert (seen.stamp_ns, seen.view_id, seen.relative_rotation) == (7, 0, 0.5)
    assert (seen.relative_place, seen.reason) == ((1.0, -2.0), "it is like nothing")
    # The reason also has the number on the map if it is another one.
    seen = views.look(GivenView(0, True, reason="like none"), 8)
    assert seen.view_id == 1 and seen.reason.startswith("like none") and "1" in seen.reason


def test_a_restart_is_logged_as_a_warning_once(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        numbers(GivenViews(), "0+ 1+ 2+ 1+ 8")
    assert [one.levelname for one in caplog.records] == ["WARNING", "INFO"]


@rows("preset", ["robust", "openratslam"])
def test_without_restarts_the_map_is_that_of_sightings_to_the_last_bit(preset: str) -> None:
    events = circle_events(1.1)
    plain, through = RatSlam(preset=preset), RatSlam(preset=preset, views=GivenViews())
    assert take(through, replace_sightings(events)) == take(plain, events)
    assert same(on_map(through), on_map(plain))


NO_NUMBERS = ["[[0, 1]]", "[[-1, 0]]", "[[0]]"]
INVALID_IDS = [f'{{"count": 1, "numbers": {each}}}' for each in NO_NUMBERS]
INVALID_IDS += ["[]", "{}", '{"count": "1", "numbers": []}']


@rows("content", INVALID_IDS)
def test_invalid_stored_ids_are_refused_and_change_nothing(content: str) -> None:
    views = GivenViews()
    numbers(views, "0+ 1+")
    before = views.to_bytes()
    with pytest.raises(DataError):
        views.restore(content.encode())
    assert views.to_bytes() == before


def moved(k: int, x: float) -> Odometry2D:
    return Odometry2D(k * 1_000_000_000, (x, 3.0, 0.0), None)


LOOKS = (0, 1, 2, 3, 1, 2, 4, 2, 1, 3, 2, 1, 0)
WHERE = (0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0)
"""A corridor of places 4 m apart, two of which look like two others."""


def test_a_matcher_that_follows_odometry_tells_look_alike_places_apart() -> None:
    source, found = MatcherSource(), []
    for k, (look, x) in enumerate(zip(LOOKS, WHERE, strict=True)):
        source.follow(moved(k, 4.0 * x))
        found.append(source.look(place(look), k).view_id)
        # A restart between any two scans changes nothing.
        resumed = MatcherSource()
        resumed.restore(source.to_bytes())
        source = resumed
    assert found == list(WHERE)
    alone = MatcherSource(ViewMatcher(ViewMatcherConfig(odometry=False)))
    alone.follow(moved(0, 0.0))
    assert [alone.look(place(look), k).view_id for k, look in enumerate(LOOKS)] != list(WHERE)


@rows("after", [moved(7, 500.0), moved(2, 5.0), moved(60, 5.0)])
def test_odometry_that_jumps_goes_back_or_was_silent_leaves_a_robot_in_doubt(
    after: Odometry2D,
) -> None:
    source = MatcherSource()
    for k in range(6):
        source.follow(moved(k, float(k)))
        assert source.look(place(k), k).view_id == k
    source.follow(after)
    seen = source.look(place(2), 6)
    # RatSLAM gets what the scan alone shows, and believes it once loops agree.
    assert source.matcher.stats.ambiguous == 1 and seen.view_id == 2
    assert "may be anywhere" in seen.reason


def test_the_original_preset_compares_single_scans() -> None:
    for preset, follows in (("robust", True), ("openratslam", False)):
        source = MatcherSource()
        slam = RatSlam(preset=preset, views=source)
        for k in range(3):
            slam.step(Motion(k * 100_000_000, 1.0, 0.0))
            slam.step(Look(k * 100_000_000, place(k)))
        # A matcher that has begun without odometry cannot follow it later.
        assert source.matcher.can_follow_odometry == follows
