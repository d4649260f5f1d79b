# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: what each command writes."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli import (
    NO_WINDOW,
    TINY_TOWN,
    error_of,
    fusionslam_descriptors,
    last_line,
    refusal,
    settings,
    succeeds,
    table,
)
from fusionslam import LoopConfig, LoopDetector, describe_dataset
from fusionslam.datasets import open_dataset, write_poses_tum
from fusionslam.evaluation import DescriptorRun, evaluate
from fusionslam.evaluation.loops import published
from fusionslam.pipelines import describe as pipeline
from fusionslam.pipelines.compare_descriptors import evaluate_stored, stored_threshold
from fusionslam.pipelines.loops import find_loops
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work, forget_demo, load_runs
from rows import rows

UNVERIFIED = ("--verify", "none", "--source", "lidar")


@pytest.fixture(scope="module")
def described(kitti: Path, tmp_path_factory: pytest.TempPathFactory) -> DescriptorRun:
    (run,) = describe_dataset(open_dataset(kitti), ["m2dp"], tmp_path_factory.mktemp("run"))
    return run


@pytest.mark.slow
@rows(
    "words, files",
    [
        (("info", "DATA/../..", "--sequence", "3"), ()),
        (("fuse", "DATA", "-o", "OUT", "--format", "pcd"), ("clouds/000019.pcd", "run.json")),
        (("fuse", "DATA", "-o", "OUT", "--format", "bin"), ("clouds/000019.bin", "poses.txt")),
        (("describe", "DATA", "-o", "OUT", "-j", "1"), ("lidar-shot.npz", "lidar-cshot.npz")),
        (("config",), ()),
        (("config", "sim"), ()),
        (("config", "fusion", "--yaml"), ()),
    ],
)
def test_each_command_writes_what_it_promises(
    kitti: Path, tmp_path: Path, words: tuple[str, ...], files: tuple[str, ...]
) -> None:
    out = tmp_path / "out"
    succeeds(*(word.replace("DATA", str(kitti)).replace("OUT", str(out)) for word in words))
    for file in files:
        assert (out / file).stat().st_size > 0


def test_fused_clouds_are_opened_and_described_alike(kitti: Path, tmp_path: Path) -> None:
    succeeds("fuse", kitti, "-o", tmp_path / "clouds")
    succeeds("describe", kitti, "-d", "cm2dp", "-o", tmp_path / "first")
    succeeds("describe", tmp_path / "clouds", "-d", "cm2dp", "-o", tmp_path / "second")
    first = DescriptorRun.load(tmp_path / "first/lidar-cm2dp.npz")
    second = DescriptorRun.load(tmp_path / "second/cloud-cm2dp.npz")
    assert first.descriptors.tobytes() == second.descriptors.tobytes()
    assert np.array_equal(first.stamps_ns, second.stamps_ns)
    assert first.positions is not None and second.positions is not None
    assert np.allclose(first.positions, second.positions)


def test_loops_of_each_descriptor_and_preset_are_listed(kitti: Path, tmp_path: Path) -> None:
    words = ("loops", kitti, "-o", tmp_path, "--threshold", "0.05", *NO_WINDOW)
    succeeds(*words, "-d", "m2dp,cm2dp:author,m2dp:robust")
    assert {path.name for path in tmp_path.glob("*.csv")} == {
        "loops-m2dp.csv", "loops-cm2dp-author.csv"
    }  # fmt: skip
    succeeds(*words, "--descriptor", "cm2dp:author")  # as version 0.1 spelled it
    both = [(tmp_path / name).read_text() for name in ("loops.csv", "loops-cm2dp-author.csv")]
    assert both[0] == both[1]


@pytest.mark.slow
def test_loops_are_those_of_a_detector_with_its_default(kitti: Path, tmp_path: Path) -> None:
    succeeds("loops", kitti, "-d", "m2dp:paper", "-o", tmp_path, *NO_WINDOW)
    detector = LoopDetector("m2dp:paper", window=2)
    found = [loop for frame in open_dataset(kitti) if (loop := detector.add(frame))]
    assert [(row["query"], row["match"]) for row in table(tmp_path / "loops.csv")] == [
        (str(loop.query), str(loop.match)) for loop in found
    ]
    assert found


