# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: ratslam, what it writes, going on, and what it says to mistakes."""

import json
from pathlib import Path

import numpy as np
import pytest

from artefacts import artefact
from bags import drive, write_bag
from cli import (
    error_of,
    fails,
    interrupted_at,
    last_line,
    refusal,
    run,
    settings,
    succeeds,
)
from fusionslam.base.archive import save_archive
from fusionslam.datasets import write_cloud
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.pipelines.maps import RunRecorder
from fusionslam.ratslam import GivenView, Look, Motion, OnlineRatSlam, RatSlam
from fusionslam.sensors.frame import Cloud
from recordings import write_drive
from rows import rows

WRITTEN = (
    "dead_reckoning.txt",
    "map.g2o",
    "map.graphml",
    "map.json",
    "map_report.json",
    "run.npz",
    "trajectory.txt",
    "trajectory_live.txt",
    "truth.txt",
)
QUICK = ("--no-report", "--jobs", "1")
TEMPLATES = settings(
    *(f"visual_templates.{text}" for text in ("columns=16", "rows=8", "bottom=null"))
)


@pytest.fixture(scope="module")
def recording() -> Path:
    return artefact("cli-drive", lambda folder: write_drive(folder / "drive.npz")) / "drive.npz"


@pytest.fixture(scope="module")
def bag() -> Path:
    pytest.importorskip("rosbags")
    made = artefact("cli-bag", lambda folder: write_bag(folder / "drive.bag", drive(4.0)))
    return made / "drive.bag"


