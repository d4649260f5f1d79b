# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Every command with every kind of DATA: it does its work, or says what it found and lacks."""

import shutil
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import artefact
from bags import changed, drive, translation, write_bag
from cli import error_of, fails, last_line, refusal, run, succeeds
from fusionslam import datasets
from fusionslam.datasets.base import OdometryOrigin, PosesOrigin
from fusionslam.datasets.streams import MissingSensorError
from fusionslam.evaluation import DescriptorRun, RatSlamRun
from fusionslam.fusion import FusionConfig
from fusionslam.loop_closure import LoopDetector
from fusionslam.pipelines.drives import open_drive
from fusionslam.pipelines.export_bag import write_cloud_bag
from fusionslam.pipelines.export_folder import write_clouds
from fusionslam.pipelines.frame_check import FrameCheck, check_frames, first_cloud
from fusionslam.pipelines.overview import look_at
from fusionslam.pipelines.recording import Recording
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import SceneSet
from fusionslam.views.scenes import SceneConfig
from kitti import COLORS, POINTS, write_sequence
from recordings import write_drive
from refusals import refuses
from rows import rows

WINDOW = ("--set", "loop_closure.window=2", "--set", "evaluation.window=2")
KINDS = ("ranges", "scenes", "scenes alone")
COMMANDS = {
    "info": ("info",),
    "fuse": ("fuse",),
    "describe": ("describe", "-d", "m2dp"),
    "loops": ("loops", "-d", "m2dp", "--threshold", "1", *WINDOW),
    "bench": ("bench", "-d", "m2dp", "--verify", "none", *WINDOW, "--no-report"),
    "views record": ("views", "record"),
    "views match": ("views", "match", "--no-report"),
    "views curve": ("views", "curve", "--set", "views.method=objects"),
    "bench views": ("bench", "views", "-m", "always_new", "--no-report"),
    "ratslam": ("ratslam", "--views", "objects", "--no-report"),
    "calib-check": ("calib-check",),
}
NEED_CLOUDS = ("fuse", "describe", "loops", "bench")
REFUSED = {
    **dict.fromkeys(product(["calib-check"], KINDS), "missing-sensor"),
    **dict.fromkeys(product(NEED_CLOUDS, KINDS[2:]), "missing-sensor"),
    ("ratslam", "scenes alone"): "no-clouds",
}
"""Codes of the errors."""


def write_kinds(folder: Path) -> None:
    data = write_drive(folder / "ranges.npz")
    succeeds("views", "record", data, "-o", folder / "scenes.npz")
    succeeds("views", "record", data, "-o", folder / "scenes alone.npz", "--only-scenes")


@pytest.fixture(scope="module")
def data() -> dict[str, Path]:
    folder = artefact("cli-kinds", write_kinds)
    return {kind: folder / f"{kind}.npz" for kind in KINDS}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@rows("command", COMMANDS)
def test_a_command_does_its_work_or_says_what_it_found(
    command: str, kind: str, data: dict[str, Path], tmp_path: Path
) -> None:
    words = [*COMMANDS[command], str(data[kind])]
    words += [] if command == "info" else ["-o", str(tmp_path / "out")]
    if refusal := REFUSED.get((command, kind)):
        assert error_of(1, *words).code == refusal
    else:
        succeeds(*words)


def test_truth_is_given_for_one_recording_only(data: dict[str, Path], tmp_path: Path) -> None:
    words = ("bench", "views", data["ranges"], data["scenes"], "-o", tmp_path / "out")
    for option in ("--gt", "--sequence"):
        assert option in fails(2, *words, option, "one")
    # An option that was not given is not blamed.
    assert "--source" not in fails(1, "fuse", data["scenes alone"], "-o", tmp_path / "out")


