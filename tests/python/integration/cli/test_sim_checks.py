# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the command that simulates finds out before it drives, prints and saves."""

import re
from pathlib import Path

import pytest
import yaml

pytest.importorskip("embreex", reason="the simulator is an extra")

from cli import error_of, fails, succeeds
from fusionslam.config import as_yaml, merged, with_file
from fusionslam.geometry.trajectory import read_trajectory, write_trajectory
from fusionslam.sim import catalogue
from fusionslam.sim.catalogue import MADE, Entry
from fusionslam.sim.motion.clearance import check_trajectory
from fusionslam.sim.motion.map_files import read_map
from fusionslam.sim.recordings import EMBEDDED, embedded_config, recording_config, resolve_config
from fusionslam.sim.world import World
from rows import rows
from worlds import hall, straight

SMALL = (
    *("--jobs", "1", "--seconds", "0.3"),
    *("--set", "robot.cameras.camera.width=64", "--set", "robot.cameras.camera.height=48"),
)


def never(settings: object) -> World:
    raise AssertionError("the world was made before the mistake was found")


def replace_warehouse(monkeypatch: pytest.MonkeyPatch, make: object) -> None:
    entry = catalogue.MADE["warehouse"]
    monkeypatch.setitem(catalogue.MADE, "warehouse", Entry(entry.settings, make, entry.robot))


@rows(
    "words, message",
    [
        (("-o", "FILE/out.bag"), "file is a file, expected a folder"),
        (("-o", "FILE/out"), "file is a file, expected a folder"),
        (("-o", "FILE"), "not an empty folder"),
        (("-o", "FULL"), "holds a recording, perhaps one that was interrupted"),
        (("-o", "FULL", "--format", "bag"), "is a folder, expected a file"),
        (("-o", "FILE", "--format", "db3"), "is a file, expected a folder"),
        (("-o", "OUT", "--trajectory", "none.csv"), "none.csv is missing"),
        (("-o", "OUT", "--save-trajectory", "FILE/way.csv"), "file is a file, expected a folder"),
        (("-o", "OUT", "--seconds", "0"), "seconds is 0.0"),
        (("-o", "OUT", "--robot", "husky"), "robot 'husky'"),
        (("-o", "OUT", "--obstacles", "-1"), "--obstacles"),
        (("-o", "OUT", "--format", "rosbag"), "--format is 'rosbag'"),
        ((), "--output is missing: expected a bag or a folder"),
    ],
)
def test_cheap_checks_come_before_the_world_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], message: str
) -> None:
    replace_warehouse(monkeypatch, never)
    (tmp_path / "file").write_text("")
    (tmp_path / "full/clouds").mkdir(parents=True)
    places = {name.upper(): str(tmp_path / name) for name in ("file", "full", "out")}
    for name, path in places.items():
        words = tuple(word.replace(name, path) for word in words)
    usage = words == () or {"--seconds", "--robot", "--obstacles", "rosbag"} & {*words}
    assert message in fails(2 if usage else 1, "sim", "warehouse", *words)
    assert not (tmp_path / "out").exists()


@rows("world", sorted(MADE))
def test_what_print_config_prints_is_read_by_config(tmp_path: Path, world: str) -> None:
    words = ("--seed", "3", "--obstacles", "2", "--set", "robot.radius_m=0.3")
    text = succeeds("sim", world, "--print-config", *words).stdout
    (tmp_path / "all.yaml").write_text(text)
    plain = recording_config(MADE[world])
    changes = {"seed": 3, "plan": {"seed": 3}, "obstacles": {"number": 2}}
    expected = resolve_config(merged(plain, changes | {"robot": {"radius_m": 0.3}}))
    assert as_yaml(with_file(plain, tmp_path / "all.yaml")) == as_yaml(expected) == text
    printed = yaml.safe_load(text)
    assert printed["plan"]["clearance_m"] == pytest.approx(0.35)
    assert printed["robot"]["odometry"]["errors"]["seed"] == 3


def test_options_win_over_the_file(tmp_path: Path) -> None:
    (tmp_path / "some.yaml").write_text("{seed: 5, plan: {seed: 5}, obstacles: {number: 1}}")
    words = ("--config", tmp_path / "some.yaml", "--seed", "6", "--print-config")
    printed = yaml.safe_load(succeeds("sim", "house", *words).stdout)
    assert (printed["seed"], printed["plan"]["seed"], printed["obstacles"]["number"]) == (6, 6, 1)


