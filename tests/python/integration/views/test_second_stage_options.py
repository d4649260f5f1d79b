# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A second stage named in the configuration: values, files, and what is saved."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import succeeds
from fusionslam.config import merged
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.views import run_views, sweep_thresholds
from fusionslam.sensors.frame import Cloud
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.object_comparison import ObjectComparison
from fusionslam.views.recognisers import ViewMatcherConfig, scene_config, similarity_config
from fusionslam.views.second_stage import SecondStage
from fusionslam.views.second_stage.network_files import SHIPPED
from fusionslam.views.two_stage_comparison import TwoStageComparison
from refusals import refuses
from rows import rows
from scenes import LAPS, NOTHING, drive, place
from stored import change_archive

pytest.importorskip("onnxruntime")
ALL_ALIKE: dict[str, Any] = {"method": "objects", "threshold": 0.0}
"""A first stage to which everything is the same place."""
OURS = {"method": "objects", "preset": "robust", "second_stage": "places"}


def config(**values: Any) -> ViewMatcherConfig:
    return merged(ViewMatcherConfig(), values)


def ids(one: ViewMatcher) -> list[int]:
    return run_views(drive(LAPS), one).ids.tolist()


@rows("model", ["places", "thesis"])
def test_the_second_stage_named_is_the_one_given_by_hand(model: str) -> None:
    values = config(**ALL_ALIKE, second_stage=model, second_threshold=0.8)
    first = ObjectComparison(scene_config(values), similarity_config(values), 0.0)
    both = TwoStageComparison(first, SecondStage(model), threshold=0.8, start=0.0)
    named, given = ViewMatcher(values), ViewMatcher(config(**ALL_ALIKE), comparison=both)
    assert run_views(drive(LAPS), named).matches == run_views(drive(LAPS), given).matches
    assert len(set(ids(ViewMatcher(config(**ALL_ALIKE))))) == 1 < named.stats.new


def test_a_rejected_view_is_no_match_even_where_every_similarity_is_one() -> None:
    one = ViewMatcher(config(**ALL_ALIKE, second_stage="places", second_threshold=1.0))
    first, second = one.process(place(0)), one.process(place(5))
    assert (first.id, second.id) == (0, 1)


def test_every_match_passes_both_unless_a_start_is_named() -> None:
    strict = {**ALL_ALIKE, "second_stage": "places", "second_threshold": 1.0}
    assert ViewMatcher(config(**strict)).process(place(0)).id == 0
    asked, unasked = (ViewMatcher(config(**strict, **more)) for more in ({}, {"second_start": 1.0}))
    for one in (asked, unasked):
        one.process(place(0))
    # Below the start no second opinion is needed.
    assert (asked.process(place(5)).id, unasked.process(place(5)).id) == (1, 0)


@rows("method", ["objects", "alignment", "cm2dp"])
def test_each_method_goes_on_from_a_file_with_its_second_stage(method: str, tmp_path: Path) -> None:
    values = {**OURS, "method": method, "max_views": 4}
    scenes = drive((*LAPS, -1, 6, 0))
    whole = run_views(scenes, ViewMatcher(config(**values)))
    one, found = ViewMatcher(config(**values)), []
    for half in np.array_split(np.arange(len(scenes)), 2):
        found += list(run_views(scenes.subset(half), one).matches)
        one.save(tmp_path / "views")
        one = ViewMatcher.load(tmp_path / "views")
    assert found == list(whole.matches) and one.stats == whole.stats
    assert one.config == config(**values) and one.stats.nothing == 1


@rows("preset, network", [("robust", "places"), ("author", "thesis")])
def test_the_second_stage_of_a_preset_is_stored_by_name(
    preset: str, network: str, tmp_path: Path
) -> None:
    one = ViewMatcher(config(method="two_stages", preset=preset))
    one.save(tmp_path / "views")
    with np.load(tmp_path / "views") as stored:
        assert json.loads(str(stored["about"]))["views"]["second_stage"] == network
    assert ViewMatcher.load(tmp_path / "views").config == one.config


