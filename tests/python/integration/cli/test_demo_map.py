# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The map that the demo ends with."""

import importlib.util
import json
import re
from pathlib import Path

import pytest

from cli import TINY_TOWN, error_of, last_line, settings, succeeds
from fusionslam import PlaceMap
from streets import OPTIONS, WAY, frames

pytest.importorskip("embreex", reason="the demo simulates a drive")
pytest.importorskip("matplotlib", reason="pages are an extra")

SETTINGS = settings(*TINY_TOWN)


@pytest.mark.slow
def test_the_demo_ends_with_a_map(tmp_path: Path) -> None:
    pytest.importorskip("gtsam")
    first = succeeds("demo", "-o", tmp_path, *SETTINGS)
    found = re.search(r"ATE of demo: (\S+) m, of odometry alone (\S+) m", first.stdout)
    assert found is not None and all(float(number) >= 0 for number in found.groups())
    assert "true poses with errors" in first.stdout
    assert last_line(first) == str(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    lead = page[: page.index("source / descriptor")]
    assert '<a href="map.html">' in lead and "<img" in lead
    assert all(f"<td>{number} m</td>" in lead for number in found.groups())
    assert "Odometry is made" in (tmp_path / "map.html").read_text()
    with PlaceMap.open(tmp_path / "map.fsmap", read_only=True) as site:
        (session,) = site.sessions
        config = site.config
    assert session.name == "demo" and config["mapping"]["keyframe_distance"] == 5.0

    stored = json.loads((tmp_path / "run.json").read_text())["configs"]
    assert (stored["stereo"]["fusion"]["voxel"], stored["lidar"]["fusion"]["voxel"]) == (0.2, 0)

    before = (tmp_path / "map.fsmap").read_bytes()
    driven = (tmp_path / "drive/sim.json").stat().st_mtime_ns
    again = succeeds("demo", "-o", tmp_path, *SETTINGS)
    assert last_line(again) == last_line(first)
    assert (tmp_path / "map.fsmap").read_bytes() == before
    assert (tmp_path / "drive/sim.json").stat().st_mtime_ns == driven
    succeeds("report", tmp_path)
    assert '<a href="map.html">' in (tmp_path / "report.html").read_text()

    other = ("--set", "loop_closure.candidates=3")
    succeeds("demo", "-o", tmp_path, "--no-report", *SETTINGS, *other)
    assert not (tmp_path / "map.html").exists()
    with PlaceMap.open(tmp_path / "map.fsmap", read_only=True) as site:
        assert [each.name for each in site.sessions] == ["demo"]
        assert site.config["loop_closure"]["candidates"] == 3


@pytest.mark.slow
def test_the_demo_leaves_other_maps_alone(tmp_path: Path) -> None:
    pytest.importorskip("gtsam")
    with PlaceMap.open(tmp_path / "map.fsmap", "monday", **OPTIONS) as site:
        site.add(frames(WAY)[0])
    before = (tmp_path / "map.fsmap").read_bytes()
    assert error_of(1, "demo", "-o", tmp_path, *SETTINGS).code == "other-results"
    assert (tmp_path / "map.fsmap").read_bytes() == before


@pytest.mark.slow
def test_without_the_extra_the_demo_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "fusionslam.cli.failures.find_spec",
        lambda name: None if name == "gtsam" else find(name),
    )
    (tmp_path / "map.html").write_text("of an earlier demo")
    out = succeeds("demo", "-o", tmp_path, *SETTINGS).stdout
    assert "no map of the drive" in out and "fusionslam[map]" in out
    assert "map.html" not in (tmp_path / "report.html").read_text()