def test_worlds_from_files_print_a_configuration_and_have_no_settings(tmp_path: Path) -> None:
    (tmp_path / "one.glb").write_bytes(b"")
    words = ("sim", tmp_path / "one.glb", "--print-config")
    (tmp_path / "all.yaml").write_text(succeeds(*words).stdout)
    succeeds(*words, "--config", tmp_path / "all.yaml")
    line = fails(2, *words, "--set", "world.seed=7")
    assert line == "error: --set world.seed=7: worlds from files have no settings"
    (tmp_path / "more.yaml").write_text("world: {seed: 7}")
    error = error_of(2, *words, "--config", tmp_path / "more.yaml")
    assert (error.code, error.fields) == ("unknown-key", ("world.seed",))


def test_planned_drives_have_a_length_unless_told_otherwise() -> None:
    for settings, expected in (((), 100.0), (("--set", "plan.length_m=null"), None)):
        text = succeeds("sim", "house", "--print-config", *settings).stdout
        assert yaml.safe_load(text)["plan"]["length_m"] == expected
    lengths = {name: embedded_config(name).plan.length_m for name in EMBEDDED}
    assert lengths == {"warehouse": None, "house": None, "hospital": 350.0}


def test_a_drive_and_its_map_are_saved_and_driven_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace_warehouse(monkeypatch, lambda settings: hall())
    room = tmp_path / "map.yaml"
    way, plan = tmp_path / "way.csv", ("--set", "plan.length_m=8", "--set", "plan.spacing_m=2")
    said = succeeds(
        *("sim", "warehouse", "-o", tmp_path / "a", *SMALL, *plan, "--save-trajectory", way),
        *("--save-map", room),
    )
    check_trajectory(read_trajectory(way), read_map(room), 0.2)
    assert f"{tmp_path / 'a'}: 1 frame of 0.3 s of driving to write" in said.stderr
    assert said.stdout == f"{tmp_path / 'a'}: 1 frame\n"
    assert read_trajectory(way).length_m == pytest.approx(8, abs=0.2)
    succeeds("sim", "warehouse", "-o", tmp_path / "b", *SMALL, "--trajectory", way)
    for file in ("poses.txt", "clouds/000000.bin", "left/000000.png"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_robot_that_does_not_fit_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace_warehouse(monkeypatch, lambda settings: hall())
    words = ("sim", "warehouse", "-o", tmp_path / "out", "--set", "robot.radius_m=3")
    error = error_of(1, *words)
    assert error.code == "no-room" and re.match("hall: .* 3.0 m: ", str(error))


def test_a_drive_faster_than_the_robot_is_driven_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace_warehouse(monkeypatch, lambda settings: hall())
    for speed, warned in ((0.5, False), (5.0, True)):
        write_trajectory(tmp_path / "way.csv", straight(0.8, speed))
        out = tmp_path / f"out{speed}"
        words = ("-o", out, *SMALL, "--trajectory", tmp_path / "way.csv")
        said = " ".join(succeeds("sim", "warehouse", *words).stderr.split())
        assert ("the drive is faster than the robot: 5.00 m/s at 0.00 s" in said) == warned


def test_a_world_that_is_no_world_is_named_and_leaves_no_folder(tmp_path: Path) -> None:
    (tmp_path / "bad.world").write_text("no xml")
    for world in ("bad.world", "none.world"):
        assert world in fails(1, "sim", tmp_path / world, "-o", tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_what_a_world_lacks_is_told_with_the_option_that_skips_it(tmp_path: Path) -> None:
    there = (
        "<model name='m'><link name='l'><visual name='v'><geometry><box><size>1 1 1</size></box>"
        "</geometry></visual></link></model>"
    )
    gone = "<include><uri>model://gone</uri></include>"
    text = f"<sdf version='1.6'><world name='w'>{there}{gone}</world></sdf>"
    (tmp_path / "a.sdf").write_text(text)
    line = fails(1, "sim", tmp_path / "a.sdf", "-o", tmp_path / "out")
    assert "--lenient" in line and "model://gone" in line
    assert "::" not in line