def test_features_of_another_network_are_refused_when_loaded(tmp_path: Path) -> None:
    one = ViewMatcher(config(**OURS))
    one.process(place(0))
    one.save(tmp_path / "views")
    for features, message in (
        (np.zeros((1, 7), np.float32), r"\(256,\)"),
        (np.zeros((2, 256), np.float32), "2 .* 1 "),
        (np.full((1, 256), np.nan, np.float32), "not finite"),
    ):
        change_archive(tmp_path / "views", **{"state.features": features})
        with pytest.raises(DataError, match=message):
            ViewMatcher.load(tmp_path / "views")


@rows(
    "values",
    [{"second_threshold": 1.5}, {"second_start": -0.1}, {"second_threshold": float("nan")}],
)
def test_values_out_of_range_are_refused_by_name(values: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(values))):
        config(second_stage="places", **values)


def test_two_stages_need_scans_with_objects() -> None:
    with pytest.raises(ConfigError, match="min_objects"):
        config(second_stage="places", min_objects=0)


def test_scans_without_objects_cannot_be_stored_by_two_stages() -> None:
    both = ViewMatcher(config(**OURS)).comparison
    with pytest.raises(DataError, match="min_objects"):
        ViewMatcher(config(**ALL_ALIKE, min_objects=0), comparison=both).process(NOTHING)


def test_files_that_are_missing_cut_or_of_another_kind_are_refused(tmp_path: Path) -> None:
    features, comparison = SHIPPED / "thesis_features.onnx", SHIPPED / "thesis_comparison.onnx"
    cut = tmp_path / "cut.onnx"
    cut.write_bytes(features.read_bytes()[:1000])
    for path, message in (
        (tmp_path / "none.onnx", "none.onnx"),
        (cut, "cut.onnx"),
        (comparison, "pointnet"),
        (features, "calibration"),
        ("place", "places, thesis"),
    ):
        with pytest.raises(DataError, match=message):
            ViewMatcher(config(second_stage=str(path)))
    both = config(**ALL_ALIKE, second_stage=str(features), second_comparison=str(comparison))
    assert ids(ViewMatcher(both)) == ids(ViewMatcher(config(**ALL_ALIKE, second_stage="thesis")))


def test_clouds_without_colours_are_refused_before_anything_is_stored() -> None:
    one = ViewMatcher(config(method="objects", second_stage="places"))
    with refuses("no-colors"):
        one.process(Cloud(place(0).points))
    assert len(one) == 0 and one.stats.processed == 0


def test_thresholds_of_two_stages_are_swept_as_those_of_the_first() -> None:
    found = sweep_thresholds(drive(LAPS), config(**OURS))
    assert found.thresholds.tolist() == [number / 100 for number in range(101)]


def test_the_command_line_and_files_name_a_second_stage(tmp_path: Path) -> None:
    drive(LAPS).save(tmp_path / "set.npz")
    (tmp_path / "both.yaml").write_text(
        "views:\n  method: objects\n  second_stage: places\n  second_threshold: 0.9\n"
    )
    by_file = ["--config", tmp_path / "both.yaml"]
    by_hand = ["--set", "views.method=objects", "--set", "views.second_stage=places"]
    by_hand += ["--set", "views.second_threshold=0.9"]
    for name, chosen in (("file", by_file), ("hand", by_hand)):
        succeeds(
            "views", "match", tmp_path / "set.npz", "-o", tmp_path / name, "--no-report", *chosen
        )
    made = [(tmp_path / name / "matches.csv").read_text() for name in ("file", "hand")]
    assert made[0] == made[1]
    values = json.loads((tmp_path / "hand" / "matches.json").read_text())["views"]
    assert values["second_stage"] == "places"
    loaded = ViewMatcher.load(tmp_path / "hand" / "matcher.npz")
    assert loaded.comparison.kind == "two_stage.objects" and loaded.stats.processed == len(LAPS)