def test_what_is_in_a_recording_is_told_by_fields(data: dict[str, Path]) -> None:
    ranges, scenes = (Recording.at(data[kind]).open() for kind in ("ranges", "scenes"))
    assert (ranges.kind, scenes.kind) == ("ranges", "scenes")
    for dataset in (ranges, scenes):
        assert dataset.poses_origin is PosesOrigin.FILE
        assert dataset.odometry_origin is OdometryOrigin.NONE and dataset.odometry_topic is None
        assert dataset.sensors == ("points",) and len(dataset) == 24
    with pytest.raises(MissingSensorError):
        Recording.at(data["ranges"]).open("lidar")
    drives = [open_drive(data[kind]) for kind in ("ranges", "scenes")]
    ways = [drive.true_way() for drive in drives]
    assert ways[0].length_m == pytest.approx(ways[1].length_m)


FUSED = ("kitti", "folder", "bag.mcap", "bare")


def write_fused(base: Path) -> None:
    write_sequence(base / "kitti", [0, 1, 2, 3, 0, 1], [400] * 6, metres=3, width=64)
    for name in FUSED[1:]:
        succeeds("fuse", base / "kitti", "-o", base / name)
    (base / "bare" / "calib.yaml").unlink()


@pytest.fixture(scope="module")
def fused() -> dict[str, Path]:
    """A sequence in KITTI's layout, what ``fuse`` makes of it, and clouds that know no robot."""
    base = artefact("cli-fused", write_fused)
    return {name: base / name for name in FUSED}


@rows("command, name", product(["views match", "bench views", "ratslam"], FUSED))
def test_clouds_of_kitti_and_of_fuse_are_recognised_and_mapped(
    command: str, name: str, fused: dict[str, Path], tmp_path: Path
) -> None:
    result = succeeds(*COMMANDS[command], fused[name], "-o", tmp_path / "out")
    assert result.stderr.count("WARNING") == (name == "bare"), result.stderr
    assert ("fusion.frame=scan" in result.stderr) == (name == "bare")


@rows("command", ["views match", "ratslam"])
def test_what_concerns_every_frame_is_said_once_with_their_number(
    command: str, fused: dict[str, Path], tmp_path: Path
) -> None:
    below = ("--set", "fusion.ground_height=-9")
    result = succeeds(*COMMANDS[command], fused["folder"], "-o", tmp_path / "out", *below)
    (line,) = (line for line in result.stderr.splitlines() if "WARNING" in line)
    assert line.split()[:3] == ["WARNING", "6", "frames:"]
    every = run(*COMMANDS[command], fused["folder"], "-o", tmp_path / "all", *below, "--verbose")
    assert len({line for line in every.stderr.splitlines() if "WARNING" in line}) == 6


def test_fuse_says_where_its_clouds_are_on_the_robot(fused: dict[str, Path]) -> None:
    for name in ("kitti", "folder", "bag.mcap"):
        frame = datasets.open_dataset(fused[name])[0]
        np.testing.assert_allclose(frame.robot_from_points, translation(0, 0, 1.73), atol=1e-9)
    for name in ("folder", "bag.mcap"):
        overview = look_at(Recording.at(fused[name]))
        found = overview.fusion or first_cloud(datasets.open_dataset(fused[name]))
        assert found.status == "not needed"


def facts(path: Path, *check: Any) -> dict[str, str]:
    """What ``info`` tabulates."""
    return dict(look_at(Recording.at(path), *check).rows)


