# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: what it says when it cannot do what is asked."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from cli import FRAMES, error_of, fails, run, succeeds
from fusionslam.datasets import write_cloud
from fusionslam.pipelines import describe as pipeline
from fusionslam.sensors.frame import Cloud
from recordings import write_drive
from rows import rows

REPLACING = (
    ("ratslam", "DATA", "--no-report", "--save"),
    ("sim", "house", "-o", "OUT", "--save-trajectory"),
    ("sim", "house", "-o", "OUT", "--save-map"),
    ("odometry", "DATA", "-o"),
    ("tune", "DATA", "-o"),
)
"""Commands, to be followed by the name of a file."""


@rows(
    "words, expected",
    [
        (("info", "DATA", "--bogus"), "No such option: --bogus"),
        (("--bogus",), "No such option: --bogus"),
        (("map", "localize", "DATA", "--source", "cloud"), "Possible options: --sequence"),
        (("loops", "DATA", "--window", "5"), "--set loop_closure.window="),
        (("fuse", "DATA", "--ground-height=1"), "--set fusion.ground_height="),
        (("inof", "DATA"), "No such command 'inof'"),
        (("info",), "Missing argument 'DATA'"),
        (("describe", "DATA", "-o", "x", "--jobs", "0"), "'--jobs'"),
        (("eval", "x", "--radius", "wide"), "Invalid value for '--radius'"),
        (("sim", "house", "-o", ""), "Invalid value for -o"),
        (("fuse", "DATA", "--output="), "Invalid value for --output"),
        (("info", ""), "Invalid value for an argument"),
    ],
)
def test_a_wrong_use_is_one_line_too(kitti: Path, words: tuple[str, ...], expected: str) -> None:
    line = fails(2, *(str(kitti) if word == "DATA" else word for word in words))
    assert expected in line and "--help" in line


def test_a_kind_of_data_is_looked_at_before_a_world_is_recorded() -> None:
    assert "'kitti-raw'" in fails(2, "describe", "--kind", "kiti", "warehouse")


@rows("command, option", [("loops", "--source"), ("views match", "--source"), ("calib-check", "")])
def test_an_error_names_the_option_that_cures_it_if_the_command_has_it(
    command: str, option: str, tmp_path: Path
) -> None:
    write_cloud(tmp_path / "000000.bin", Cloud(np.eye(3, dtype=np.float32)))
    given = [option, "lidar"] if option else []
    line = fails(1, *command.split(), tmp_path, *given, "-o", tmp_path / "out")
    assert ("--source" in line) == bool(option)


def test_poses_shorter_than_the_recording_are_refused(kitti: Path, tmp_path: Path) -> None:
    truth = tmp_path / "short.txt"
    truth.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    succeeds("describe", kitti, "-d", "m2dp", "-o", tmp_path / "out")
    assert truth.name in fails(1, "eval", tmp_path / "out", "--gt", truth)


@rows("command", ["describe", "loops", "bench", "fuse"])
def test_an_output_that_is_a_file_is_named(kitti: Path, tmp_path: Path, command: str) -> None:
    file = tmp_path / "file"
    file.write_text("kept")
    for output in (file, file / "out"):
        error = error_of(1, command, kitti, "-o", output)
        assert error.code == "cannot-write" and str(file) in error.fields[0]
    assert file.read_text() == "kept"


@rows(
    "words, target",
    [*product(REPLACING, ("drive.npz", "site.fsmap")), (REPLACING[0], "other.mcap")],
)
def test_no_command_replaces_a_recording_or_a_map(
    tmp_path: Path, words: tuple[str, ...], target: str
) -> None:
    if words[0] == "odometry":
        pytest.importorskip("kiss_icp")
    if words[0] == "tune":
        pytest.importorskip("cma")
    data = write_drive(tmp_path / "drive.npz")
    if not (tmp_path / target).exists():
        (tmp_path / target).write_bytes(b"kept")
    before = (tmp_path / target).read_bytes()
    names = {"DATA": str(data), "OUT": str(tmp_path / "out.bag")}
    error = error_of(1, *(names.get(word, word) for word in words), tmp_path / target)
    own = target == "drive.npz" and "DATA" in words
    assert error.code == ("output-is-input" if own else "output-is-data")
    assert (tmp_path / target).read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"drive.npz", target}


