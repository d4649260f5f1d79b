# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The registry of recognisers: one name each, and one line for a new one."""

import json
from pathlib import Path

import pytest

from cli import fails, succeeds
from fusionslam.config import merged
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import ConfigError
from fusionslam.evaluation import RatSlamRun
from fusionslam.pipelines.methods import METHODS, find_method, method_names
from fusionslam.ros.nodes.view_config import ViewsConfig
from fusionslam.views.descriptor_comparison import DescriptorComparison
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import RECOGNISERS, Recogniser, ViewMatcherConfig
from recordings import write_drive
from rows import rows
from scenes import matcher, place


class HeightComparison(DescriptorComparison):
    """M2DP under another name: the smallest class that recognises places in its own way."""

    def __init__(self, config: ViewMatcherConfig, descriptors: DescriptorConfig) -> None:
        super().__init__("m2dp", descriptors, config.max_distance)
        self.kind = "heights"


@pytest.fixture
def heights(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RECOGNISERS, "heights", Recogniser("heights of clouds", HeightComparison))


@pytest.mark.usefixtures("heights")
def test_a_new_recogniser_works_everywhere(tmp_path: Path) -> None:
    data = write_drive(tmp_path / "drive.npz", step_s=0.5)
    chosen = ("--set", "views.method=heights", "--no-report")
    succeeds("views", "match", data, "-o", tmp_path / "match", *chosen)
    assert len((tmp_path / "match" / "matches.csv").read_text().splitlines()) > 10

    succeeds("bench", "views", data, "-o", tmp_path / "bench", "-m", "heights", "--no-report")
    rows = json.loads((tmp_path / "bench" / "views_bench.json").read_text())["results"]
    assert rows[0]["method"] == rows[0]["title"] == "heights"
    assert rows[0]["paper"]["accuracy"] > 0.5
    assert "heights of clouds" in succeeds("bench", "views", "-m", "list").stdout

    words = ("--views", "heights", "--odometry", "truth", "--no-report")
    succeeds("ratslam", data, "-o", tmp_path / "map", *words)
    assert RatSlamRun.load(tmp_path / "map" / "run.npz").views == "heights"
    assert merged(ViewsConfig(), {"source": "heights"}).source == "heights"


@pytest.mark.usefixtures("heights")
def test_a_matcher_with_a_new_recogniser_is_stored_and_continues(tmp_path: Path) -> None:
    one = matcher(method="heights")
    assert one.process(place(0)).id == 0
    one.save(tmp_path / "views.npz")
    assert ViewMatcher.load(tmp_path / "views.npz").process(place(0)).id == 0


def test_every_method_is_a_recogniser_with_a_preset_or_a_baseline() -> None:
    for name in METHODS:
        recogniser = name.partition(":")[0]
        assert recogniser in RECOGNISERS or find_method(name).title.startswith("no sensor")
    assert set(RECOGNISERS) <= set(method_names())
    assert find_method("objects:paper").title == "objects, paper"


# A name with a preset computes that one, not the robust one.
@rows("name, preset", [("m2dp", "robust"), ("m2dp:paper", "paper"), ("cm2dp:author", "author")])
def test_the_preset_of_a_descriptor_is_the_one_that_is_compared(name: str, preset: str) -> None:
    build = find_method(name).matcher
    assert build is not None and build().descriptor_config.preset == preset


@rows("name", ["shot:paper", "m2dp:papr"])
def test_unknown_presets_are_refused(name: str) -> None:
    with pytest.raises(ConfigError):
        find_method(name)


@rows(
    "right, command",
    [
        ("two_stages", ("ratslam", "DATA", "-o", "OUT", "--views", "two-stage")),
        ("alignment", ("ratslam", "DATA", "-o", "OUT", "--views", "smell")),
        ("objects:author", ("bench", "views", "-o", "OUT", "-m", "first_stage")),
        ("objects", ("config", "--set", "views.method=scenes")),
        ("known: method", ("config", "--set", "views.descriptor=shot")),
    ],
)
def test_commands_refuse_wrong_names(right: str, command: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "x.npz").touch()
    places = {"DATA": tmp_path / "x.npz", "OUT": tmp_path / "out"}
    assert right in fails(2, *(places.get(word, word) for word in command))


def test_a_recogniser_of_images_compares_no_scans() -> None:
    with pytest.raises(ConfigError, match="visual_templates"):
        matcher(method="visual_templates")
