# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Every command with every kind of DATA: it does its work, or says what it found and lacks."""

import inspect
from itertools import product
from pathlib import Path
from typing import get_args

import pytest

from cli import error_of, fails, run, succeeds
from fusionslam import datasets
from fusionslam.cli.recordings import build_recording
from fusionslam.datasets.base import OdometryOrigin, PosesOrigin
from fusionslam.datasets.streams import MissingSensorError
from fusionslam.pipelines.drives import open_drive
from fusionslam.pipelines.recording import Recording
from recordings import write_drive

WINDOW = ("--set", "loop_closure.window=2", "--set", "evaluation.window=2")
KINDS = ("ranges", "scenes", "scenes alone")
COMMANDS = {
    "info": ("info",),
    "fuse": ("fuse",),
    "describe": ("describe", "-d", "m2dp"),
    "loops": ("loops", "-d", "m2dp", *WINDOW),
    "bench": ("bench", "-d", "m2dp", *WINDOW),
    "views record": ("views", "record"),
    "views match": ("views", "match", "--no-report"),
    "views curve": ("views", "curve", "--set", "views.method=objects"),
    "bench views": ("bench", "views", "-m", "always_new"),
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


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("data")
    paths = {"ranges": write_drive(folder / "ranges.npz")}
    for name, more in (("scenes", ()), ("scenes alone", ("--only-scenes",))):
        paths[name] = folder / f"{name.replace(' ', '_')}.npz"
        succeeds("views", "record", paths["ranges"], "-o", paths[name], *more)
    return paths


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_does_its_work_or_says_what_it_found(
    command: str, kind: str, data: dict[str, Path], tmp_path: Path
) -> None:
    words = [*COMMANDS[command], str(data[kind])]
    words += [] if command == "info" else ["-o", str(tmp_path / "out")]
    if refusal := REFUSED.get((command, kind)):
        assert error_of(1, *words).code == refusal
    else:
        succeeds(*words)


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


def test_a_world_is_recorded_and_then_read_as_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rosbags")
    from bags import drive, write_bag

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
    error = error_of(1, "info", "hous")
    assert error.code == "no-such-data" and error.fields == ("house",)


@pytest.mark.parametrize(
    "words",
    [
        ("describe", "-d", "m3dp"),
        ("describe", "--set", "fusion.bogus=1"),
        ("loops", "--source", "sonar"),
        ("bench", "--stamps", "late"),
        ("fuse", "--topic", "nose=/x"),
        ("views", "match", "--rule", "mine"),
        ("views", "record", "--tuned", "nobody"),
        ("ratslam", "--views", "nobody"),
        ("calib-check", "--config", "missing.yaml"),
    ],
)
def test_options_are_checked_before_a_world_is_recorded(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.sim.recordings.record_world", pytest.fail)
    fails(2, *words, "warehouse", "-o", tmp_path / "out")


def test_the_help_of_kind_names_all_kinds() -> None:
    option = get_args(inspect.signature(build_recording).parameters["kind"].annotation)[-1]
    named = set(option.metavar.strip("[]").split("|"))
    assert named == {*datasets.KINDS, "scenes"}
