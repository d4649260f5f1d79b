# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The Python of the pages runs as it is printed."""

import dataclasses
import re
import shutil
from pathlib import Path

import pytest

from bag_maker import drive, write_bag

DOCS = Path(__file__).parents[2] / "docs"
NAMES = {"/points": "/velodyne_points", "/camera/image": "/camera/rgb/image_raw/compressed"}
NAMES["/camera/camera_info"] = "/camera/rgb/camera_info"


def snippets(page: str) -> list[str]:
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


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


@pytest.mark.parametrize("page", ["bags", "sensors", "motion", "fusion"])
def test_the_python_of_a_page_runs_as_it_is_printed(page: str, beside: Path) -> None:
    pytest.importorskip("rosbags")
    found = snippets(page)
    assert found
    for snippet in found:
        exec(compile(snippet, f"{page}.md", "exec"), {})


def test_the_python_of_the_page_of_worlds_runs_with_a_world(beside: Path, test_data: Path) -> None:
    pytest.importorskip("embreex")
    for file in (test_data / "worlds").glob("small_house*"):
        shutil.copy(file, beside)
    (snippet,) = snippets("worlds")
    names: dict[str, object] = {}
    exec(compile(snippet, "worlds.md", "exec"), names)
    assert len(names["floor"]) == 360 and any(names["floor"])  # type: ignore[arg-type, call-overload]
