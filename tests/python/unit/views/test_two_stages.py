# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views with a second stage, which may only turn a match into a rejection."""

from pathlib import Path

import pytest

from fusionslam.errors import ConfigError, ShapeError
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.scenes import build_scene
from refusals import refuses
from scenes import NOTHING, MeanColor, painted, place, two_stages


def test_a_second_stage_turns_matches_into_rejections_only() -> None:
    one = two_stages(MeanColor())
    assert one.process(painted(0, 0, 40)).id == 0
    rejected = one.process(painted(0, 1, 200))
    assert (rejected.id, rejected.is_new, rejected.similarity) == (1, True, 0.0)
    assert "the second stage rejected" in rejected.reason
    # Not like the first stage's: the second one has no say.
    assert one.process(painted(4, 0, 40)).id == 2


def test_the_next_best_view_is_taken_where_the_best_is_rejected() -> None:
    one = two_stages(MeanColor())
    for shade in (40, 200):
        one.process(painted(0, 0, shade))
    assert [one.process(painted(0, 0, shade)).id for shade in (200, 40)] == [1, 0]


def test_below_its_start_the_second_stage_is_not_asked() -> None:
    second = MeanColor()
    one = two_stages(second, start=1.0)
    one.process(painted(0, 0, 40))
    assert one.process(painted(0, 1, 200)).id == 0 and second.asked == 0


def test_no_more_candidates_than_allowed_are_looked_at() -> None:
    second = MeanColor()
    one = two_stages(second, most=2)
    for shade in (10, 60, 110, 160):
        one.process(painted(0, 0, shade))
    second.asked = 0
    assert one.process(painted(0, 0, 160)).is_new and second.asked == 2


def test_both_stages_are_saved_and_go_on(tmp_path: Path) -> None:
    one = two_stages(MeanColor())
    for shade in (40, 200):
        one.process(painted(0, 0, shade))
    one.process(NOTHING)
    assert one.stats.nothing == 1
    assert one.stats.bytes > sum(array.nbytes for array in [one.comparison.state()["scenes"]])
    one.save(tmp_path / "views")
    with refuses("other-kind", "two_stage.objects", "objects"):
        ViewMatcher.load(tmp_path / "views")
    fresh = two_stages(MeanColor()).comparison
    again = ViewMatcher.load(tmp_path / "views", comparison=fresh)
    assert again.process(painted(0, 1, 200)) == one.process(painted(0, 1, 200))
    assert again.stats == one.stats


def test_dropped_views_are_forgotten_by_both_stages() -> None:
    one = two_stages(MeanColor())
    one.config = one.config.model_copy(update={"max_views": 1})
    for shade in (40, 200):
        one.process(painted(0, 0, shade))
    assert len(one.comparison) == 1 and one.comparison.state()["features"].shape == (1, 3)
    assert one.process(painted(0, 0, 200)).id == 1


def test_scenes_alone_and_values_out_of_range_are_refused() -> None:
    cloud = place(0)
    with pytest.raises(ShapeError):
        two_stages(MeanColor()).process(build_scene(cloud.points, cloud.colors))
    for wrong in ({"threshold": 1.5}, {"start": -0.1}, {"most": 0}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            two_stages(MeanColor(), **wrong)