def test_a_run_without_loops_knows_the_threshold_of_the_nearest(described: DescriptorRun) -> None:
    for window in (2, 18):  # the nearest is at 0, and elsewhere
        nothing = find_loops(described, LoopConfig(threshold=0, window=window))
        advised = nothing.threshold_of_nearest
        assert advised is not None
        again = find_loops(described, LoopConfig(threshold=advised, window=window))
        assert again.loops and again.best == nothing.best
    assert not nothing.loops and "--threshold" in str(nothing)
    signs = np.where(np.arange(len(described))[:, None] == 19, -1, 1).astype(np.float32)
    unlike = replace(described, descriptors=signs * np.abs(described.descriptors))
    found = find_loops(unlike, LoopConfig(threshold=0, window=18))
    assert not found.loops and "--threshold" not in str(found)


@rows("count, advice", [(1, None), (19, None), (20, 5)])
def test_a_window_is_advised_only_where_it_gives_candidates(
    kitti: Path, tmp_path: Path, count: int, advice: int | None
) -> None:
    (run,) = describe_dataset(open_dataset(kitti)[:count], ["m2dp"], tmp_path)
    found = find_loops(run, LoopConfig(window=50))
    words = str(found)
    assert ("loop_closure.window" in words) == (advice is not None)
    if advice is not None:
        assert words.endswith(f"--set loop_closure.window={advice}")
        assert find_loops(run, LoopConfig(window=advice)).without_candidates < count


def test_the_threshold_of_a_bench_is_that_of_its_precision(kitti: Path, tmp_path: Path) -> None:
    stored, out = tmp_path / "stored", tmp_path / "out"
    near = (*NO_WINDOW, "--set", "evaluation.radius=5")
    succeeds("describe", kitti, "-d", "m2dp,m2dp:paper", "-o", stored, *near)
    words = ("loops", kitti, "-o", out, "--threshold", stored, *NO_WINDOW)
    for name in ("m2dp", "m2dp:paper"):
        (run,) = [each for each in load_runs(stored) if each.name == name]
        curve = evaluate(run, radius=5, window=2).curves["revisit"]
        right = curve.accepted(stored_threshold(stored, run.source, run.name))
        assert curve.correct[right].mean() >= 0.95 > curve.correct[curve.matches >= 0].mean()
        succeeds(*words, "-d", name)
        queries = [int(row["query"]) for row in table(out / "loops.csv")]
        assert queries == np.flatnonzero(right).tolist()
    assert refusal(1, *words, "-d", "cm2dp") == ("no-runs", str(stored), "lidar", "cm2dp")
    assert refusal(2, *words, "--threshold", "near") == ("choice", "--threshold", "near")
    # A window that is longer than the drive leaves no revisits.
    succeeds("describe", kitti, "-d", "m2dp", "-o", tmp_path / "short")
    words = ("loops", kitti, "-d", "m2dp", "-o", tmp_path / "new", "--threshold")
    error = error_of(1, *words, tmp_path / "short")
    assert (error.code, error.fields) == ("no-revisits", (str(tmp_path / "short"), "lidar", "m2dp"))
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
@rows("radius, count", [(60, 0), (61, 1)])
def test_a_radius_that_makes_every_frame_a_revisit_is_warned_of_once(
    kitti: Path, tmp_path: Path, radius: int, count: int
) -> None:
    # On the way there, 200 m, the nearest candidate of a frame is 60 m away.
    judged = (*UNVERIFIED, *NO_WINDOW, "--set", f"evaluation.radius={radius}")
    loops = ("loops", kitti, "-d", "m2dp", "--threshold", tmp_path, "-o", tmp_path / "loops")
    for words in (
        ("bench", kitti, "-d", "m2dp,m2dp:paper", "-o", tmp_path, *judged, "--no-report"),
        ("eval", tmp_path),
        (*loops, *NO_WINDOW),
    ):
        said = " ".join(succeeds(*words).stderr.split())
        assert said.count("evaluation.radius") == count, said
        assert all(text in said for text in ("17 frames", "61 m", "200.0 m")) or not count