def test_info_says_what_stored_results_are(fused: dict[str, Path], tmp_path: Path) -> None:
    folder = fused["folder"]
    words = ("--no-report", "--views", "objects", "--save", tmp_path / "map/state.npz")
    succeeds("ratslam", folder, "-o", tmp_path / "map", *words)
    succeeds("views", "match", folder, "-o", tmp_path / "views", "--no-report")
    succeeds("describe", folder, "-o", tmp_path / "runs", "-d", "m2dp", "--set", "fusion.voxel=0.5")
    detector = LoopDetector("m2dp")
    detector.add(Cloud(datasets.open_dataset(folder)[0].points))
    detector.save(tmp_path / "loops")
    for name, format, counts in (
        ("map/state.npz", "ratslam", {"nodes", "links"}),
        ("map/run.npz", "ratslam_run", {"nodes", "links", "steps"}),
        ("map/map.json", "experience_map", {"counts"}),
        ("views/matcher.npz", "view_matcher", {"views"}),
        ("runs/cloud-m2dp.npz", "descriptor_run", {"frames"}),
        ("map", "ratslam_run", {"nodes", "files"}),
        ("views", "view_matcher", {"views"}),
        ("loops", "loop_detector", {"frames"}),
        ("runs", "work", {"command", "written", "cloud m2dp"}),
    ):
        found = facts(tmp_path / name)
        assert f"(fusionslam.{format}." in found["kind"] and counts <= found.keys()
        succeeds("info", tmp_path / name)
    found = facts(tmp_path / "runs")
    assert found["source cloud"] == "fusion.voxel=0.5" and "demo" not in found
    assert str(folder) in found["dataset"] and found["cloud m2dp"].startswith("6 ")
    state = tmp_path / "map/state.npz"
    error = error_of(1, "fuse", state, "-o", tmp_path / "out")
    assert (error.code, error.fields) == ("no-recording", (str(state), "fusionslam.ratslam.1"))
    assert facts(tmp_path / "runs/cloud-m2dp.npz")["frames"] == "6"


def test_info_reads_all_frames_if_asked_and_names_those_that_are_damaged(tmp_path: Path) -> None:
    root = write_sequence(tmp_path, [0, 1, 2, 3, 4], [300, 0, 300, 400, 300], metres=3, width=64)
    (root / "velodyne/000004.bin").write_bytes(b"123")
    (root / "image_2/000002.png").write_bytes((root / "image_2/000002.png").read_bytes()[:400])
    scan = np.fromfile(root / "velodyne/000003.bin", np.float32)
    scan[:400:4] = np.nan
    scan.tofile(root / "velodyne/000003.bin")
    scan[:900] = 0
    scan[:1200].tofile(root / "velodyne/000002.bin")
    (root / "velodyne/000000.bin").write_bytes(np.random.default_rng(0).bytes(16 * 300))
    assert "--all" in facts(tmp_path)["checked"]
    checks: list[FrameCheck] = []

    def check(dataset: datasets.Dataset) -> list[FrameCheck]:
        checks.extend(check_frames(dataset, jobs=2))
        return checks

    found = facts(tmp_path, check)
    assert {c.number: (*c.errors,) for c in checks if c.errors} == {
        **{0: ("points",), 2: ("left",), 4: ("points",)}
    }
    assert checks[0].errors["points"].code == "far-points"
    assert [c.at_scanner for c in checks] == [0, 0, 225, 0, 0]
    assert [c.points for c in checks] == [300, 0, 300, 400, None]
    assert [c.invalid for c in checks][1:] == [0, 0, 100, 0]
    assert {"frame 2", "frame 4"} <= found.keys() and "000004.bin" in found["frame 4"]
    assert "1" in found["empty scans"] and "25.0%" in found["invalid points"]
    assert "75.0%" in found["no distance"] and found["no distance"].endswith("1 frame: 2")
    printed = succeeds("info", tmp_path, "--all")
    assert "000002.png" in printed.stdout


@rows("file", ["image_2/000000.png", "velodyne/000000.bin"])
def test_info_lists_a_first_frame_that_is_cut_with_the_reason(file: str, tmp_path: Path) -> None:
    root = write_sequence(tmp_path, [0, 1], [300, 300], metres=3, width=64)
    (root / file).write_bytes((root / file).read_bytes()[:21])
    for words in ((), ("--all",)):
        assert file in "".join(succeeds("info", tmp_path, *words).stdout.split())
        found = facts(tmp_path, check_frames if words else None)
        assert file in found["frame 0"] and found["sensor points"].startswith("2 files")


def test_info_names_scans_of_far_fewer_points_or_in_another_unit_or_type(tmp_path: Path) -> None:
    few = tmp_path / "few"
    write_sequence(few, [0, 1, 2, 3], [300, 74, 301, 300], metres=3, width=64)
    found = facts(few, check_frames)
    assert found["small scans"].endswith("1 frame: 1") and "0 cannot be read" in found["checked"]
    root = write_sequence(tmp_path / "unit", [0, 1, 2], [300] * 3, metres=3, width=64)
    scan = np.random.default_rng(0).uniform(1, 9, (300, 4)).astype(np.float32)
    (1000 * scan).tofile(root / "velodyne/000001.bin")
    scan.astype(np.float64).tofile(root / "velodyne/000002.bin")
    found = facts(tmp_path / "unit", check_frames)
    assert found["distant points"].endswith("1 frame: 1") and "frame 2" in found


