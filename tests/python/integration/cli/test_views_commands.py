# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: views record, match and curve, and tune."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from bags import drive as bag_drive
from bags import write_bag
from cli import error_of, fails, interrupted_at, last_line, run, settings, succeeds, table
from fusionslam.evaluation import ViewCurve
from fusionslam.pipelines import tuning
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.presets import preset_names
from fusionslam.views.scene_set import SceneSet
from rows import rows
from scenes import LAPS, drive, place, write_recording

QUICK = (*settings("tuning.population=4", "tuning.generations=3"), "--jobs", "1")


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    drive((*LAPS, -1)).save(tmp_path / "scenes.npz")
    return tmp_path / "scenes.npz"


@pytest.fixture
def small(scenes: Path) -> Path:
    """The same scenes, without clouds."""
    path = scenes.with_name("small.npz")
    succeeds("views", "record", scenes, "-o", path, "--only-scenes")
    return path


def test_a_recording_is_recorded_matched_and_judged(tmp_path: Path) -> None:
    write_recording(tmp_path / "r.npz", LAPS)
    words = ("--features", "m2dp", "--set", "recording.frame=odometry")
    text = succeeds("views", "record", tmp_path / "r.npz", "-o", tmp_path / "set", *words).stdout
    assert text == f"{tmp_path / 'set.npz'}: {len(LAPS)} scans, 0 empty\n"
    kept = SceneSet.load(tmp_path / "set.npz")
    assert kept.frame == "odometry" and kept.features["m2dp"].shape == (len(LAPS), 192)
    assert kept.source["path"] == str(tmp_path / "r.npz")
    assert kept.source["command"].split()[0] == "fusionslam"
    words = ("views", "match", tmp_path / "set.npz", "-o", tmp_path / "out", "--no-report")
    # Where odometry begins, no scan was taken.
    assert error_of(1, *words).code == "wrong-frame"
    assert error_of(1, *words, "--set", "views.method=scan_context").code == "wrong-frame"
    again = ("views", "record", tmp_path / "r.npz", "-o", tmp_path / "other")
    again = (*again, "--features", "scan_context", "--set")
    assert error_of(2, *again, "recording.frame=odometry").code == "not-up"
    succeeds(*again, "recording.frame=robot")
    assert SceneSet.load(tmp_path / "other.npz").features["scan_context"].any(axis=1).all()
    result = succeeds(*words, "--set", "views.method=objects")
    assert last_line(result) == str(tmp_path / "out/matches.csv")
    assert "100.0 %" in result.stdout and "new every 3rd" in result.stdout
    assert "14 scans: 8 matched, 6 places, 0 with nothing to recognise" in result.stdout
    matches = table(tmp_path / "out/matches.csv")
    assert [int(row["id"]) for row in matches] == list(LAPS)
    assert matches[6]["matched"] == "0" and "matched view 0: similarity" in matches[6]["reason"]


