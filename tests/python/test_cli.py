# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: what each command writes, what it says when it cannot, and how it resumes."""

import csv
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import fusionslam
from command_line import (
    FRAMES,
    NO_WINDOW,
    TINY_TOWN,
    fails,
    fusionslam_descriptors,
    last_line,
    run,
    succeeds,
    vectors,
)
from fusionslam import pipeline
from fusionslam.datasets import write_cloud
from fusionslam.evaluation import DescriptorRun
from fusionslam.pipeline import CHUNK
from fusionslam.sensors import Cloud, Frame
from fusionslam.workspace import Recording, Work, forget_demo

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