def test_an_early_return_within_the_window_is_no_matter_of_the_radius(
    described: DescriptorRun, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    # All rounds after the first, which the window excludes, are revisits.
    angles = np.radians(90.0 * np.arange(len(described)))
    poses = np.tile(np.eye(4), (len(described), 1, 1))
    poses[:, :2, 3] = 20 * np.c_[np.cos(angles), np.sin(angles)]
    replace(described, poses=poses).save(tmp_path / "lidar-m2dp.npz")
    for radius, warned in ((5, 0), (15, 1)):
        caplog.clear()
        ((evaluation,), _) = evaluate_stored(tmp_path, {"radius": radius, "window": 3})
        curve = evaluation.curves["revisit"]
        assert curve.revisit[4:].all() and len(caplog.records) == warned


def test_frames_with_a_descriptor_of_zeros_match_nothing(described: DescriptorRun) -> None:
    with_blanks = described.descriptors.copy()
    with_blanks[[3, 15]] = 0
    run = replace(described, descriptors=with_blanks, numbers=described.numbers + 700)
    found = find_loops(run, LoopConfig(threshold=9, window=2))
    assert found.blank.tolist() == [703, 715] and "703, 715" in str(found)
    assert found.without_candidates == 3
    assert len(found.loops) == len(run) - 5
    assert not {3, 15} & {row for loop in found.loops for row in (loop.query, loop.match)}
    curve = evaluate(run, window=2).curves["revisit"]
    assert curve.matches[[3, 15]].tolist() == [-1, -1]
    for each in (run, found, curve, evaluate(run)):
        assert "\n" not in repr(each) and len(repr(each)) < 300


@pytest.mark.slow
def test_bench_compares_presets_in_one_table(kitti: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    words = ("bench", kitti, "-d", "m2dp:author,m2dp,cshot", *UNVERIFIED, "-o", tmp_path)
    text = succeeds(*words, *NO_WINDOW)
    for label in ("m2dp author", "m2dp robust", "cshot"):
        assert label in text.stdout
    runs = json.loads((tmp_path / "metrics.json").read_text())["runs"]
    assert [(run["descriptor"], run["preset"]) for run in runs] == [
        ("m2dp", "author"), ("m2dp", "robust"), ("cshot", None)
    ]  # fmt: skip
    matched = {row["descriptor"] for row in table(tmp_path / "matches.csv")}
    assert matched == {"m2dp:author", "m2dp", "cshot"}
    times = [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("descriptors/*.npz"))]
    succeeds(*words, *NO_WINDOW, "--no-report")
    again = [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("descriptors/*.npz"))]
    assert len(times) == 3 and again == times  # reused


def test_a_recording_without_revisits_is_not_judged(kitti: Path, tmp_path: Path) -> None:
    text = succeeds("bench", kitti, "-d", "m2dp", "-o", tmp_path / "out", "--no-report").stdout
    assert "window 50" in text and "top-1" not in text and "peak MiB" in text
    assert "LiDAR-camera" in text and "Stereo" in text
    for file in ("metrics.json", "run.json", "descriptors/stereo-m2dp.npz"):
        assert (tmp_path / "out" / file).stat().st_size > 0


