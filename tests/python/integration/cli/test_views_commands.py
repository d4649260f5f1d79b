# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: views record, match and curve, and tune."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from bags import drive as bag_drive
from bags import write_bag
from cli import error_of, fails, last_line, run, succeeds
from fusionslam.evaluation import ViewCurve
from fusionslam.pipelines import tuning
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.presets import preset_names
from fusionslam.views.scene_set import SceneSet
from scenes import LAPS, drive, place, write_recording

QUICK = ("--set", "tuning.population=4", "--set", "tuning.generations=3", "--jobs", "1")


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    drive((*LAPS, -1)).save(tmp_path / "scenes.npz")
    return tmp_path / "scenes.npz"


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


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
    table = rows(tmp_path / "out/matches.csv")
    assert [int(row["id"]) for row in table] == list(LAPS)
    assert table[6]["matched"] == "0" and "matched view 0: similarity" in table[6]["reason"]


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


def test_empty_scans_are_left_out_on_request(scenes: Path, tmp_path: Path) -> None:
    words = ("views", "match", scenes, "-o", tmp_path, "--no-report")
    assert "15 scans" in succeeds(*words).stdout
    assert "14 scans" in succeeds(*words, "--skip-empty").stdout


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


def test_scenes_alone_make_a_small_set_that_is_matched_alike(scenes: Path, tmp_path: Path) -> None:
    small = tmp_path / "small.npz"
    succeeds("views", "record", scenes, "-o", small, "--only-scenes")
    assert small.stat().st_size < scenes.stat().st_size
    for path in (scenes, small):
        succeeds("views", "match", path, "-o", tmp_path / path.stem, "--no-report")
    one, two = (rows(tmp_path / name / "matches.csv") for name in ("scenes", "small"))
    assert [row["id"] for row in one] == [row["id"] for row in two]
    other = ("--set", "views.preset=author")
    assert error_of(1, "views", "match", small, "-o", tmp_path, *other).code == "no-clouds"


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
    right, tried = tuning.Trial.value, 0

    def stopped(self: tuning.Trial, numbers: object) -> float:
        nonlocal tried
        tried += 1
        if tried == 7:
            raise KeyboardInterrupt
        return right(self, numbers)

    with monkeypatch.context() as patch:
        patch.setattr(tuning.Trial, "value", stopped)
        result = run(*words, tmp_path / "parts.yaml")
    assert result.exit_code == 130
    assert not (tmp_path / "parts.yaml").exists() and (tmp_path / "parts.yaml.state").exists()
    succeeds(*words, tmp_path / "parts.yaml")
    whole, parts = (
        yaml.safe_load((tmp_path / f"{name}.yaml").read_text()) for name in ("whole", "parts")
    )
    assert whole == parts


def test_values_that_come_along_are_used_by_name(scenes: Path, tmp_path: Path) -> None:
    words = ("views", "match", scenes, "-o", tmp_path, "--no-report", "--tuned")
    succeeds(*words, preset_names()[0])
    assert "'none'" in fails(2, *words, "none")


def test_a_set_that_is_cut_or_missing_is_named(scenes: Path, tmp_path: Path) -> None:
    scenes.write_bytes(scenes.read_bytes()[:-200])
    assert "scenes.npz" in fails(1, "views", "match", scenes, "-o", tmp_path)
    missing = ("views", "match", tmp_path / "none.npz", "-o", tmp_path)
    assert error_of(1, *missing).code == "no-such-data"
