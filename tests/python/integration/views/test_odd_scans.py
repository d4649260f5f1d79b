# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scans that leave little or nothing to align."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import fails
from fusionslam.config import merged
from fusionslam.errors import ConfigError
from fusionslam.sensors.frame import Cloud
from fusionslam.views import Scene, ViewMatcher, ViewMatcherConfig, build_scene
from fusionslam.views.match import NO_VIEW
from refusals import refuses
from scenes import LAPS, drive, place

COUNT = 400


def thing(x: float) -> Cloud:
    """One object so far ahead, in metres."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.4, 0.4, (COUNT, 3)) + np.array([x, 0, 1])
    return Cloud(points.astype(np.float32), np.full((COUNT, 3), 120, np.uint8))


def test_objects_out_of_range_leave_nothing_to_recognise_and_stop_no_drive() -> None:
    far = thing(40.0)
    scene = build_scene(far.points, far.colors)
    assert len(scene) == 1 and not len(scene.image)
    one = ViewMatcher()
    found = [one.process(item).id for item in (place(0), far, scene, place(0))]
    assert found == [0, NO_VIEW, NO_VIEW, 0] and one.stats.nothing == 2
    # Read from a file a scene is the same.
    assert one.process(Scene.from_bytes(scene.to_bytes())).id == NO_VIEW


def test_scenes_made_without_an_image_are_still_refused() -> None:
    near = thing(5.0)
    plain = build_scene(near.points, near.colors, preset="author")
    with refuses("no-range-image"):
        ViewMatcher().process(plain)


@pytest.mark.parametrize("values", [{"preset": "author"}, {"scene": {"image": False}}])
def test_alignment_of_scenes_that_have_no_image_is_refused_at_once(values: dict[str, Any]) -> None:
    with refuses("no-range-image", error=ConfigError):
        ViewMatcher(merged(ViewMatcherConfig(), {"method": "alignment", **values}))


def test_the_command_line_says_so_before_data_are_read(tmp_path: Path) -> None:
    drive(LAPS).save(tmp_path / "set.npz")
    words = ("--set", "views.method=alignment", "--set", "views.preset=paper")
    line = fails(2, "views", "match", tmp_path / "set.npz", "-o", tmp_path / "out", *words)
    assert "scene.image" in line