def test_a_second_threshold_uses_the_descriptors_of_the_first(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("loops", kitti, "-d", "m2dp", "-o", tmp_path / "out", *NO_WINDOW)
    succeeds(*words, "--threshold", "1")
    monkeypatch.setattr(pipeline, "fuse", pytest.fail)
    assert "17 loops" in succeeds(*words, "--threshold", "2").stdout


def test_eval_judges_by_the_protocol_and_radius_given(kitti: Path, tmp_path: Path) -> None:
    succeeds("describe", kitti, "-d", "cm2dp", "-o", tmp_path, *NO_WINDOW)
    result = succeeds("eval", tmp_path, "--protocol", "revisit", "--radius", "5")
    assert "radius 5 m, window 2: 8 revisits in 20 frames" in result.stdout
    assert last_line(result) == str(tmp_path / "metrics.json")
    (judged,) = json.loads((tmp_path / "metrics.json").read_text())["runs"]
    assert judged["protocols"]["revisit"]["top1"] == 1
    assert judged["protocols"]["perdomo2019"]["radius"] == 5
    succeeds("eval", tmp_path, "--set", "evaluation.window=3", "--set", "evaluation.radius=4")
    (judged,) = json.loads((tmp_path / "metrics.json").read_text())["runs"]
    chosen = judged["protocols"]["revisit"]
    assert (chosen["window"], chosen["radius"]) == (3, 4)
    assert refusal(2, "eval", tmp_path, "--set", "fusion.voxel=1") == ("unknown-key", "fusion")


def test_eval_takes_other_true_poses_by_frame_number(recording: Path, tmp_path: Path) -> None:
    (recording / "velodyne/000004.bin").unlink()
    truth = (recording.parent.parent / "poses/03.txt").rename(tmp_path / "truth.txt")
    out = tmp_path / "out"
    succeeds("describe", recording, "-d", "m2dp", "-o", out, "--skip-gaps", *NO_WINDOW)
    assert "--gt" in succeeds("eval", out).stdout
    # Frame 16 has nothing left to come back to.
    text = succeeds("eval", out, "--gt", truth).stdout
    assert "7 revisits in 19 frames" in text


def test_eval_keeps_its_figures_where_poses_cannot_be_used(kitti: Path, tmp_path: Path) -> None:
    out, given = tmp_path / "out", tmp_path / "other.txt"
    succeeds("describe", kitti, "-d", "m2dp", "-o", out, *NO_WINDOW)
    succeeds("eval", out)
    before = (out / "metrics.json").read_bytes()
    truth = (kitti.parent.parent / "poses/03.txt").read_text().splitlines()
    given.write_text("\n".join([*truth, truth[-1]]))
    assert refusal(1, "eval", out, "--gt", given) == ("other-drive", str(given), "21", "20")
    # Poses of a car that never comes back: as many, but nothing to judge.
    for metres, count in ((100, 0), (2000, 1)):
        given.write_text("".join(f"1 0 0 0 0 1 0 0 0 0 1 {metres * n}\n" for n in range(20)))
        said = " ".join(succeeds("eval", out, "--gt", given).stderr.split())
        assert said.count("2000 m apart (median): expected poses in metres") == count
        assert str(out / "metrics.json") in said
        assert (out / "metrics.json").read_bytes() == before
    # A slower truth leaves out the frame after its last pose.
    dataset = open_dataset(kitti)
    assert dataset.poses is not None and len(dataset) == 20
    write_poses_tum(given, dataset.stamps_ns[::2], dataset.poses[::2])
    result = succeeds("eval", out, "--gt", given)
    assert "7 revisits in 19 frames" in result.stdout and "1 of 20" in result.stderr


@pytest.mark.nightly
def test_bench_compares_both_sources_and_ends_with_the_report(kitti: Path, tmp_path: Path) -> None:
    result = succeeds("bench", kitti, "-o", tmp_path / "out", *NO_WINDOW)
    for name in ("LiDAR-camera", "Stereo", *fusionslam_descriptors()):
        assert name in result.stdout
    assert last_line(result) == str(tmp_path / "out/report.html")
    every = json.loads((tmp_path / "out/metrics.json").read_text())["runs"]
    runs = [run for run in every if not run["verified"]]
    assert len(runs) == 2 * len(fusionslam_descriptors())
    assert [run["source"] for run in every if run["verified"]] in ([], ["lidar", "stereo"])
    assert all(set(r["protocols"]) == {"revisit", "perdomo2019"} for r in runs)
    assert all("match" in r["costs"]["stages"] for r in runs)


def test_figures_published_for_kitti_stand_beside_those_of_that_whole_sequence(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = recording.rename(recording.with_name("06"))
    (recording.parent.parent / "poses/03.txt").rename(recording.parent.parent / "poses/06.txt")
    common = ("bench", recording, "-d", "cm2dp", "--no-report", "--verify", "none", "-o")
    words = (*common, tmp_path / "out")
    assert "0.825" not in succeeds(*words).stdout
    monkeypatch.setitem(published.FRAMES, "06", len(open_dataset(recording)))
    text = " ".join(succeeds(*words).stdout.split())
    assert "0.825" in text and "0.502" in text
    (recording.parent.parent / "sim.json").write_text("{}")
    assert "0.825" not in succeeds(*common, tmp_path / "simulated").stdout


@pytest.mark.slow
def test_bench_judges_by_the_protocol_of_another_paper(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = recording.rename(recording.with_name("00"))
    (recording.parent.parent / "poses/03.txt").rename(recording.parent.parent / "poses/00.txt")
    monkeypatch.setitem(published.FRAMES, "00", len(open_dataset(recording)))
    out = tmp_path / "out"
    words = ("bench", recording, "-d", "m2dp,scan_context", "--source", "lidar", "-o", out)
    said = " ".join(succeeds(*words, "--no-report", "--protocol", "ssc", *NO_WINDOW).stdout.split())
    assert "protocol ssc, radius 3 m, window 2: " in said and "BoW3D" in said
    assert "Scan Context, published 0.750 0.609" in said
    (m2dp, _) = json.loads((out / "metrics.json").read_text())["runs"]
    assert list(m2dp["protocols"]) == ["ssc"] and m2dp["by_direction"] == {}
    assert m2dp["protocols"]["ssc"]["n_revisits"] == 8  # out and back, frame by frame 20 m
    assert "M2DP" in [peer["method"] for peer in m2dp["peers"]]

    again = " ".join(succeeds("eval", out, "--protocol", "solid", "--window", 2).stdout.split())
    assert "protocol solid, radius 10 m, window 2: 8 revisits in 20 frames" in again
    assert "RING++, published 0.954 0.997 0.937" in again
    succeeds("report", out, "--protocol", "scancontext", "-o", tmp_path / "page")
    runs = json.loads((tmp_path / "page/metrics.json").read_text())["runs"]
    assert [list(run["protocols"]) for run in runs] == [["scancontext"]] * 2
    assert runs[0]["protocols"]["scancontext"]["radius"] == 4


@pytest.mark.nightly
def test_the_quick_demo_judges_revisits_of_the_town(tmp_path: Path) -> None:
    pytest.importorskip("embreex")
    sensors = settings(*(setting for setting in TINY_TOWN if "sim.car" in setting))
    out = succeeds("demo", "--quick", "-o", tmp_path, "--no-report", *sensors).stdout
    assert int(re.search(r"(\d+) revisits", out)[1]) > 20
    simulated = json.loads((tmp_path / "drive/sim.json").read_text())["config"]
    assert simulated["car"]["lidar"]["rings"] == 16 and simulated["town"]["blocks"] == [1, 1]
    error = error_of(2, "demo", "--quick", "--world", "house", "-o", tmp_path / "house")
    assert (error.code, error.fields) == ("choice", ("--quick", "house"))


@pytest.mark.slow
def test_the_demo_drives_a_robot_through_an_indoor_world_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("embreex")
    pytest.importorskip("rosbags")
    monkeypatch.setenv("FUSIONSLAM_CACHE", str(tmp_path / "cache"))
    short = ("--set", "sim.seconds=5", "--set", "sim.plan.length_m=10")
    words = ("demo", "--world", "house", "-o", tmp_path / "out", *short)
    assert last_line(succeeds(*words)) == str(tmp_path / "out/report.html")
    (bag,) = (tmp_path / "cache").iterdir()
    assert len(open_dataset(bag)) == 10
    written = bag.stat().st_mtime_ns
    succeeds(*words, "--no-report")
    assert bag.stat().st_mtime_ns == written
    work = Work.load(tmp_path / "out")
    assert work is not None and work.recording.path == str(bag)
    assert work.configs["lidar"]["evaluation"]["radius"] == 0.8


@pytest.mark.slow
def test_the_demo_does_not_replace_results_of_a_real_recording(kitti: Path, tmp_path: Path) -> None:
    pytest.importorskip("embreex")
    out, tiny = tmp_path / "out", settings(*TINY_TOWN)
    succeeds("describe", kitti, "-d", "m2dp", "-o", out)
    before = {path: path.read_bytes() for path in out.iterdir()}
    assert refusal(1, "demo", "-o", out, *tiny) == ("other-results", str(out), "KITTI odometry 03")
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    # Without run.json nothing tells whose the run is but the run itself.
    (out / "run.json").unlink()
    (out / "descriptors").mkdir()
    kept = (out / "lidar-m2dp.npz").rename(out / "descriptors/lidar-m2dp.npz")
    assert refusal(1, "demo", "-o", out, *tiny) == ("other-results", str(kept), "KITTI odometry 03")
    assert kept.read_bytes() == before[out / "lidar-m2dp.npz"]


def test_the_demo_replaces_only_earlier_demos(described: DescriptorRun, tmp_path: Path) -> None:
    replace(described, dataset="simulated drive").save(tmp_path / "lidar-m2dp.npz")
    replace(described, dataset="KITTI 06").save(tmp_path / "lidar-cm2dp.npz")
    np.savez(tmp_path / "lidar-mine.npz", mine=np.eye(3))
    np.savez(tmp_path / "my-own.npz", mine=np.eye(3))
    old = Work(Recording("/drives/one"), "simulated drive", configs={"lidar": {}}, demo=True)
    old.save(tmp_path)
    forget_demo(tmp_path, Recording("/drives/two"))
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"lidar-cm2dp.npz", "lidar-mine.npz", "my-own.npz"}


@rows(
    "words, module, extra",
    [
        (("demo",), "embreex", "sim"),
        (("bench", "."), "matplotlib", "report"),
        (("report", "."), "jinja2", "report"),
    ],
)
def test_a_missing_extra_is_named_with_the_line_that_installs_it(
    words: tuple[str, ...], module: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.cli.failures.find_spec", lambda name: name != module or None)
    assert refusal(1, *words) == ("missing-extra", extra)


def test_a_cache_that_cannot_be_written_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("FUSIONSLAM_CACHE", str(tmp_path / "file"))
    assert error_of(1, "demo", "-o", tmp_path / "out").code == "cache"
