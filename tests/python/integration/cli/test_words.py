# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: what it tells people who do not know it yet, and that it tells the truth."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import fusionslam
from cli import (
    FRAMES,
    NO_WINDOW,
    error_of,
    fails,
    fusionslam_descriptors,
    interrupted_at,
    last_line,
    run,
    succeeds,
    table,
)
from fusionslam.datasets import open_dataset, write_cloud
from fusionslam.evaluation import DescriptorRun, EvaluationConfig
from fusionslam.pipelines.compare_descriptors import evaluate_stored
from fusionslam.pipelines.describe import CHUNK
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import SceneSet
from rows import rows


def test_a_source_that_is_set_is_used_even_if_the_default(kitti: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-9, 9, (300, 3)).astype(np.float32)
    write_cloud(tmp_path / "data/clouds/000000.bin", Cloud(points))
    file = tmp_path / "config.yaml"
    file.write_text("fusion: {source: lidar}\n")
    for words in (("--set", "fusion.source=lidar"), ("--config", file)):
        # Clouds alone would be described as they are.
        line = fails(1, "describe", tmp_path / "data", "-d", "m2dp", "-o", tmp_path / "out", *words)
        assert "'left'" in line
        out = tmp_path / words[0]
        succeeds("bench", kitti, "-d", "m2dp", *words, "-o", out, "--no-report")
        assert [path.name for path in out.glob("descriptors/*")] == ["lidar-m2dp.npz"]


def test_a_run_that_is_replaced_is_announced_with_what_changed(kitti: Path, tmp_path: Path) -> None:
    words = ("describe", kitti, "-d", "m2dp", "-o", tmp_path)
    succeeds(*words)
    assert "replaced" not in succeeds(*words).stderr
    changed = ("--set", "descriptors.preset=author", "--set", "fusion.voxel=1")
    text = " ".join(succeeds(*words, *changed).stderr.split())
    for changed_value in ("lidar-m2dp.npz", "fusion.voxel", "descriptors.preset"):
        assert changed_value in text


@pytest.mark.nightly
def test_bad_frames_are_left_out_on_request_and_counted(recording: Path, tmp_path: Path) -> None:
    (recording / "velodyne/000004.bin").write_bytes(b"")
    out = tmp_path / "out"
    words = ("describe", recording, "-d", "m2dp", "-o", out, *NO_WINDOW)
    assert "frame 4" in fails(1, *words)
    skip = "--skip-bad-frames"
    assert "19 frames; 1 left out" in succeeds(*words, skip).stdout
    # The stored run says so as well, and does not pass for a whole one.
    assert "1 left out" in succeeds(*words, skip).stdout
    assert "frame 4" in fails(1, *words)
    assert "1 left out" in succeeds("eval", out).stdout
    result = succeeds("bench", recording, "-d", "m2dp", "-o", tmp_path / "bench", skip, *NO_WINDOW)
    assert "1 left out" in result.stdout
    page = (tmp_path / "bench/report.html").read_text()
    assert "1 frame that cannot be described left out" in page
    found = succeeds("loops", recording, "-d", "m2dp", "-o", tmp_path / "l", skip, *NO_WINDOW)
    assert "in 19 frames" in found.stdout and "1 left out" in found.stdout


@pytest.mark.slow
def test_every_command_leaves_out_bad_frames_on_request(recording: Path, tmp_path: Path) -> None:
    garbage = np.random.default_rng(0).bytes(16 * 500)
    (recording / "velodyne/000004.bin").write_bytes(bytes(17))
    (recording / "velodyne/000007.bin").write_bytes(garbage)
    commands = {"fuse": "fused", "views record": "scenes.npz", "views match": "matches"}
    for command, name in {**commands, "fuse ": "fused.bag"}.items():
        words = (*command.split(), recording, "-o")
        text = " ".join(fails(1, *words, tmp_path / f"bad-{name}").split())
        assert "frame 4" in text and "--skip-bad-frames" in text
        succeeds(*words, tmp_path / name, "--skip-bad-frames")
    stamps_ns = np.delete(open_dataset(recording).stamps_ns, (4, 7)).tolist()
    for name in ("fused", "fused.bag"):
        assert open_dataset(tmp_path / name).stamps_ns.tolist() == stamps_ns
    scenes = SceneSet.load(tmp_path / "scenes.npz")
    assert scenes.numbers.tolist() == [*range(4), 5, 6, *range(8, 20)]