def test_a_scene_set_does_not_replace_the_recording_that_it_is_made_of(tmp_path: Path) -> None:
    data = write_drive(tmp_path / "drive.npz")
    before = data.read_bytes()
    for output in (data, data.with_suffix("")):
        assert error_of(1, "views", "record", data, "-o", output).code == "output-is-input"
    assert data.read_bytes() == before


def test_a_cut_scan_is_named_the_rest_kept(recording: Path, kitti: Path, tmp_path: Path) -> None:
    scan = recording / f"velodyne/{FRAMES - 1:06d}.bin"
    whole = scan.read_bytes()
    scan.write_bytes(whole[:-5])
    words = ("describe", recording, "-d", "m2dp", "-o", tmp_path / "out")
    assert scan.name in fails(1, *words)
    assert len(list((tmp_path / "out").glob(".partial-*/*.npz"))) == 1
    scan.write_bytes(whole)
    succeeds(*words)
    # Results of other data are not mixed or replaced.
    error = error_of(1, "describe", kitti, "-d", "m2dp", "-o", tmp_path / "out")
    assert error.code == "other-results"


def test_a_gap_is_reported_and_skipped_only_on_request(recording: Path, tmp_path: Path) -> None:
    (recording / "velodyne/000005.bin").unlink()
    words = ("describe", recording, "-d", "m2dp", "-o", tmp_path / "out")
    message = fails(1, *words)
    assert "000005.bin" in message and "--skip-gaps" in message
    assert "000005.bin" in fails(1, "bench", recording, "-d", "m2dp", "-o", tmp_path / "bench")
    result = succeeds(*words, "--skip-gaps")
    assert f"{FRAMES - 1} frames" in result.stdout
    row = next(line for line in succeeds("info", recording).stdout.splitlines() if "--skip" in line)
    for command in ("fuse", "describe", "loops", "bench", "views", "ratslam", "calib-check"):
        assert command in row


def test_scans_without_their_place_are_refused_but_for_stereo(
    recording: Path, tmp_path: Path
) -> None:
    calib = recording / "calib.txt"
    lines = calib.read_text().splitlines(keepends=True)
    calib.write_text("".join(line for line in lines if not line.startswith("Tr")))
    for command in ("info", "loops", "bench", "describe", "fuse", "views record"):
        out = tmp_path / ("out.npz" if command == "views record" else "out")
        output = () if command == "info" else ("-o", out)
        error = error_of(1, *command.split(), recording, *output)
        assert (error.code, error.fields) == ("calibration-key", (str(calib), "Tr")), command
    stereo = ("--source", "stereo", "--set", "fusion.frame=scan")
    succeeds("views", "record", recording, "-o", tmp_path / "out.npz", *stereo)


def test_without_calibration_scans_serve_and_it_is_named(recording: Path, tmp_path: Path) -> None:
    out = ("-d", "m2dp", "-o", tmp_path / "out")
    commands = (("info", recording), ("describe", recording, *out))
    (recording / "calib.txt").unlink()
    for words in (*commands, ("bench", recording, *out, "--no-report")):
        assert "calib.txt" in "".join(succeeds(*words).stderr.split())
    (recording / "calib.txt").write_text("P0: 1 2 3\n")
    for words in (*commands, ("bench", recording, *out)):
        assert "calib.txt" in fails(1, *words)


def test_without_colours_only_the_descriptors_that_need_none_are_made(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for number in range(3):
        points = rng.uniform(-9, 9, (300, 3)).astype(np.float32)
        write_cloud(tmp_path / f"data/clouds/{number:06d}.bin", Cloud(points))
    result = succeeds("bench", tmp_path / "data", "-o", tmp_path / "out", "--no-report")
    assert "left out cm2dp, cshot" in " ".join(result.stderr.split())
    made = sorted(path.name for path in (tmp_path / "out/descriptors").glob("*.npz"))
    plain = ("bev_spectrum", "m2dp", "scan_context", "shot")
    assert made == [f"cloud-{name}.npz" for name in plain]
    assert "cm2dp" in fails(1, "loops", tmp_path / "data", "-d", "cm2dp", "-o", tmp_path / "loops")


def test_errors_that_nobody_foresaw_keep_their_traceback(
    kitti: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "fuse", lambda *_: 1 / 0)
    result = run("describe", kitti, "-d", "m2dp", "-o", tmp_path)
    assert isinstance(result.exception, ZeroDivisionError)