@pytest.mark.slow
def test_matching_writes_a_page_and_a_matcher_that_goes_on(scenes: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    result = succeeds("views", "match", scenes, "-o", out)
    assert last_line(result) == str(out / "views.html")
    assert "alignment" in (out / "views.html").read_text()
    words = ("-o", tmp_path / "objects", "--set", "views.method=objects")
    succeeds("views", "match", scenes, *words)
    assert "objects robust" in (tmp_path / "objects/views.html").read_text()
    assert "probability" in (out / "matches.csv").read_text()
    figures = json.loads((out / "matches.json").read_text())
    assert figures["stats"]["nothing"] == 1 and figures["stats"]["stored"] == 6
    assert ViewMatcher.load(out / "matcher.npz").process(place(3, 9)).id == 3


def test_a_set_without_poses_is_matched_but_not_judged_or_tuned(tmp_path: Path) -> None:
    path = tmp_path / "plain.npz"
    drive(LAPS, poses=False).save(path)
    text = succeeds("views", "match", path, "-o", tmp_path / "out").stdout
    assert "--gt" in text and "accuracy" not in text
    for words in (("views", "curve", path, "-o", tmp_path), ("tune", path, "-o", tmp_path / "b")):
        assert error_of(1, *words).code == "no-poses"


def test_a_curve_names_the_best_thresholds(scenes: Path, tmp_path: Path) -> None:
    for more in ((), ("--set", "views.method=cm2dp")):
        result = succeeds("views", "curve", scenes, "-o", tmp_path, *more)
        assert "new every 3rd" in result.stdout
        assert last_line(result) == str(tmp_path / "curve.json")
        curve = ViewCurve.load(tmp_path / "curve.json")
        best = curve.best_threshold(0.97)
        assert best is not None and f"{best:.4g}" in result.stdout
        assert curve.at(best)["loop_recall"] == 1


@rows("method", ["alignment", "objects"])
def test_scenes_alone_make_a_small_set_that_is_matched_alike(
    method: str, scenes: Path, small: Path, tmp_path: Path
) -> None:
    assert small.stat().st_size < scenes.stat().st_size
    ids = []
    for path in (scenes, small):
        chosen = ("--set", f"views.method={method}", "--no-report")
        succeeds("views", "match", path, "-o", tmp_path / path.stem, *chosen)
        ids.append([row["id"] for row in table(tmp_path / path.stem / "matches.csv")])
    assert ids[0] == ids[1] and ids[0][0] == "0"


@rows(
    "setting, kind",
    [
        ("views.method=cm2dp", "cm2dp"),
        ("views.preset=author", "objects"),
        ("views.second_stage=places", "two_stage"),
    ],
)
def test_a_set_without_clouds_says_so(setting: str, kind: str, small: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    error = error_of(1, "views", "match", small, "-o", tmp_path / "out", "--set", setting)
    assert error.code == "no-clouds" and error.fields[0].startswith(kind)


def test_a_bag_becomes_a_scene_set_in_the_robots_frame(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    write_bag(tmp_path / "drive.bag", bag_drive())
    words = ("--set", "fusion.ground=none")
    succeeds("views", "record", tmp_path / "drive.bag", "-o", tmp_path / "set.npz", *words)
    kept = SceneSet.load(tmp_path / "set.npz")
    assert kept.frame == "robot" and len(kept) and not kept.empty.any()
    assert np.all(np.diff(kept.stamps_ns) > 0)


def test_tuning_writes_yaml_that_match_reads(scenes: Path, tmp_path: Path) -> None:
    pytest.importorskip("pymoo")
    best = tmp_path / "best.yaml"
    result = succeeds("tune", scenes, "-o", best, "--set", "views.preset=author", *QUICK)
    assert "new every 3rd" in result.stdout
    assert last_line(result).startswith(f"{best}: value 0.") and "accuracy" in result.stdout
    values = yaml.safe_load(best.read_text())["views"]
    words = ("views", "match", scenes, "-o", tmp_path / "out", "--no-report")
    succeeds(*words, "--config", best)
    figures = json.loads((tmp_path / "out/matches.json").read_text())
    assert figures["threshold"] == values["threshold"]
    assert figures["views"]["similarity"]["color_x0"] == values["similarity"]["color_x0"]
    succeeds(*words, "--config", best, "--set", "views.threshold=0.5")
    assert json.loads((tmp_path / "out/matches.json").read_text())["threshold"] == 0.5


def test_an_interrupted_tuning_says_where_it_goes_on_and_ends_alike(
    scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pymoo")
    words = ("tune", scenes, "--set", "views.preset=author", *QUICK, "-o")
    succeeds(*words, tmp_path / "whole.yaml")
    with monkeypatch.context() as patch:
        patch.setattr(tuning.Trial, "value", interrupted_at(6, tuning.Trial.value))
        result = run(*words, tmp_path / "parts.yaml")
    assert result.exit_code == 130
    assert not (tmp_path / "parts.yaml").exists() and (tmp_path / "parts.yaml.state").exists()
    succeeds(*words, tmp_path / "parts.yaml")
    whole, parts = (
        yaml.safe_load((tmp_path / f"{name}.yaml").read_text()) for name in ("whole", "parts")
    )
    assert whole == parts


def test_tuned_values_are_taken_and_empty_scans_left_out(scenes: Path, tmp_path: Path) -> None:
    words = ("views", "match", scenes, "-o", tmp_path, "--no-report")
    succeeds(*words, "--tuned", preset_names()[0])
    assert "'none'" in fails(2, *words, "--tuned", "none")
    assert "15 scans" in succeeds(*words).stdout
    assert "14 scans" in succeeds(*words, "--skip-empty").stdout


def test_a_set_that_is_cut_or_missing_is_named(scenes: Path, tmp_path: Path) -> None:
    whole = scenes.read_bytes()
    for words in (("views", "match"), ("views", "curve"), ("tune",)):
        for size in (0, 10, 2000, len(whole) - 200):
            scenes.write_bytes(whole[:size])
            assert "scenes.npz" in fails(1, *words, scenes, "-o", tmp_path / "out")
    missing = ("views", "match", tmp_path / "none.npz", "-o", tmp_path)
    assert error_of(1, *missing).code == "no-such-data"


@rows("option, value", [("--gt", "poses.txt"), ("--kind", "folder"), ("--sequence", "07")])
def test_useless_options_are_refused(option: str, value: str, scenes: Path, tmp_path: Path) -> None:
    ranges = tmp_path / "ranges.npz"
    write_recording(ranges, LAPS)
    for data in (scenes, ranges):
        for command in ("match", "curve", "record"):
            line = fails(2, "views", command, data, "-o", tmp_path / "out", option, value)
            assert option in line and str(data) in line


def test_a_missing_extra_is_told_before_the_work_and_only_where_it_is_needed(
    scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.cli.failures.find_spec", lambda name: None)
    plain, out = tmp_path / "plain.npz", tmp_path / "out"
    drive(LAPS, poses=False).save(plain)
    assert error_of(1, "views", "match", scenes, "-o", out).fields == ("report",)
    assert not (out / "matches.csv").exists()
    succeeds("views", "match", scenes, "-o", out, "--no-report")
    succeeds("views", "match", plain, "-o", out)
