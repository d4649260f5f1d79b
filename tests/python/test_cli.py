# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: what each command writes, what it says when it cannot, and how it resumes."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
import yaml
from typer.testing import CliRunner, Result

import fusionslam
from fusionslam import pipeline
from fusionslam.bench import stored_evaluations
from fusionslam.cli import app
from fusionslam.datasets import write_cloud
from fusionslam.evaluation import DescriptorRun, EvaluationConfig
from fusionslam.pipeline import CHUNK
from fusionslam.sensors import Cloud, Frame
from fusionslam.workspace import Recording, Work, forget_demo
from tiny_kitti import write_sequence

FRAMES = CHUNK + 4
NO_WINDOW = ("--set", "evaluation.window=2", "--set", "loop_closure.window=2")
TINY_TOWN = (
    "sim.town.blocks=[1,1]",
    "sim.town.block_m=44",
    "sim.drive.laps=[[[0,0],[1,0]],[[1,0],[1,1]]]",
    "sim.drive.spacing_m=14",
    "sim.car.lidar.rings=16",
    "sim.car.lidar.azimuths=180",
    "sim.car.camera.width=160",
    "sim.car.camera.height=48",
    "sim.car.camera.focal_px=92",
    "sim.car.camera.centre_px=[79,23.5]",
)