def test_frames_have_their_number_whatever_is_missing(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    succeeds("describe", recording, "-d", "m2dp", "-o", out / "runs", *NO_WINDOW)
    (recording / "velodyne/000002.bin").unlink()
    succeeds("describe", recording, "-d", "cm2dp", "--skip-gaps", "-o", out / "runs", *NO_WINDOW)
    for name, missing in (("m2dp", ()), ("cm2dp", (2,))):
        stored = DescriptorRun.load(out / f"runs/lidar-{name}.npz")
        assert stored.numbers.tolist() == [n for n in range(FRAMES) if n not in missing]
        assert stored.frames.tolist() == list(range(FRAMES - len(missing)))
    succeeds("loops", recording, "-o", out, "--skip-gaps", *NO_WINDOW)
    pairs = [(int(row["query"]), int(row["match"])) for row in table(out / "loops.csv")]
    assert pairs == [(n, FRAMES - n) for n in range(12, FRAMES) if n != FRAMES - 2]


def test_two_windows_in_one_call_are_pointed_out(kitti: Path, tmp_path: Path) -> None:
    words = ("bench", kitti, "-d", "m2dp", "--source", "lidar", "-o", tmp_path, "--no-report")
    one = succeeds(*words, "--set", "evaluation.window=2").stderr
    assert "loop_closure.window is 50 and evaluation.window is 2" in " ".join(one.split())
    assert "loop_closure.window is" not in succeeds(*words, *NO_WINDOW).stderr


def test_tables_of_results_fit_eighty_columns(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("fusionslam.cli.console._WIDTH", 80)
    words = ("bench", kitti, "-o", tmp_path / "out", *NO_WINDOW, "--verify", "none", "--no-report")
    text = succeeds(*words).stdout
    lines = text.splitlines()[:-1]  # the last one is a path
    assert max(map(len, lines)) <= 80
    for name in fusionslam_descriptors():
        figures = [line.split() for line in lines if line.split()[:1] == [name]]
        preset = 1 if name in ("m2dp", "cm2dp") else 0
        # Accuracy and cost for each source: seven and seven figures.
        assert [len(row) - 1 - preset for row in figures] == [7, 7, 7, 7]
    assert "load" in text and "peak MiB" in text
    best = [line for line in lines if line.startswith("Best: ")]
    assert len(best) == 1 and "max F1" in best[0]


@pytest.mark.slow
def test_a_report_without_data_says_why_it_lacks_pictures(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("-d", "cm2dp", "--source", "lidar", "-o", out, *NO_WINDOW)
    succeeds("loops", recording, *words, "--threshold", "1")
    loops = (out / "loops.csv").read_bytes()
    succeeds("bench", recording, *words, "--verify", "none")
    pictured = (out / "report.html").read_text()
    assert "Pictures of frames are missing" not in pictured
    shutil.rmtree(recording)
    assert last_line(succeeds("report", out)) == str(out / "report.html")
    page = (out / "report.html").read_text()
    assert f"Pictures of frames are missing: {recording} does not exist" in page
    assert 0 < len(page) < len(pictured)
    # What another command wrote is left alone.
    assert (out / "loops.csv").read_bytes() == loops and (out / "matches.csv").stat().st_size


def test_an_interrupted_report_does_not_claim_that_nothing_was_written(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    succeeds("describe", kitti, "-d", "m2dp", "-o", tmp_path, *NO_WINDOW)
    monkeypatch.setattr("fusionslam.report.loops.page.write_figures", interrupted_at(0))
    result = run("report", tmp_path)
    assert result.exit_code == 130 and list(tmp_path.glob("distances_*"))
    assert str(tmp_path) in result.stderr
    monkeypatch.setattr("fusionslam.pipelines.compare_descriptors.find_loops", interrupted_at(0))
    result = run("eval", tmp_path)
    assert result.exit_code == 130 and "nothing was written" in result.stderr
    assert not (tmp_path / "metrics.json").exists()


def test_flags_are_flags_and_shared_texts_are_those_of_the_configuration() -> None:
    text = " ".join(succeeds("loops", "--help").stdout.split())
    assert "--verbose Show more" in text and "<bool>" not in text
    fields = fusionslam.LoopConfig.model_fields
    assert str(fields["threshold"].description) in text
    assert str(fusionslam.FusionConfig.model_fields["source"].description) in text
    text = " ".join(succeeds("eval", "--help").stdout.split())
    for name in ("radius", "window", "protocol"):
        assert str(EvaluationConfig.model_fields[name].description) in text


def test_info_sums_no_path_over_gaps_and_sees_a_calibration_without_images(recording: Path) -> None:
    for number in (4, 5):
        (recording / f"velodyne/{number:06d}.bin").unlink()
    for folder in ("image_2", "image_3"):
        shutil.rmtree(recording / folder)
    text = " ".join(succeeds("info", recording).stdout.split())
    # 19 steps of 20 m, of which 3 touch what is missing; the drive turns and comes back.
    assert "path of 320 m, 1 gap not counted" in text
    assert "no images; the calibration is there" in text


def test_doctor_fails_where_something_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FUSIONSLAM_CACHE", "/proc/nowhere")
    result = run("doctor")
    assert result.exit_code == 1
    assert "fault" in next(line for line in result.stdout.splitlines() if "cache" in line)
    monkeypatch.undo()
    succeeds("doctor")


def test_matching_and_judging_tell_how_far_they_are(kitti: Path, tmp_path: Path) -> None:
    succeeds("describe", kitti, "-d", "m2dp,cm2dp", "-o", tmp_path, *NO_WINDOW)
    steps: list[tuple[str, int, int]] = []
    evaluate_stored(tmp_path, step=lambda *step: steps.append(step))
    for name in ("m2dp", "cm2dp"):
        assert (f"matching lidar {name}", FRAMES, FRAMES) in steps
        begun, ended = (steps.index((f"judging lidar {name}", done, 1)) for done in (0, 1))
        assert begun < ended


def test_clouds_of_other_frames_are_not_mixed_in(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    succeeds("fuse", recording, "-o", out)
    before = {path: path.read_bytes() for path in out.rglob("*.*")}
    (recording / "velodyne/000002.bin").unlink()
    assert error_of(1, "fuse", recording, "-o", out, "--skip-gaps").code == "other-results"
    assert {path: path.read_bytes() for path in out.rglob("*.*")} == before


@rows("command", ["describe", "loops", "fuse"])
def test_the_first_frame_is_named_and_can_be_skipped(command: str, tmp_path: Path) -> None:
    for number in range(CHUNK + 2):
        points = np.zeros((50, 3), np.float32)
        if command == "fuse":
            points += 1e6
        write_cloud(tmp_path / f"data/{number:06d}.bin", Cloud(points))
    words = (command, tmp_path / "data", "-o", tmp_path / "out")
    line = fails(1, *words)
    assert str(tmp_path / "data/000000.bin") in line and "--skip-bad-frames" in line
    result = run(*words)
    if command != "fuse":  # frames that were not read are not counted
        assert "of those read until the error" in " ".join(result.stderr.split())
    text = fails(1, *words, "--skip-bad-frames")
    assert "frame 0" in text and "--skip-bad-frames" not in text


def test_loops_in_noise_say_why_there_are_none(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for number in range(24):
        path = tmp_path / f"bytes/{number:06d}.bin"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(rng.bytes(16 * 100))
        points = rng.uniform(-20, 20, (100, 3)).astype(np.float32)
        write_cloud(tmp_path / f"noise/{number:06d}.bin", Cloud(points))
    line = fails(1, "loops", tmp_path / "bytes", "-o", tmp_path / "out")
    assert "000000.bin" in line and "farther" in line
    words = ("-d", "shot", "--threshold", "0.05", *NO_WINDOW)
    found = succeeds("loops", tmp_path / "noise", "-o", tmp_path / "out", *words).stdout
    assert "0 loops" in found and "bench" in found and "--threshold" not in found