def files(folder: Path) -> dict[str, bytes]:
    """All that was written, but for the run itself, which holds times."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix != ".npz"}


@pytest.mark.slow
def test_a_recording_becomes_a_map_its_figures_and_a_page(recording: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    result = succeeds("ratslam", recording, "--views", "objects", "-o", tmp_path, "--jobs", "1")
    names = {path.name for path in tmp_path.iterdir()}
    assert {*WRITTEN, "ratslam.html"} <= names and last_line(result).endswith("ratslam.html")
    page = (tmp_path / "ratslam.html").read_text()
    assert "objects robust" in page and "fusionslam" in page
    run_of = RatSlamRun.load(tmp_path / "run.npz")
    figures = json.loads((tmp_path / "map.json").read_text())
    assert len(figures["nodes"]) == len(run_of.nodes) > 5


@pytest.mark.nightly
def test_only_the_same_seed_writes_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    noise = ("--odometry", "truth+noise", "--set", "odometry.speed_noise=0.05")
    words = ("ratslam", recording, "--views", "objects", *noise, *QUICK)
    for name, seed in (("one", 1), ("again", 1), ("other", 2)):
        succeeds(*words, "--seed", seed, "-o", tmp_path / name)
    one, again, other = (files(tmp_path / name) for name in ("one", "again", "other"))
    assert one == again
    assert one["trajectory.txt"] != other["trajectory.txt"]


@pytest.mark.parametrize(
    ("views", "preset"),
    [
        ("cm2dp", "openratslam"),
        ("two_stages", "robust"),
        *(
            pytest.param(views, preset, marks=pytest.mark.nightly)
            for views in ("alignment", "objects")
            for preset in ("robust", "openratslam")
        ),
    ],
)
def test_every_way_to_recognise_places_makes_a_map(
    recording: Path, tmp_path: Path, views: str, preset: str
) -> None:
    if views == "two_stages":
        pytest.importorskip("onnxruntime")
    words = ("--views", views, "--preset", preset, "--odometry", "truth+noise")
    succeeds("ratslam", recording, *words, "-o", tmp_path, *QUICK)
    made = RatSlamRun.load(tmp_path / "run.npz")
    assert made.preset == preset and len(made.nodes) > 3
    assert made.view_ids.max() > 3


@rows("odometry", ["topic", "visual"])
def test_a_bag_is_mapped_by_its_images(bag: Path, tmp_path: Path, odometry: str) -> None:
    words = ("--views", "visual_templates", "--odometry", odometry, *TEMPLATES)
    succeeds("ratslam", bag, *words, "-o", tmp_path, *QUICK)
    assert not (tmp_path / "truth.txt").exists()
    made = RatSlamRun.load(tmp_path / "run.npz")
    assert np.count_nonzero(made.is_view) == 41
    expected = {"topic": "topic /odom", "visual": "visual odometry (robust)"}
    assert made.odometry == expected[odometry]
    # A camera's odometry strays farther than that of wheels, and the map is told so.
    drift = made.config["map"]["drift_m"]
    assert (drift > 0.1) == (odometry == "visual")


def test_what_is_set_of_drift_counts_with_a_camera_alone_too(bag: Path, tmp_path: Path) -> None:
    words = ("--views", "visual_templates", "--odometry", "visual")
    words += ("--set", "ratslam.map.drift_m=0.11")
    succeeds("ratslam", bag, *words, *TEMPLATES, "-o", tmp_path, *QUICK)
    config = RatSlamRun.load(tmp_path / "run.npz").config["map"]
    assert config["drift_m"] == 0.11 and config["drift_heading"] == 0.03


@rows(
    "lacking, code, advice",
    [
        (("/odom",), "no-motion", "--odometry visual"),
        (("/odom", "/camera/image"), "no-motion", None),
        (("/points",), "no-clouds", "--views visual_templates"),
    ],
)
def test_a_bag_that_lacks_something_is_told_what_serves(
    lacking: tuple[str, ...], code: str, advice: str | None, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    write_bag(tmp_path / "a.bag", [one for one in drive(1.0) if one.topic not in lacking])
    words = ("ratslam", tmp_path / "a.bag", "-o", tmp_path / "out", *QUICK)
    error = error_of(1, *words)
    assert error.code == code
    assert advice in str(error) if advice else "--odometry visual" not in str(error)
    if code == "no-clouds":
        succeeds(*words, "--views", "visual_templates", *TEMPLATES)


@pytest.mark.slow
def test_a_run_that_is_interrupted_and_resumed_equals_the_uninterrupted_one(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("ratslam", recording, "--views", "objects", "--odometry", "truth+noise", *QUICK)
    succeeds(*words, "-o", tmp_path / "whole")
    with monkeypatch.context() as patch:
        patch.setattr(RunRecorder, "step", interrupted_at(700, RunRecorder.step))
        result = run(*words, "-o", tmp_path / "parts")
    state = tmp_path / "parts/state.npz"
    assert result.exit_code == 130
    assert f"--resume {state}" in " ".join(result.stderr.split())
    assert len(RatSlamRun.load(tmp_path / "parts/run.npz")) == 700
    resumed = ("ratslam", recording, "--odometry", "truth+noise", "--resume", state, *QUICK)
    succeeds(*resumed, "-o", tmp_path / "parts", "--save", tmp_path / "end.npz")
    assert files(tmp_path / "parts") == files(tmp_path / "whole")
    assert len(RatSlam.load(tmp_path / "end.npz").map.nodes) > 5
    again = (*resumed[:-2], *QUICK, "--resume", tmp_path / "end.npz", "-o", tmp_path)
    assert error_of(1, *again).code == "nothing-later"


def test_ctrl_c_after_the_last_step_keeps_all_and_before_the_first_nothing(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.cli.ratslam_run.judge_map", interrupted_at(0))
    out, state = tmp_path / "out", tmp_path / "state.npz"
    result = run("ratslam", recording, "--views", "objects", "-o", out, "--save", state, *QUICK)
    assert result.exit_code == 130
    said = " ".join(result.stderr.split())
    assert str(out) in said and str(state) in said
    assert len(RatSlamRun.load(out / "run.npz")) and (out / "map.json").exists()
    assert RatSlam.load(state).seen_ns[0] is not None
    monkeypatch.setattr(RunRecorder, "step", interrupted_at(0))
    result = run("ratslam", recording, "--views", "objects", "-o", tmp_path / "none", *QUICK)
    assert result.exit_code == 130 and not (tmp_path / "none").exists()


@rows(
    "code, words",
    [(2, ("--views", "none")), (2, ("--seed", "-1")), (1, ("--odometry", "topic"))],
)
def test_a_mistake_leaves_no_folder(
    recording: Path, tmp_path: Path, code: int, words: tuple[str, ...]
) -> None:
    fails(code, "ratslam", recording, *words, "-o", tmp_path / "out", *QUICK)
    assert not (tmp_path / "out").exists()


def test_a_state_says_how_its_map_is_made(recording: Path, tmp_path: Path) -> None:
    words = ("ratslam", recording, "-o", tmp_path / "out", *QUICK)
    succeeds(*words, "--views", "objects", "--save", tmp_path / "s.npz")
    other = (("--views", "cm2dp"), ("--preset", "openratslam"), ("--set", "views.preset=author"))
    for more in other:
        assert error_of(2, *words, "--resume", tmp_path / "s.npz", *more).code == "set-by-state"


def test_a_file_that_is_no_state_is_refused(recording: Path, bag: Path, tmp_path: Path) -> None:
    save_archive(tmp_path / "run.npz", "fusionslam.ratslam_run.1", {}, {})
    (tmp_path / "text.npz").write_text("no archive")
    (tmp_path / "site.fsmap").write_bytes(b"SQLite format 3\0" + bytes(100))
    kinds = {
        recording: "ranges",
        bag: "rosbag1",
        tmp_path / "run.npz": "fusionslam.ratslam_run.1",
        tmp_path / "site.fsmap": "map",
    }
    words = ("ratslam", recording, "-o", tmp_path / "out", *QUICK)
    for path, kind in kinds.items():
        assert refusal(1, *words, "--resume", path) == ("no-state", str(path), kind)
    for name in ("text.npz", "missing.npz"):
        assert name in fails(1, *words, "--resume", tmp_path / name)
    assert not (tmp_path / "out").exists()


def test_a_map_with_views_of_another_process_is_refused(recording: Path, tmp_path: Path) -> None:
    online = OnlineRatSlam()
    online.process(Motion(0, 0.5, 0.0))
    online.process(Look(0, GivenView(0, True)))
    online.save(tmp_path / "node.npz")
    RatSlam().save(tmp_path / "own.npz")
    for name in ("node.npz", "own.npz"):
        words = ("ratslam", recording, "-o", tmp_path / "out", *QUICK)
        error = error_of(1, *words, "--resume", tmp_path / name)
        assert (error.code, error.fields) == ("given-views", (str(tmp_path / name),))


def test_an_output_that_is_a_file_is_said_before_anything_is_done(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("kept")

    monkeypatch.setattr(RunRecorder, "step", pytest.fail)
    # Nothing can be made in /proc, whoever asks.
    outputs = [tmp_path / "file", Path("/dev/null"), Path("/proc")]
    for folder in [*outputs, *(output / "below" for output in outputs)]:
        error = error_of(1, "ratslam", recording, "-o", folder, *QUICK)
        assert error.code == "cannot-write" and error.fields == (str(folder),)
    assert (tmp_path / "file").read_text() == "kept"


def test_data_that_is_refused_leaves_only_folders_that_were_there(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    for output in (tmp_path / "there", tmp_path / "there/new/newer", tmp_path / "new"):
        assert "nowhere.npz" in fails(1, "ratslam", tmp_path / "nowhere.npz", "-o", output, *QUICK)
        assert [one.name for one in tmp_path.rglob("*")] == ["there"]


def test_scans_without_motion_name_odometry_by_lidar(tmp_path: Path) -> None:
    write_cloud(tmp_path / "clouds/000000.bin", Cloud(np.eye(3, dtype=np.float32)))
    error = error_of(1, "ratslam", tmp_path, "--views", "m2dp", "-o", tmp_path / "out", *QUICK)
    assert error.code == "no-motion" and "--odometry lidar" in str(error)
