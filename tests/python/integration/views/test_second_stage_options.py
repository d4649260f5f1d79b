# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A second stage named in the configuration: values, files, and what is saved."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cli import settings, succeeds
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.views import run_views, sweep_thresholds
from fusionslam.sensors.frame import Cloud
from fusionslam.views.comparison import ObjectComparison
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import scene_config, similarity_config
from fusionslam.views.second_stage import SecondStage
from fusionslam.views.second_stage.network_files import SHIPPED
from fusionslam.views.two_stage_comparison import TwoStageComparison
from refusals import refuses
from rows import rows
from scenes import LAPS, NOTHING, check_going_on, config_of, drive, matcher, place
from stored import change_archive

pytest.importorskip("onnxruntime")
ALL_ALIKE: dict[str, Any] = {"method": "objects", "threshold": 0.0}
"""A first stage to which everything is the same place."""
OURS = {"method": "objects", "preset": "robust", "second_stage": "places"}


def ids(**values: Any) -> list[int]:
    return run_views(drive(LAPS), matcher(**values)).ids.tolist()


@rows("model", ["places", "thesis"])
def test_the_second_stage_named_is_the_one_given_by_hand(model: str) -> None:
    values = config_of(**ALL_ALIKE, second_stage=model, second_threshold=0.8)
    first = ObjectComparison(scene_config(values), similarity_config(values), 0.0)
    both = TwoStageComparison(first, SecondStage(model), threshold=0.8, start=0.0)
    named, given = ViewMatcher(values), ViewMatcher(config_of(**ALL_ALIKE), comparison=both)
    assert run_views(drive(LAPS), named).matches == run_views(drive(LAPS), given).matches
    assert len(set(ids(**ALL_ALIKE))) == 1 < named.stats.new


# Below the start no second opinion is needed.
@rows("more, expected", [({}, [0, 1]), ({"second_start": 1.0}, [0, 0])])
def test_every_match_passes_both_from_the_start_on(more: Any, expected: list[int]) -> None:
    one = matcher(**ALL_ALIKE, second_stage="places", second_threshold=1.0, **more)
    assert [one.process(place(number)).id for number in (0, 5)] == expected


@rows("method", ["objects", "alignment", "cm2dp"])
def test_each_method_goes_on_from_a_file_with_its_second_stage(method: str, tmp_path: Path) -> None:
    values = {**OURS, "method": method, "max_views": 3}
    one = check_going_on(drive((0, 1, 2, 3, 0, 1, -1, 6, 0)), tmp_path / "views", **values)
    assert one.config == config_of(**values) and one.stats.nothing == 1


@rows("preset, network", [("robust", "places"), ("author", "thesis")])
def test_a_preset_s_second_stage_is_stored(preset: str, network: str, tmp_path: Path) -> None:
    one = matcher(method="two_stages", preset=preset)
    one.save(tmp_path / "views")
    with np.load(tmp_path / "views") as stored:
        assert json.loads(str(stored["about"]))["views"]["second_stage"] == network
    assert ViewMatcher.load(tmp_path / "views").config == one.config


@rows(
    "features, message",
    [
        (np.zeros((1, 7), np.float32), r"\(256,\)"),
        (np.zeros((2, 256), np.float32), "2 .* 1 "),
        (np.full((1, 256), np.nan, np.float32), "not finite"),
    ],
)
def test_features_of_another_network_are_refused(
    features: NDArray[np.float32], message: str, tmp_path: Path
) -> None:
    one = matcher(**OURS)
    one.process(place(0))
    one.save(tmp_path / "views")
    change_archive(tmp_path / "views", **{"state.features": features})
    with pytest.raises(DataError, match=message):
        ViewMatcher.load(tmp_path / "views")


@rows(
    "name, value",
    [
        ("second_threshold", 1.5),
        ("second_start", -0.1),
        ("second_threshold", float("nan")),
        ("min_objects", 0),  # two stages need scans with objects
    ],
)
def test_values_out_of_range_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=name):
        config_of(second_stage="places", **{name: value})


def test_scans_without_objects_cannot_be_stored_by_two_stages() -> None:
    first_stage = config_of(**ALL_ALIKE, min_objects=0)
    with pytest.raises(DataError, match="min_objects"):
        ViewMatcher(first_stage, comparison=matcher(**OURS).comparison).process(NOTHING)


@rows(
    "name, message",
    [
        ("none.onnx", "none.onnx"),
        ("cut.onnx", "cut.onnx"),
        ("thesis_comparison.onnx", "pointnet"),
        ("thesis_features.onnx", "calibration"),
    ],
)
def test_files_of_no_network_are_refused(name: str, message: str, tmp_path: Path) -> None:
    for path in SHIPPED.glob("thesis*"):
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "cut.onnx").write_bytes((SHIPPED / "thesis_features.onnx").read_bytes()[:1000])
    with pytest.raises(DataError, match=message):
        matcher(second_stage=str(tmp_path / name))


def test_unknown_networks_are_refused_and_files_of_known_ones_taken() -> None:
    with pytest.raises(DataError, match="places, thesis"):
        matcher(second_stage="place")
    names = ("second_stage", "second_comparison")
    files = [str(SHIPPED / f"thesis_{part}.onnx") for part in ("features", "comparison")]
    by_files = dict(zip(names, files, strict=True))
    assert ids(**ALL_ALIKE, **by_files) == ids(**ALL_ALIKE, second_stage="thesis")


def test_clouds_without_colours_are_refused_before_anything_is_stored() -> None:
    one = matcher(method="objects", second_stage="places")
    with refuses("no-colors"):
        one.process(Cloud(place(0).points))
    assert len(one) == 0 and one.stats.processed == 0


def test_thresholds_of_two_stages_are_swept_as_those_of_the_first() -> None:
    found = sweep_thresholds(drive((0, 1, 0, 2)), config_of(**OURS))
    assert found.thresholds.tolist() == [number / 100 for number in range(101)]


def test_the_command_line_and_files_name_a_second_stage(tmp_path: Path) -> None:
    drive(LAPS).save(tmp_path / "set.npz")
    (tmp_path / "both.yaml").write_text(
        "views:\n  method: objects\n  second_stage: places\n  second_threshold: 0.9\n"
    )
    by_hand = ("method=objects", "second_stage=places", "second_threshold=0.9")
    for name, chosen in (
        ("file", ["--config", tmp_path / "both.yaml"]),
        ("hand", settings(*(f"views.{value}" for value in by_hand))),
    ):
        out = ("-o", tmp_path / name, "--no-report")
        succeeds("views", "match", tmp_path / "set.npz", *out, *chosen)
    made = [(tmp_path / name / "matches.csv").read_text() for name in ("file", "hand")]
    assert made[0] == made[1]
    values = json.loads((tmp_path / "hand" / "matches.json").read_text())["views"]
    assert values["second_stage"] == "places"
    loaded = ViewMatcher.load(tmp_path / "hand" / "matcher.npz")
    assert loaded.comparison.kind == "two_stage.objects" and loaded.stats.processed == len(LAPS)
