# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The Python of the pages runs as it is printed."""

import dataclasses
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags import drive, write_bag
from fusionslam.views import build_scene
from pages import snippets
from scenes import place

NAMES = {"/points": "/velodyne_points", "/camera/image": "/camera/rgb/image_raw/compressed"}
NAMES["/camera/camera_info"] = "/camera/rgb/camera_info"


@pytest.fixture
def beside(tmp_path: Path, kitti: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the recordings that the pages name, small ones."""
    events = [dataclasses.replace(e, topic=NAMES.get(e.topic, e.topic)) for e in drive()]
    write_bag(tmp_path / "drive.bag", events)
    sequences = tmp_path / "kitti/dataset/sequences"
    sequences.mkdir(parents=True)
    shutil.copytree(kitti, sequences / "06")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "page",
    [
        "guides/bags",
        "guides/motion",
        "stages/sensors",
        "stages/fusion",
        "stages/views/index",
        "stages/views/scenes",
        "stages/ratslam",
        "start/first_loops",
        "start/first_map",
        "start/own_robot",
        "guides/visual_odometry",
        "../README",
    ],
)
def test_the_python_of_a_page_runs_as_it_is_printed(page: str, beside: Path) -> None:
    pytest.importorskip("rosbags")
    found = snippets(page)
    assert found
    for snippet in found:
        exec(compile(snippet, f"{page}.md", "exec"), {})


@pytest.mark.parametrize("page", ["similarity", "alignment", "templates", "second_stage"])
def test_the_python_of_a_page_runs_with_what_it_takes_for_granted(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if page == "second_stage":
        pytest.importorskip("onnxruntime")
    cloud, later = place(1), place(1, visit=1)
    names: dict[str, Any] = {"points": cloud.points, "colors": cloud.colors, "cloud": cloud}
    names |= {"later_points": later.points, "later_colors": later.colors}
    names |= {"stored": build_scene(later.points, later.colors)}
    names |= {"image": np.zeros((240, 416, 3), np.uint8), "many": np.zeros((3, 256), np.float32)}
    monkeypatch.chdir(tmp_path)
    for snippet in snippets(f"stages/views/{page}"):
        exec(compile(snippet, f"{page}.md", "exec"), names)


def test_the_python_of_the_page_of_worlds_runs_with_a_world() -> None:
    pytest.importorskip("embreex")
    room = Path(__file__).parents[2] / "data/worlds/room"
    (snippet,) = snippets("guides/world_files")
    assert "small_house.glb" in snippet
    names: dict[str, object] = {}
    exec(compile(snippet.replace("small_house.glb", str(room)), "worlds.md", "exec"), names)
    assert len(names["floor"]) == 360 and any(names["floor"])