@pytest.fixture(scope="session")
def kitti(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive along z and back to its start, in KITTI odometry's layout, colours and all."""
    places = [min(n, FRAMES - n) for n in range(FRAMES)]
    base = tmp_path_factory.mktemp("kitti")
    return write_sequence(base, places, [500] * FRAMES, metres=20, width=128)


@pytest.fixture
def recording(kitti: Path, tmp_path: Path) -> Path:
    """A copy of the drive that a test may damage."""
    shutil.copytree(kitti.parent.parent, tmp_path / "data")
    return tmp_path / "data" / "sequences" / "03"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def succeeds(*arguments: object) -> Result:
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return result


def fails(code: int, *arguments: object) -> str:
    """The line that a failing command writes."""
    result = run(*arguments)
    assert result.exit_code == code, result.output
    (line,) = (line for line in result.stderr.splitlines() if line.startswith("error: "))
    assert "Traceback" not in result.output
    return line


def last_line(result: Result) -> str:
    return result.stdout.splitlines()[-1]


def vectors(path: Path) -> bytes:
    return DescriptorRun.load(path).descriptors.tobytes()


# Every command on tiny data, with the files it promises.

SMOKE = [
    (("info", "DATA"), ()),
    (("info", "DATA/../..", "--sequence", "3"), ()),
    (("fuse", "DATA", "-o", "OUT"), ("clouds/000000.ply", "poses.txt", "times.txt")),
    (("fuse", "DATA", "-o", "OUT", "--source", "stereo"), ("clouds/000019.ply",)),
    (("fuse", "DATA", "-o", "OUT", "--format", "pcd"), ("clouds/000019.pcd", "run.json")),
    (("fuse", "DATA", "-o", "OUT", "--format", "bin"), ("clouds/000019.bin",)),
    (("describe", "DATA", "-d", "m2dp,cm2dp", "-o", "OUT"), ("lidar-m2dp.npz", "lidar-cm2dp.npz")),
    (("describe", "DATA", "-o", "OUT", "--jobs", "1"), ("lidar-shot.npz", "lidar-cshot.npz")),
    (("describe", "DATA", "-d", "shot", "-o", "OUT", "--source", "stereo"), ("stereo-shot.npz",)),
    (
        ("describe", "DATA", "-d", "cm2dp", "-o", "OUT", "--set", "descriptors.color_space=lab"),
        ("lidar-cm2dp.npz", "run.json"),
    ),
    (("loops", "DATA", "-o", "OUT", "-v"), ("loops.csv", "descriptors/lidar-cm2dp.npz")),
    (("loops", "DATA", "-d", "m2dp", "-o", "OUT", "--threshold", "0.5"), ("loops.csv",)),
    (
        ("bench", "DATA", "-d", "m2dp", "-o", "OUT", "--set", "evaluation.window=2"),
        ("report.html", "metrics.json", "descriptors/stereo-m2dp.npz", "run.json"),
    ),
    (("config",), ()),
    (("config", "sim"), ()),
    (("config", "fusion", "--yaml"), ()),
    (("doctor",), ()),
]


@pytest.mark.parametrize(("words", "files"), SMOKE, ids=lambda value: " ".join(value)[:50])
def test_each_command_writes_what_it_promises(
    kitti: Path, tmp_path: Path, words: tuple[str, ...], files: tuple[str, ...]
) -> None:
    out = tmp_path / "out"
    places = {"DATA": str(kitti), "OUT": str(out)}
    succeeds(*(word.replace("DATA", places["DATA"]).replace("OUT", str(out)) for word in words))
    for file in files:
        assert (out / file).stat().st_size > 0


def test_info_says_what_is_in_a_recording(kitti: Path) -> None:
    text = succeeds("info", kitti).stdout
    for expected in ("kitti-odometry", "10.00 Hz", "20 files .png, 128x48", "baseline 0.500 m"):
        assert expected in text


def test_fused_clouds_can_be_opened_again_and_give_the_same_descriptor(
    kitti: Path, tmp_path: Path
) -> None:
    succeeds("fuse", kitti, "-o", tmp_path / "clouds")
    succeeds("describe", kitti, "-d", "cm2dp", "-o", tmp_path / "first")
    succeeds("describe", tmp_path / "clouds", "-d", "cm2dp", "-o", tmp_path / "second")
    first = DescriptorRun.load(tmp_path / "first/lidar-cm2dp.npz")
    second = DescriptorRun.load(tmp_path / "second/cloud-cm2dp.npz")
    assert first.descriptors.tobytes() == second.descriptors.tobytes()
    assert np.array_equal(first.stamps_ns, second.stamps_ns)
    assert first.positions is not None and second.positions is not None
    assert np.allclose(first.positions, second.positions)


def test_loops_are_listed_and_counted(kitti: Path, tmp_path: Path) -> None:
    words = ("loops", kitti, "-o", tmp_path / "out", *NO_WINDOW)
    assert "8 loops in 20 queries: 3 without candidates" in succeeds(*words).stdout
    rows = list(csv.DictReader((tmp_path / "out/loops.csv").open()))
    assert [(row["query"], row["match"]) for row in rows] == [
        (str(n), str(FRAMES - n)) for n in range(12, FRAMES)
    ]


def test_without_loops_it_says_why(kitti: Path, tmp_path: Path) -> None:
    words = ("loops", kitti, "-o", tmp_path / "out", "--set", "loop_closure.window=18")
    text = succeeds(*words, "--threshold", "0").stdout
    assert "0 loops in 20 queries: 19 without candidates, 1 above threshold 0, best 0." in text


def test_a_second_threshold_uses_the_descriptors_of_the_first(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("loops", kitti, "-d", "m2dp", "-o", tmp_path / "out", *NO_WINDOW)
    succeeds(*words)
    monkeypatch.setattr(pipeline, "fuse", pytest.fail)
    assert "17 loops" in succeeds(*words, "--threshold", "2").stdout


def test_another_configuration_is_described_anew(kitti: Path, tmp_path: Path) -> None:
    words = ("describe", kitti, "-d", "m2dp", "-o", tmp_path)
    succeeds(*words)
    before = vectors(tmp_path / "lidar-m2dp.npz")
    succeeds(*words, "--set", "fusion.voxel=3")
    assert vectors(tmp_path / "lidar-m2dp.npz") != before


def test_eval_judges_by_the_protocol_and_radius_given(kitti: Path, tmp_path: Path) -> None:
    succeeds("describe", kitti, "-d", "cm2dp", "-o", tmp_path, *NO_WINDOW)
    result = succeeds("eval", tmp_path, "--protocol", "revisit", "--radius", "5")
    assert "radius 5 m, window 2: 8 of 20 frames are revisits" in result.stdout
    assert last_line(result) == str(tmp_path / "metrics.json")
    (judged,) = json.loads((tmp_path / "metrics.json").read_text())["runs"]
    assert judged["protocols"]["revisit"]["top1"] == 1
    assert judged["protocols"]["perdomo2019"]["radius"] == 5


def test_eval_takes_other_true_poses_by_frame_number(recording: Path, tmp_path: Path) -> None:
    (recording / "velodyne/000004.bin").unlink()
    truth = (recording.parent.parent / "poses/03.txt").rename(tmp_path / "truth.txt")
    out = tmp_path / "out"
    succeeds("describe", recording, "-d", "m2dp", "-o", out, "--skip-gaps", *NO_WINDOW)
    assert "no true poses" in succeeds("eval", out).stdout
    # Frame 16 has nothing left to come back to.
    text = succeeds("eval", out, "--gt", truth).stdout
    assert "7 of 19 frames are revisits" in text


def test_bench_compares_both_sources_and_ends_with_the_report(kitti: Path, tmp_path: Path) -> None:
    result = succeeds("bench", kitti, "-o", tmp_path / "out", *NO_WINDOW)
    for name in ("LiDAR-camera", "Stereo", *fusionslam_descriptors()):
        assert name in result.stdout
    assert last_line(result) == str(tmp_path / "out/report.html")
    runs = json.loads((tmp_path / "out/metrics.json").read_text())["runs"]
    assert len(runs) == 8 and all(set(r["protocols"]) == {"revisit", "perdomo2019"} for r in runs)
    assert all("match" in r["costs"]["stages"] for r in runs)


def fusionslam_descriptors() -> tuple[str, ...]:
    return ("m2dp", "cm2dp", "shot", "cshot")


def test_the_report_is_written_again_without_the_data(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    succeeds("bench", recording, "-d", "cm2dp", "-o", out, *NO_WINDOW)
    pictured = (out / "report.html").stat().st_size
    shutil.rmtree(recording)
    result = succeeds("report", out, "-o", tmp_path / "again")
    assert last_line(result) == str(tmp_path / "again/report.html")
    assert 0 < (tmp_path / "again/report.html").stat().st_size < pictured


def test_figures_published_for_kitti_stand_beside_those_of_that_sequence(
    recording: Path, tmp_path: Path
) -> None:
    recording = recording.rename(recording.with_name("06"))
    (recording.parent.parent / "poses/03.txt").rename(recording.parent.parent / "poses/06.txt")
    words = ("bench", recording, "-d", "cm2dp", "-o", tmp_path / "out")
    text = " ".join(succeeds(*words).stdout.split())
    assert "0.825" in text and "0.502" in text
    (recording.parent.parent / "sim.json").write_text("{}")
    words = ("bench", recording, "-d", "cm2dp", "-o", tmp_path / "simulated")
    assert "0.825" not in succeeds(*words).stdout


def test_the_demo_needs_no_data_and_runs_twice(tmp_path: Path) -> None:
    pytest.importorskip("embreex")
    settings = [word for setting in TINY_TOWN for word in ("--set", setting)]
    first = succeeds("demo", "-o", tmp_path, *settings)
    assert last_line(first) == str(tmp_path / "report.html")
    drive = (tmp_path / "drive/sim.json").stat().st_mtime_ns
    second = succeeds("demo", "-o", tmp_path, *settings)
    assert last_line(second) == last_line(first)
    assert (tmp_path / "drive/sim.json").stat().st_mtime_ns == drive
    stored = json.loads((tmp_path / "run.json").read_text())["configs"]
    assert stored["stereo"]["fusion"]["voxel"] == 0.2
    assert stored["lidar"]["fusion"]["voxel"] == 0


def test_the_demo_does_not_replace_results_of_a_real_recording(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("embreex")
    out = tmp_path / "out"
    settings = [word for setting in TINY_TOWN for word in ("--set", setting)]
    succeeds("describe", kitti, "-d", "m2dp", "-o", out)
    before = {path: path.read_bytes() for path in out.iterdir()}
    line = fails(1, "demo", "-o", out, *settings)
    assert "KITTI odometry 03" in line and "choose another folder" in line
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    # Without run.json nothing tells whose the run is but the run itself.
    (out / "run.json").unlink()
    (out / "descriptors").mkdir()
    kept = (out / "lidar-m2dp.npz").rename(out / "descriptors/lidar-m2dp.npz")
    assert "lidar-m2dp.npz is a run of KITTI odometry 03" in fails(1, "demo", "-o", out, *settings)
    assert kept.read_bytes() == before[out / "lidar-m2dp.npz"]


def test_the_demo_replaces_only_what_an_earlier_demo_made(tmp_path: Path) -> None:
    run = DescriptorRun(
        source="lidar",
        descriptor="m2dp",
        dataset="simulated drive",
        descriptors=np.eye(2, dtype=np.float32),
        frames=np.arange(2),
        stamps_ns=np.arange(2),
        poses=None,
        seconds={},
        peak_memory_bytes=0,
        points=np.ones(2, np.int64),
    )
    run.save(tmp_path / "lidar-m2dp.npz")
    replace(run, dataset="KITTI 06").save(tmp_path / "lidar-cm2dp.npz")
    np.savez(tmp_path / "lidar-mine.npz", mine=np.eye(3))
    np.savez(tmp_path / "my-own.npz", mine=np.eye(3))
    old = Work(Recording("/drives/one"), "simulated drive", configs={"lidar": {}}, demo=True)
    old.save(tmp_path)
    forget_demo(tmp_path, Recording("/drives/two"))
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"lidar-cm2dp.npz", "lidar-mine.npz", "my-own.npz"}


def test_the_demo_says_how_to_move_a_cache_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("FUSIONSLAM_CACHE", str(tmp_path / "file"))
    assert "FUSIONSLAM_CACHE can name another folder" in fails(1, "demo", "-o", tmp_path / "out")


@pytest.mark.parametrize(
    ("words", "module", "extra"),
    [
        (("demo",), "embreex", "sim"),
        (("bench", "."), "matplotlib", "report"),
        (("report", "."), "jinja2", "report"),
    ],
)
def test_a_missing_extra_is_named_with_the_line_that_installs_it(
    words: tuple[str, ...], module: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.cli.guard.find_spec", lambda name: name != module or None)
    assert f"pip install 'fusionslam[{extra}]'" in fails(1, *words)


# Results do not depend on how they were made.


def test_one_or_two_jobs_give_the_same_runs(kitti: Path, tmp_path: Path) -> None:
    for jobs in ("1", "2"):
        succeeds("describe", kitti, "-o", tmp_path / jobs, "--jobs", jobs)
    for name in fusionslam_descriptors():
        one, two = (vectors(tmp_path / jobs / f"lidar-{name}.npz") for jobs in ("1", "2"))
        assert one == two


def test_an_interrupted_run_keeps_what_is_done_and_goes_on(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("describe", kitti, "-d", "cm2dp", "--jobs", "1", "-o")
    succeeds(*words, tmp_path / "whole")
    fused: list[int] = []

    def interrupted(frame: Frame, config: fusionslam.FusionConfig) -> Cloud:
        fused.append(frame.index)
        if frame.index == CHUNK + 1:
            raise KeyboardInterrupt
        return fusionslam.fuse(frame, config)

    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "fuse", interrupted)
        result = run(*words, tmp_path / "parts")
    assert result.exit_code == 130
    assert f"is kept in {tmp_path / 'parts'}; the same command goes on" in result.stderr
    assert len(list((tmp_path / "parts").glob(".partial-*/*.npz"))) == 1
    fused.clear()
    monkeypatch.setattr(
        pipeline, "fuse", lambda f, c: fused.append(f.index) or fusionslam.fuse(f, c)
    )
    succeeds(*words, tmp_path / "parts")
    assert set(range(CHUNK)).isdisjoint(fused[: FRAMES - CHUNK])
    whole, parts = (vectors(tmp_path / name / "lidar-cm2dp.npz") for name in ("whole", "parts"))
    assert whole == parts


def test_fusing_goes_on_with_the_clouds_that_are_missing(kitti: Path, tmp_path: Path) -> None:
    succeeds("fuse", kitti, "-o", tmp_path)
    kept, gone = tmp_path / "clouds/000003.ply", tmp_path / "clouds/000004.ply"
    content, stamp = gone.read_bytes(), kept.stat().st_mtime_ns
    gone.unlink()
    succeeds("fuse", kitti, "-o", tmp_path)
    assert gone.read_bytes() == content and kept.stat().st_mtime_ns == stamp


def test_the_printed_configuration_is_read_again(tmp_path: Path) -> None:
    changed = ("--set", "fusion.voxel=0.3", "--set", "sim.seed=5")
    text = succeeds("config", "--yaml", *changed).stdout
    file = tmp_path / "config.yaml"
    file.write_text(text)
    assert succeeds("config", "--yaml", "--config", file).stdout == text
    assert yaml.safe_load(text)["fusion"]["voxel"] == 0.3
    assert yaml.safe_load(text)["sim"]["seed"] == 5


def test_settings_win_over_the_file(kitti: Path, tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text("fusion: {voxel: 2.0, ground: height}\n")
    words = ("-d", "m2dp", "-o", tmp_path, "--config", file, "--set", "fusion.voxel=1.5")
    succeeds("describe", kitti, *words)
    config = DescriptorRun.load(tmp_path / "lidar-m2dp.npz").config
    assert (config["fusion"]["voxel"], config["fusion"]["ground"]) == (1.5, "height")


def test_the_configuration_shows_units_ranges_and_help() -> None:
    text = succeeds("config", "fusion").stdout
    row = next(line for line in text.splitlines() if line.lstrip().startswith("fusion.voxel"))
    assert "0.0" in row and " m " in row and ">= 0" in row and "one point a cube" in row


# Bad input: one line that names the culprit, and an exit code.

USAGE_ERRORS = [
    (("--set", "fusion.voxl=1"), "did you mean 'voxel'?"),
    (("--set", "fusoin.voxel=1"), "did you mean 'fusion'?"),
    (("--set", "sim.seed=1"), "unknown configuration key 'sim'"),
    (("--set", "fusion.voxel=big"), "fusion.voxel is 'big'"),
    (("--set", "fusion.voxel=-1"), "fusion.voxel is -1"),
    (("--set", "fusion.voxel"), "expected stage.key=value"),
    (("--config", "nowhere.yaml"), "nowhere.yaml"),
    (("-d", "m3dp"), "unknown descriptor 'm3dp'"),
    (("--source", "sterio"), "did you mean 'stereo'?"),
    (("--kind", "kiti"), "kind is 'kiti'"),
]


@pytest.mark.parametrize(("words", "expected"), USAGE_ERRORS, ids=lambda value: str(value)[:30])
def test_a_wrong_option_is_named_with_what_was_expected(
    kitti: Path, tmp_path: Path, words: tuple[str, ...], expected: str
) -> None:
    assert expected in fails(2, "describe", kitti, "-o", tmp_path / "out", *words)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("info", "DATA", "--bogus"), "No such option: --bogus"),
        (("--bogus",), "No such option: --bogus"),
        (("inof", "DATA"), "No such command 'inof'"),
        (("info",), "Missing argument 'DATA'"),
        (("describe", "DATA", "-o", "x", "--jobs", "0"), "'--jobs'"),
        (("eval", "x", "--radius", "wide"), "Invalid value for '--radius'"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_a_wrong_use_is_one_line_too(kitti: Path, words: tuple[str, ...], expected: str) -> None:
    line = fails(2, *(str(kitti) if word == "DATA" else word for word in words))
    assert expected in line and "--help" in line


@pytest.mark.parametrize("command", ["info", "bench", "describe", "loops", "fuse"])
def test_a_path_without_a_recording_is_named(command: str, tmp_path: Path) -> None:
    output = () if command == "info" else ("-o", tmp_path / "out")
    assert "nowhere does not exist" in fails(1, command, tmp_path / "nowhere", *output)
    (tmp_path / "something").mkdir()
    assert "something is no recording" in fails(1, command, tmp_path / "something", *output)
    (tmp_path / "empty" / "velodyne").mkdir(parents=True)
    assert "empty has no frames" in fails(1, command, tmp_path / "empty", *output)


def test_results_that_are_not_there_are_missed_by_name(kitti: Path, tmp_path: Path) -> None:
    for command in ("eval", "report"):
        assert "nowhere" in fails(1, command, tmp_path / "nowhere")
        assert "holds no descriptor runs" in fails(1, command, tmp_path)
    words = ("--protocol", "revist")
    assert "did you mean 'revisit'?" in described_then_fails(kitti, tmp_path, *words)
    assert "evaluation.radius is -1" in described_then_fails(kitti, tmp_path, "--radius", "-1")


def described_then_fails(kitti: Path, folder: Path, *words: str) -> str:
    succeeds("describe", kitti, "-d", "m2dp", "-o", folder)
    return fails(2, "eval", folder, *words)


def test_poses_shorter_than_the_recording_are_refused(kitti: Path, tmp_path: Path) -> None:
    truth = tmp_path / "short.txt"
    truth.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    succeeds("describe", kitti, "-d", "m2dp", "-o", tmp_path / "out")
    assert "short.txt has 3 lines" in fails(1, "eval", tmp_path / "out", "--gt", truth)


@pytest.mark.parametrize("command", ["describe", "loops", "bench", "fuse"])
def test_an_output_that_cannot_be_written_is_named(
    kitti: Path, tmp_path: Path, command: str
) -> None:
    (tmp_path / "file").write_text("kept")
    assert "cannot write" in fails(1, command, kitti, "-o", tmp_path / "file" / "out")
    assert (tmp_path / "file").read_text() == "kept"


def test_results_of_other_data_are_not_mixed_or_replaced(
    kitti: Path, recording: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    succeeds("describe", kitti, "-d", "m2dp", "-o", out)
    assert "choose another folder" in fails(1, "describe", recording, "-d", "m2dp", "-o", out)
    succeeds("fuse", kitti, "-o", tmp_path / "clouds")
    words = ("-o", tmp_path / "clouds", "--set", "fusion.voxel=1")
    assert "choose another folder" in fails(1, "fuse", kitti, *words)


def test_a_truncated_scan_is_named_and_nothing_finished_is_lost(
    recording: Path, tmp_path: Path
) -> None:
    scan = recording / f"velodyne/{FRAMES - 1:06d}.bin"
    whole = scan.read_bytes()
    scan.write_bytes(whole[:-5])
    words = ("describe", recording, "-d", "m2dp", "-o", tmp_path / "out")
    assert scan.name in fails(1, *words)
    assert len(list((tmp_path / "out").glob(".partial-*/*.npz"))) == 1
    scan.write_bytes(whole)
    succeeds(*words)


def test_a_gap_is_reported_and_skipped_only_on_request(recording: Path, tmp_path: Path) -> None:
    (recording / "velodyne/000005.bin").unlink()
    words = ("describe", recording, "-d", "m2dp", "-o", tmp_path / "out")
    message = fails(1, *words)
    assert "000005.bin" in message and "--skip-gaps" in message
    assert "000005.bin" in fails(1, "bench", recording, "-d", "m2dp", "-o", tmp_path / "bench")
    result = succeeds(*words, "--skip-gaps")
    assert f"{FRAMES - 1} frames" in result.stdout
    assert "1 frames lack a file: 5" in succeeds("info", recording).stdout


@pytest.mark.parametrize("command", ["info", "describe", "bench"])
def test_a_missing_calibration_is_named(recording: Path, tmp_path: Path, command: str) -> None:
    (recording / "calib.txt").unlink()
    output = () if command == "info" else ("-o", tmp_path / "out")
    assert "calib.txt" in fails(1, command, recording, *output)


def test_without_colours_only_the_descriptors_that_need_none_are_made(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for number in range(3):
        points = rng.uniform(-9, 9, (300, 3)).astype(np.float32)
        write_cloud(tmp_path / f"data/clouds/{number:06d}.bin", Cloud(points))
    result = succeeds("bench", tmp_path / "data", "-o", tmp_path / "out")
    assert "left out cm2dp, cshot" in " ".join(result.stderr.split())
    made = sorted(path.name for path in (tmp_path / "out/descriptors").glob("*.npz"))
    assert made == ["cloud-m2dp.npz", "cloud-shot.npz"]
    assert "needs colours" in fails(1, "loops", tmp_path / "data", "-o", tmp_path / "loops")


def test_errors_that_nobody_foresaw_keep_their_traceback(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "fuse", lambda *_: 1 / 0)
    result = run("describe", kitti, "-d", "m2dp", "-o", tmp_path)
    assert isinstance(result.exception, ZeroDivisionError)


@pytest.mark.parametrize(
    ("words", "expected", "heavy"),
    [(["--help"], "describe", ["numpy", "pydantic"]), (["bench", "--help"], "--jobs", ["numpy"])],
)
def test_help_loads_nothing_heavy(words: list[str], expected: str, heavy: list[str]) -> None:
    check = (
        "import sys\nfrom fusionslam.cli import app\n"
        f"app({words!r}, standalone_mode=False)\n"
        f"sys.exit(', '.join({{*{heavy}, 'yaml', 'PIL', 'fusionslam._core'}} & set(sys.modules)))"
    )
    environment = os.environ | {"PYTHONPATH": str(Path(fusionslam.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-c", check], env=environment, capture_output=True, text=True
    )
    assert expected in done.stdout
    assert done.stderr.strip() == ""


def test_the_report_names_the_configuration_of_each_run(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    succeeds("describe", kitti, "-d", "m2dp", "--set", "descriptors.preset=author", "-o", out)
    succeeds("describe", kitti, "-d", "cm2dp", "-o", out)
    succeeds("report", out)
    config = json.loads((out / "metrics.json").read_text())["config"]
    presets = {name: stages["descriptors"]["preset"] for name, stages in config.items()}
    assert presets == {"lidar / m2dp": "author", "lidar / cm2dp": "robust"}
    assert "m2dp author" in (out / "report.html").read_text()
    text = succeeds("eval", out).stdout
    assert "m2dp author" in text and "cm2dp robust" in text


def test_bench_takes_the_source_that_the_configuration_names(kitti: Path, tmp_path: Path) -> None:
    chosen = ("--set", "fusion.source=lidar")
    succeeds("bench", kitti, "-d", "m2dp", *chosen, *NO_WINDOW, "-o", tmp_path / "out")
    assert [path.name for path in (tmp_path / "out" / "descriptors").iterdir()] == [
        "lidar-m2dp.npz"
    ]


# What a newcomer stumbled over.


@pytest.mark.parametrize("command", ["describe", "loops", "bench", "fuse"])
def test_an_output_that_is_a_file_is_said_plainly(
    kitti: Path, tmp_path: Path, command: str
) -> None:
    (tmp_path / "file").write_text("kept")
    line = fails(1, command, kitti, "-o", tmp_path / "file")
    assert "file is a file, expected a folder" in line
    assert (tmp_path / "file").read_text() == "kept"


def test_a_source_named_in_the_configuration_is_obeyed_though_it_is_the_default(
    kitti: Path, tmp_path: Path
) -> None:
    rng = np.random.default_rng(1)
    for number in range(2):
        points = rng.uniform(-9, 9, (300, 3)).astype(np.float32)
        write_cloud(tmp_path / f"data/clouds/{number:06d}.bin", Cloud(points))
    file = tmp_path / "config.yaml"
    file.write_text("fusion: {source: lidar}\n")
    for words in (("--set", "fusion.source=lidar"), ("--config", file)):
        # Clouds alone would be described as they are.
        line = fails(1, "describe", tmp_path / "data", "-d", "m2dp", "-o", tmp_path / "out", *words)
        assert "no files of sensor 'left'" in line
        succeeds("bench", kitti, "-d", "m2dp", *words, *NO_WINDOW, "-o", tmp_path / words[0])
        runs = (tmp_path / words[0] / "descriptors").iterdir()
        assert [path.name for path in runs] == ["lidar-m2dp.npz"]


def test_a_run_that_is_replaced_is_announced_with_what_changed(kitti: Path, tmp_path: Path) -> None:
    words = ("describe", kitti, "-d", "m2dp", "-o", tmp_path)
    succeeds(*words)
    assert "replaced" not in succeeds(*words).stderr
    changed = ("--set", "descriptors.preset=author", "--set", "fusion.voxel=1")
    text = " ".join(succeeds(*words, *changed).stderr.split())
    assert "lidar-m2dp.npz is replaced by a new run" in text
    assert "fusion.voxel was 0.0, is 1" in text
    assert "descriptors.preset was robust, is author" in text


def test_bad_frames_are_left_out_on_request_and_counted(recording: Path, tmp_path: Path) -> None:
    (recording / "velodyne/000004.bin").write_bytes(b"")
    out = tmp_path / "out"
    words = ("describe", recording, "-d", "m2dp", "-o", out, *NO_WINDOW)
    assert "frame 4" in fails(1, *words)
    skip = "--skip-bad-frames"
    assert "19 frames, 1 left out that cannot be described: 4 (" in succeeds(*words, skip).stdout
    # The stored run says so as well, and does not pass for a whole one.
    assert "1 left out" in succeeds(*words, skip).stdout
    assert "frame 4" in fails(1, *words)
    assert "1 left out" in succeeds("eval", out).stdout
    result = succeeds("bench", recording, "-d", "m2dp", "-o", tmp_path / "bench", skip, *NO_WINDOW)
    assert "1 left out" in result.stdout
    assert "1 frames were left out" in (tmp_path / "bench/report.html").read_text()
    found = succeeds("loops", recording, "-d", "m2dp", "-o", tmp_path / "l", skip, *NO_WINDOW)
    assert "in 19 queries" in found.stdout and "1 left out" in found.stdout


def test_loops_name_frames_by_their_number_whatever_is_missing(
    recording: Path, tmp_path: Path
) -> None:
    (recording / "velodyne/000002.bin").unlink()
    out = tmp_path / "out"
    succeeds("loops", recording, "-o", out, "--skip-gaps", *NO_WINDOW)
    rows = list(csv.DictReader((out / "loops.csv").open()))
    pairs = [(int(row["query"]), int(row["match"])) for row in rows]
    assert pairs == [(n, FRAMES - n) for n in range(12, FRAMES) if n != FRAMES - 2]


def test_gaps_treated_otherwise_in_one_folder_do_not_mix_numbers(
    recording: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    succeeds("describe", recording, "-d", "m2dp", "-o", out, *NO_WINDOW)
    (recording / "velodyne/000002.bin").unlink()
    succeeds("describe", recording, "-d", "cm2dp", "--skip-gaps", "-o", out, *NO_WINDOW)
    numbers = {
        name: DescriptorRun.load(out / f"lidar-{name}.npz").numbers.tolist()
        for name in ("m2dp", "cm2dp")
    }
    assert numbers["m2dp"] == list(range(FRAMES))
    assert numbers["cm2dp"] == [n for n in range(FRAMES) if n != 2]


@pytest.mark.parametrize("command", ["loops", "bench"])
def test_two_windows_in_one_call_are_pointed_out(kitti: Path, tmp_path: Path, command: str) -> None:
    words = (command, kitti, "-d", "m2dp", "-o", tmp_path / "out")
    one = succeeds(*words, "--set", "evaluation.window=2").stderr
    assert "loop_closure.window is 50 and evaluation.window is 2" in " ".join(one.split())
    assert "loop_closure.window" not in succeeds(*words, *NO_WINDOW).stderr


def test_tables_of_results_fit_eighty_columns(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("fusionslam.cli.screen._WIDTH", 80)
    text = succeeds("bench", kitti, "-o", tmp_path / "out", *NO_WINDOW).stdout
    lines = text.splitlines()[:-1]  # the last one is a path
    assert max(map(len, lines)) <= 80
    for name in fusionslam_descriptors():
        rows = [line.split() for line in lines if line.split()[:1] == [name]]
        preset = 1 if name in ("m2dp", "cm2dp") else 0
        # Accuracy and cost for each source: seven and seven figures.
        assert [len(row) - 1 - preset for row in rows] == [7, 7, 7, 7]
    assert "load" in text and "peak MiB: memory" in text
    best = [line for line in lines if line.startswith("Best: ")]
    assert len(best) == 1 and "max F1" in best[0]


def test_a_report_says_why_it_has_no_pictures_of_frames(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    succeeds("bench", recording, "-d", "m2dp", "-o", out, *NO_WINDOW)
    assert "Pictures of frames are missing" not in (out / "report.html").read_text()
    shutil.rmtree(recording)
    succeeds("report", out)
    page = (out / "report.html").read_text()
    assert f"Pictures of frames are missing: {recording} does not exist" in page


def test_an_interrupted_report_does_not_claim_that_nothing_was_written(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    succeeds("describe", kitti, "-d", "m2dp", "-o", tmp_path, *NO_WINDOW)
    monkeypatch.setattr("fusionslam.report.assembly.write_metrics", interrupted)
    result = run("report", tmp_path)
    assert result.exit_code == 130 and list(tmp_path.glob("distances_*"))
    assert f"some files in {tmp_path} may be new" in result.stderr
    monkeypatch.setattr("fusionslam.bench.find_loops", interrupted)
    result = run("eval", tmp_path)
    assert result.exit_code == 130 and "nothing was written" in result.stderr
    assert not (tmp_path / "metrics.json").exists()


def entry(*words: object, **more: Any) -> "subprocess.Popen[bytes]":
    """The command as it is installed."""
    code = "import sys; from fusionslam.entry import main; sys.exit(main())"
    environment = os.environ | {"PYTHONPATH": str(Path(fusionslam.__file__).parents[1])}
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)],
        env=environment,
        stderr=subprocess.PIPE,
        **more,
    )


def test_a_reader_who_has_enough_is_no_error(kitti: Path, tmp_path: Path) -> None:
    succeeds("describe", kitti, "-d", "m2dp", "-o", tmp_path, *NO_WINDOW)
    for words in (
        ("eval", tmp_path),
        ("config",),
        ("describe", kitti, "-d", "m2dp", "-o", tmp_path),
    ):
        reading, writing = os.pipe()
        os.close(reading)
        process = entry(*words, stdout=writing)
        os.close(writing)
        assert process.communicate()[1] == b""
        assert process.returncode == 0


def test_an_interruption_while_the_program_loads_is_quiet(tmp_path: Path) -> None:
    package = tmp_path / "typer"  # is loaded first, and here takes its time
    package.mkdir()
    (package / "__init__.py").write_text(
        "print('loading', flush=True)\nimport time\ntime.sleep(60)"
    )
    code = f"""import sys
sys.path.insert(0, {str(tmp_path)!r})
from fusionslam.entry import main
main()"""
    environment = os.environ | {"PYTHONPATH": str(Path(fusionslam.__file__).parents[1])}
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None and process.stdout.readline() == b"loading\n"
    process.send_signal(signal.SIGINT)
    assert process.communicate()[1] == b""
    assert process.returncode == 130


def test_flags_are_flags_and_shared_texts_are_those_of_the_configuration() -> None:
    text = " ".join(succeeds("loops", "--help").stdout.split())
    assert "--verbose Say more" in text and "<bool>" not in text
    fields = fusionslam.LoopConfig.model_fields
    assert str(fields["threshold"].description) in text
    assert str(fusionslam.FusionConfig.model_fields["source"].description) in text
    text = " ".join(succeeds("eval", "--help").stdout.split())
    for name in ("radius", "window", "protocol"):
        assert str(EvaluationConfig.model_fields[name].description) in text


def test_info_sums_no_path_over_gaps_and_sees_a_calibration_without_images(
    recording: Path,
) -> None:
    for number in (4, 5):
        (recording / f"velodyne/{number:06d}.bin").unlink()
    for folder in ("image_2", "image_3"):
        shutil.rmtree(recording / folder)
    text = " ".join(succeeds("info", recording).stdout.split())
    # 19 steps of 20 m, of which 3 touch what is missing; the drive turns and comes back.
    assert "path of 320 m, without 1 stretches where frames are missing" in text
    assert "no images; the calibration is there" in text


def test_doctor_fails_where_something_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FUSIONSLAM_CACHE", "/proc/nowhere")
    result = run("doctor")
    assert result.exit_code == 1
    assert "fault" in next(line for line in result.stdout.splitlines() if "cache" in line)
    monkeypatch.undo()
    assert run("doctor").exit_code == 0
    monkeypatch.setattr("fusionslam.cli.guard.find_spec", lambda name: name != "embreex" or None)
    result = run("doctor")
    assert result.exit_code == 0 and "missing" in result.stdout


def test_the_page_of_the_command_line_names_every_option_of_every_command() -> None:
    page = (Path(__file__).parents[2] / "docs/cli.md").read_text()
    rows = re.findall(r"^\| `(--[a-z-]+)` \| ([a-z, ]+) \|", page, flags=re.MULTILINE)
    documented = {(name, command) for name, of in rows for command in of.split(", ")}
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    existing = {
        (option, name)
        for name, command in commands.items()
        for parameter in command.params
        for option in parameter.opts
        if option.startswith("--") and option != "--help"
    }
    assert documented == existing


def test_a_report_leaves_the_loops_of_another_command_alone(kitti: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    succeeds("loops", kitti, "-o", tmp_path, *NO_WINDOW)
    before = (tmp_path / "loops.csv").read_bytes()
    succeeds("report", tmp_path)
    assert (tmp_path / "loops.csv").read_bytes() == before
    assert (tmp_path / "matches.csv").stat().st_size > 0


def test_matching_and_judging_tell_how_far_they_are(kitti: Path, tmp_path: Path) -> None:
    succeeds("describe", kitti, "-d", "m2dp,cm2dp", "-o", tmp_path, *NO_WINDOW)
    steps: list[tuple[str, int, int]] = []
    stored_evaluations(tmp_path, step=lambda *step: steps.append(step))
    for name in ("m2dp", "cm2dp"):
        assert (f"matching lidar {name}", FRAMES, FRAMES) in steps
        assert steps.index((f"judging lidar {name}", 0, 1)) < steps.index(
            (f"judging lidar {name}", 1, 1)
        )
