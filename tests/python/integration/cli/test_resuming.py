# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: results do not depend on how they were made."""

import json
from pathlib import Path

import pytest
import yaml

import fusionslam
from bags import drive, write_bag
from cli import FRAMES, error_of, interrupted_at, run, succeeds, vectors
from fusionslam.datasets import open_dataset
from fusionslam.evaluation import DescriptorRun
from fusionslam.pipelines import describe as pipeline
from fusionslam.pipelines import export_bag
from fusionslam.pipelines.describe import CHUNK
from rows import rows


def test_an_interrupted_run_keeps_what_is_done_and_goes_on(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("describe", kitti, "-d", "cm2dp", "--jobs", "1", "-o")
    succeeds(*words, tmp_path / "whole")
    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "fuse", interrupted_at(CHUNK + 1, fusionslam.fuse))
        result = run(*words, tmp_path / "parts")
    assert result.exit_code == 130
    assert str(tmp_path / "parts") in result.stderr
    assert len(list((tmp_path / "parts").glob(".partial-*/*.npz"))) == 1
    fused: list[int] = []
    monkeypatch.setattr(
        pipeline, "fuse", lambda f, c: fused.append(f.index) or fusionslam.fuse(f, c)
    )
    succeeds(*words, tmp_path / "parts")
    assert set(range(CHUNK)).isdisjoint(fused[: FRAMES - CHUNK])
    whole, parts = (vectors(tmp_path / name / "lidar-cm2dp.npz") for name in ("whole", "parts"))
    assert whole == parts


def test_an_interrupted_bag_says_that_it_is_not_complete_and_keeps_its_part(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export_bag, "fuse", interrupted_at(3, fusionslam.fuse))
    result = run("fuse", kitti, "-o", tmp_path / "a.bag", "--jobs", "1")
    assert result.exit_code == 130
    last = result.stderr.splitlines()[-1]
    assert str(tmp_path / "a.bag") in last and "nothing" not in last
    assert len(open_dataset(tmp_path / "a.partial.bag")) == 3


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


@pytest.mark.slow
def test_the_report_names_the_configuration_of_each_run(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    succeeds("describe", kitti, "-d", "m2dp", "--set", "descriptors.preset=author", "-o", out)
    succeeds("describe", kitti, "-d", "cm2dp", "-o", out)
    succeeds("report", out)
    config = json.loads((out / "metrics.json").read_text())["config"]
    presets = {name: stages["descriptors"]["preset"] for name, stages in config.items()}
    assert presets == {"lidar / m2dp:author": "author", "lidar / cm2dp": "robust"}
    assert "m2dp author" in (out / "report.html").read_text()
    text = succeeds("eval", out).stdout
    assert "m2dp author" in text and "cm2dp robust" in text


@rows(
    "words", [("describe", "-d", "m2dp"), ("loops", "-d", "m2dp"), ("views", "match"), ("ratslam",)]
)
def test_results_are_not_written_into_the_recording(kitti: Path, words: tuple[str, ...]) -> None:
    before = sorted(path.name for path in kitti.iterdir())
    assert error_of(1, *words, kitti, "-o", kitti).code == "output-is-input"
    assert sorted(path.name for path in kitti.iterdir()) == before


def test_a_map_is_not_written_among_the_files_of_another_drive(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    succeeds("ratslam", kitti, "-o", out, "--views", "m2dp", "--no-report")
    succeeds("ratslam", kitti, "-o", out, "--views", "m2dp", "--no-report")
    write_bag(tmp_path / "other.bag", drive())
    words = ("ratslam", tmp_path / "other.bag", "-o", out, "--views", "m2dp", "--no-report")
    assert error_of(1, *words).code == "other-results"
    assert error_of(1, "loops", tmp_path / "other.bag", "-o", out).code == "other-results"
    succeeds("loops", kitti, "-o", out, "-d", "m2dp")
    (out / "run.npz").unlink()
    assert error_of(1, *words).code == "other-results"