@rows("name", ["out", "out.mcap"])
def test_fuse_names_empty_scans(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_sequence(tmp_path / "kitti", [0, 1, 2], [300, 0, 300], metres=3, width=64)
    write = write_clouds if name == "out" else write_cloud_bag
    assert write(Recording.at(tmp_path / "kitti"), tmp_path / name, FusionConfig()) == 3
    (record,) = (record for record in caplog.records if record.levelname == "WARNING")
    assert record.args == ("KITTI odometry 03", 1, 3, "", "1")


@rows("suffix", [".xyz", ".rosbag", ".ply"])
def test_names_of_files_that_are_not_written_are_refused(
    suffix: str, fused: dict[str, Path], tmp_path: Path
) -> None:
    output = tmp_path / f"out{suffix}"
    for words in (("fuse", fused["kitti"]), ("sim", "house")):
        error = error_of(2, *words, "-o", output)
        assert error.code == "suffix" and {suffix, ".bag", ".db3", ".mcap"} <= {*error.fields}
    assert not output.exists()
    succeeds("fuse", fused["kitti"], "-o", output, "--format", "pcd")
    assert len(datasets.open_dataset(output)) == 6


def test_a_world_is_recorded_and_then_read_as_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rosbags")
    bag = write_bag(tmp_path / "warehouse-1.bag", drive())
    asked: list[str] = []

    def record_world(world: Path, **_: object) -> Path:
        asked.append(str(world))
        return bag

    monkeypatch.setattr("fusionslam.sim.recordings.record_world", record_world)
    world = tmp_path / "place.glb"
    world.write_bytes(b"")
    for name in ("warehouse", world):
        assert "warehouse-1.bag" in run("info", name).stdout
        succeeds("fuse", name, "-o", tmp_path / "out")
    assert set(asked) == {"warehouse", str(world)}
    assert refusal(1, "info", "hous") == ("no-such-data", "house")


@rows(
    "words",
    [
        ("describe", "-d", "m3dp"),
        ("describe", "--set", "fusion.bogus=1"),
        ("loops", "--source", "sonar"),
        ("bench", "--stamps", "late"),
        ("fuse", "--topic", "point=/x"),
        ("views", "match", "--rule", "mine"),
        ("views", "record", "--tuned", "nobody"),
        ("views", "match", "--set", "views.threshold=1.5"),
        ("ratslam", "--views", "nobody"),
        ("ratslam", "--odometry", "wheels"),
        ("ratslam", "--set", "ratslam.cells.size=5"),
        ("calib-check", "--config", "missing.yaml"),
    ],
)
def test_options_are_checked_before_a_world_is_recorded(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.sim.recordings.record_world", pytest.fail)
    fails(2, *words, "warehouse", "-o", tmp_path / "out")


@pytest.fixture(scope="module")
def driven() -> Path:
    pytest.importorskip("rosbags")
    return artefact("cli-driven", write_driven) / "drive.bag"


def write_driven(folder: Path) -> None:
    """A bag with odometry and without ground truth, and poses.txt, its true poses."""
    rng = np.random.default_rng(5)
    points = rng.uniform((2, -3, -0.2), (6, 3, 1), (300, 3)).astype(np.float32)
    path = write_bag(folder / "drive.bag", changed(drive(4.0), "/points", points=points, fields={}))
    dataset = datasets.open_dataset(path)
    assert dataset.poses is not None and dataset.true_poses is None
    datasets.write_poses_tum(folder / "poses.txt", dataset.stamps_ns, dataset.poses)


@pytest.mark.slow
@rows("command", ["views match", "views curve", "bench", "bench views", "ratslam"])
def test_nothing_is_judged_by_odometry(command: str, driven: Path, tmp_path: Path) -> None:
    words = [*COMMANDS[command], driven, "-o", tmp_path / "out"]
    if command in ("views curve", "bench views"):
        assert error_of(1, *words).code == "no-poses"
    else:
        result = succeeds(*words)
        assert result.stderr.count("--gt") == 1
        assert "no true poses" in result.stdout
    if command != "bench views":  # compares several recordings and takes no file of poses
        judged = succeeds(*words, "--gt", driven.parent / "poses.txt")
        assert "no true poses" not in judged.stdout and "--gt" not in judged.stderr


def test_odometry_does_not_become_truth_where_it_is_written(driven: Path, tmp_path: Path) -> None:
    succeeds("describe", driven, "-d", "m2dp", "-o", tmp_path / "runs")
    assert DescriptorRun.load(tmp_path / "runs/lidar-m2dp.npz").poses is None
    succeeds("fuse", driven, "-o", tmp_path / "fused")
    assert datasets.open_dataset(tmp_path / "fused").poses is None
    stamps, _ = datasets.read_poses(tmp_path / "fused/odometry.txt")
    assert stamps is not None and len(stamps) == 9


def test_odometry_that_fuse_writes_is_that_of_a_map(driven: Path, tmp_path: Path) -> None:
    succeeds("fuse", driven, "-o", tmp_path / "fused")
    bag, folder = datasets.open_dataset(driven), datasets.open_dataset(tmp_path / "fused")
    assert bag.poses is not None and folder.true_poses is None
    moved = folder.motion("odometry")
    assert [each.stamp_ns for each in moved] == bag.stamps_ns.tolist()
    np.testing.assert_allclose([m.pose for m in moved], bag.poses @ bag.body_from_robot, atol=1e-6)
    succeeds(*COMMANDS["ratslam"], folder.root, "-o", tmp_path / "map")
    run = RatSlamRun.load(tmp_path / "map/run.npz")
    assert run.truth is None and len(run.stamps_ns) == 18  # nine poses and nine scans
    # Clouds in the frame of odometry do not move with the robot.
    succeeds("fuse", driven, "-o", tmp_path / "still", "--set", "fusion.frame=odometry")
    assert not (tmp_path / "still/odometry.txt").exists()
    (folder.root / "odometry.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    error = error_of(1, *COMMANDS["ratslam"], folder.root, "-o", tmp_path / "other")
    assert "odometry.txt" in str(error)


def test_odometry_of_another_time_is_refused_and_shown(driven: Path, tmp_path: Path) -> None:
    succeeds("fuse", driven, "-o", tmp_path / "fused")
    folder = datasets.open_dataset(tmp_path / "fused")
    path = folder.root / "odometry.txt"

    def row() -> str:
        return facts(folder.root)["odometry"]

    stamps_ns, poses = datasets.read_poses_tum(path)
    assert f"{len(poses)} poses" in row() and f"{stamps_ns[-1] / 1e9:.3f} s" in row()
    datasets.write_poses_tum(path, stamps_ns + 10**12, poses)
    command = (*COMMANDS["ratslam"], folder.root, "-o", tmp_path / "map")
    assert error_of(1, *command).code == "other-time"
    # Without times the frames' are assumed, and only odometry of just these times fits them.
    (folder.root / "times.txt").unlink()
    datasets.write_poses_tum(path, stamps_ns + 1, poses)
    assert error_of(1, *command).code == "no-times" and str(path) in row()
    datasets.write_poses_tum(path, np.arange(len(poses)) * 10**8, poses)
    assert len(datasets.open_dataset(folder.root).motion("odometry")) == len(poses)


@pytest.mark.slow
@rows(
    "command, page",
    [("views match", "views.html"), ("bench", "report.html"), ("ratslam", "ratslam.html")],
)
def test_no_page_of_earlier_results_stays_beside_new_ones(
    command: str, page: str, fused: dict[str, Path], tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    words = [word for word in COMMANDS[command] if word != "--no-report"]
    words += [str(fused["folder"]), "-o", str(tmp_path)]
    assert last_line(succeeds(*words)) == str(tmp_path / page)
    assert last_line(succeeds(*words, "--no-report")) != str(tmp_path / page)
    assert not list(tmp_path.glob("*.html"))


@pytest.fixture(scope="module")
def colorless() -> Path:
    return artefact("cli-colorless", write_colorless) / "sequences" / "03"


def write_colorless(folder: Path) -> None:
    """Scans in KITTI's layout, numbered from 720 on, without images."""
    root = write_sequence(folder, [0, 1, 2, 3, 0, 1], [400] * 6, metres=3, width=64)
    for name in ("image_2", "image_3"):
        shutil.rmtree(root / name)
    (root / "times.txt").write_text("".join(f"{0.1 * n:e}\n" for n in range(726)))
    poses = folder / "poses/03.txt"
    lines = poses.read_text().splitlines(keepends=True)
    poses.write_text("".join([*lines[:1] * 720, *lines]))
    for number in range(6):
        path = root / f"velodyne/{number:06d}.bin"
        path.rename(path.with_name(f"{number + 720:06d}.bin"))


@rows(
    "words",
    [
        ("views", "match", "--no-report"),
        ("views", "curve"),
        ("ratslam", "--no-report"),
        ("loops", *WINDOW),
    ],
)
def test_without_colours_the_default_is_one_that_needs_none(
    words: tuple[str, ...], colorless: Path, tmp_path: Path
) -> None:
    result = succeeds(*words, colorless, "-o", tmp_path / "out")
    (line,) = (line for line in result.stderr.splitlines() if "WARNING" in line)
    assert "m2dp" in line.split()


def test_clouds_without_colours_are_stored_and_matched(colorless: Path, tmp_path: Path) -> None:
    succeeds("views", "record", colorless, "-o", tmp_path / "set.npz")
    kept = SceneSet.load(tmp_path / "set.npz")
    assert kept.clouds is not None and kept.clouds.colors is None and not kept.has_colors
    assert kept.clouds[5].colors is None and len(kept.clouds[5])
    succeeds("views", "match", tmp_path / "set.npz", "-o", tmp_path / "out", "--no-report")
    with refuses("no-colors"):
        kept.scenes_with(SceneConfig())


@rows(
    "words, cure",
    [
        (("views", "match", "--set", "views.method=alignment"), "views.method=m2dp"),
        (("ratslam", "--views", "alignment", "--no-report"), "--views m2dp"),
        (("loops", "-d", "cm2dp:author"), "m2dp:author"),
        (("describe", "-d", "cshot"), "shot"),
        (("bench", "-d", "cm2dp,cshot"), "m2dp,shot"),
    ],
)
def test_what_needs_colours_is_refused_with_what_does_not(
    words: tuple[str, ...], cure: str, colorless: Path, tmp_path: Path
) -> None:
    error = error_of(1, *words, colorless, "-o", tmp_path / "out")
    assert error.code == "no-colors"
    said = run(*words, colorless, "-o", tmp_path / "out")
    assert "WARNING" not in said.stderr  # the reason is given once
    if words[0] not in ("ratslam", "bench"):  # which name their frames by stamps, or none
        assert "720" in str(error)
    if "-d" in words:
        assert said.stderr.rstrip().split("; ")[-1].startswith(f"--descriptors {cure} ")
    if "bench" in words:
        assert error.fields == (words[-1], cure)
    else:
        assert cure in str(error)


def test_a_later_frame_without_colours_can_be_left_out(tmp_path: Path) -> None:
    for number in range(3):
        path = tmp_path / f"my/clouds/{number}.ply"
        path.parent.mkdir(parents=True, exist_ok=True)
        datasets.write_cloud(path, Cloud(POINTS, None if number == 1 else COLORS))
    words = ("describe", tmp_path / "my", "-d", "cm2dp", "-o", tmp_path / "out")
    assert error_of(1, *words).code == "no-colors"
    said = run(*words).stderr
    assert "--skip-bad-frames" in said and "info --all" not in said
    succeeds(*words, "--skip-bad-frames")
