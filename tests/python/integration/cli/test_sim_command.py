# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command that simulates: every output and option, and what it finds out before it drives."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

import re

import pytest
import yaml

from cli import error_of, fails, refusal, settings, succeeds
from error_codes import has_code
from fusionslam.config import as_yaml, merged, with_file
from fusionslam.datasets import open_dataset
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.trajectory import read_trajectory, write_trajectory
from fusionslam.sensors.messages import Odometry, Picture, Scan
from fusionslam.sim import catalogue, simulator
from fusionslam.sim import folder_writer as folder
from fusionslam.sim.catalogue import MADE, Entry
from fusionslam.sim.folder_writer import folder_writer
from fusionslam.sim.motion.clearance import check_trajectory
from fusionslam.sim.motion.map_files import read_map
from fusionslam.sim.recordings import EMBEDDED, embedded_config, recording_config, resolve_config
from fusionslam.sim.robot import RobotConfig, base_from, base_from_camera, robot_named
from fusionslam.sim.simulator import SimulationConfig, simulate
from fusionslam.sim.world import World
from rows import rows
from worlds import hall, straight

QUICK = (
    *("--seconds", "0.6", "--jobs", "1"),
    *("--set", "robot.cameras.camera.width=64", "--set", "robot.cameras.camera.height=48"),
    *("--set", "robot.lidars.velodyne.rate_hz=10"),
)


def replace_warehouse(monkeypatch: pytest.MonkeyPatch, make: object) -> None:
    entry = catalogue.MADE["warehouse"]
    monkeypatch.setitem(catalogue.MADE, "warehouse", Entry(entry.settings, make, entry.robot))


@pytest.fixture(autouse=True)
def small_world(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hall in place of the warehouse, which takes longer to make."""
    replace_warehouse(monkeypatch, lambda settings: hall())


def small_robot(**lidar: float) -> RobotConfig:
    """The robot as QUICK sets its camera."""
    camera = {"width": 64, "height": 48}
    changes = {"cameras": {"camera": camera}, "lidars": {"velodyne": lidar}}
    return merged(robot_named("turtlebot3_waffle_pi"), changes)


@pytest.fixture
def way(tmp_path: Path) -> Path:
    write_trajectory(tmp_path / "way.csv", straight())
    return tmp_path / "way.csv"


def files_of(out: Path) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


@rows("name", ["out.bag", "out.mcap", "out.db3"])
def test_a_bag_holds_what_was_simulated(tmp_path: Path, way: Path, name: str) -> None:
    bags = pytest.importorskip("fusionslam.datasets.bags")
    pytest.importorskip("rosbags", reason="bags are an extra")
    png = ("--set", "robot.cameras.camera.stored=png")
    result = succeeds("sim", "warehouse", "-o", tmp_path / name, "--trajectory", way, *QUICK, *png)
    with bags.open_bag(tmp_path / name) as bag:
        written = list(bag.events())
    assert result.stdout.strip() == f"{tmp_path / name}: {len(written)} messages"
    robot = merged(small_robot(rate_hz=10.0), {"cameras": {"camera": {"stored": "png"}}})
    config = SimulationConfig(seconds=0.6)
    made = {(e.topic, e.time_ns): e.message for e in simulate(hall(), robot, straight(), config)}
    assert {(e.topic, e.time_ns) for e in written} == set(made)
    for event in written:
        expected = made[event.topic, event.time_ns]
        if isinstance(expected, Scan):
            assert np.array_equal(event.message.points, expected.points)
            assert list(event.message.fields) == list(expected.fields)
        elif isinstance(expected, Picture):
            assert np.array_equal(event.message.image, expected.image)
        elif isinstance(expected, Odometry):
            assert np.allclose(event.message.pose, expected.pose, atol=1e-12)


def test_a_plain_folder_opens_with_points_on_their_pixels(tmp_path: Path, way: Path) -> None:
    out = tmp_path / "out"
    still = ("--set", "robot.lidars.velodyne.noise_m=0", "--set", "robot.cameras.camera.noise=0")
    succeeds("sim", "warehouse", "-o", out, "--trajectory", way, *QUICK, *still)
    dataset = open_dataset(out)
    assert len(dataset) == 6 and dataset.sensors == ("points", "left")
    assert dataset.stamps_ns.tolist() == [1000 * 10**9 + k * 10**8 for k in range(6)]
    robot = robot_named("turtlebot3_waffle_pi")
    for frame in dataset:
        seconds = frame.stamp_ns / 1e9 - 1000
        pose = straight().at(seconds)[0] @ base_from(robot, "velodyne")
        assert np.allclose(frame.pose, pose, atol=1e-6)
        camera = frame.cameras["left"]
        seen = camera.rectified_from_points @ np.append(frame.points[700], 1)
        back = np.linalg.inv(base_from_camera(robot, robot.cameras["camera"]))
        direct = back @ base_from(robot, "velodyne") @ np.append(frame.points[700], 1)
        assert np.allclose(seen, direct, atol=1e-6)
        assert frame.images["left"].shape == (48, 64, 3)
    assert "points" in succeeds("info", out).stdout


def test_a_folder_renders_only_the_pictures_that_its_scans_need(
    tmp_path: Path, way: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rendered: list[int] = []
    whole = simulator.photograph

    def counted(*arguments: Any) -> Any:
        rendered.append(1)
        return whole(*arguments)

    rates = ("--set", "robot.cameras.camera.rate_hz=30", "--set", "robot.lidars.velodyne.rate_hz=7")
    words = ("--trajectory", way, *QUICK[:8], *rates)
    monkeypatch.setattr(simulator, "photograph", counted)
    said = succeeds("sim", "warehouse", "-o", tmp_path / "out", *words).stdout
    assert said == f"{tmp_path / 'out'}: 5 frames\n" and len(rendered) == 5
    monkeypatch.undo()
    robot = small_robot(rate_hz=7.0)
    with folder_writer(tmp_path / "all", robot) as writer:
        for event in simulate(hall(), robot, straight(), SimulationConfig(seconds=0.6)):
            writer.write(event)
    assert files_of(tmp_path / "out") == files_of(tmp_path / "all")


def test_the_car_writes_a_stereo_folder(tmp_path: Path, way: Path) -> None:
    out = tmp_path / "out"
    small = ["robot.cameras.left.width=64", "robot.cameras.right.width=64"]
    small += ["robot.radius_m=0.3", "robot.lidars.velodyne.rings=4"]
    words = (
        "--robot",
        "car",
        "--trajectory",
        way,
        "--seconds",
        "0.2",
        "--jobs",
        "1",
        *settings(*small),
    )
    succeeds("sim", "warehouse", "-o", out, *words)
    dataset = open_dataset(out)
    assert dataset.has_points and dataset.has_stereo
    assert dataset.cameras["right"].projection[0, 3] == pytest.approx(-359.0 * 0.54)


def test_same_seed_same_files_and_another_seed_others(tmp_path: Path, way: Path) -> None:
    outs = [tmp_path / name for name in "abc"]
    for out, seed in zip(outs, (3, 3, 4), strict=True):
        words = ("--trajectory", way, *QUICK, "--seed", seed, "--obstacles", 1)
        succeeds("sim", "warehouse", "-o", out, *words)
    contents = [files_of(out) for out in outs]
    assert contents[0] == contents[1] != contents[2]


def test_a_file_and_format_say_what_options_and_suffix_do_not(tmp_path: Path, way: Path) -> None:
    (tmp_path / "slow.yaml").write_text("robot: {lidars: {velodyne: {rate_hz: 5}}}\nstart_s: 7\n")
    out = tmp_path / "out.bag"
    words = ("--trajectory", way, "--config", tmp_path / "slow.yaml", *QUICK[:8])
    succeeds("sim", "warehouse", "-o", out, *words, "--format", "folder")
    assert (out / "clouds" / "000000.bin").is_file()
    assert open_dataset(out).stamps_ns.tolist() == [7 * 10**9 + k * 2 * 10**8 for k in range(3)]


def test_a_trajectory_through_a_wall_is_told_with_time_and_place(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("t,x,y,yaw\n0,-4,0,0\n20,4,0,0\n")
    out = tmp_path / "out.bag"
    error = error_of(1, "sim", "warehouse", "-o", out, "--trajectory", tmp_path / "bad.csv")
    assert error.code == "blocked"
    assert error.fields[0].startswith("14.") and error.fields[1].startswith("1.")
    assert not out.exists()


def test_a_folder_with_other_things_in_it_is_left_alone(tmp_path: Path, way: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious").write_text("")
    error = error_of(1, "sim", "warehouse", "-o", tmp_path / "out", "--trajectory", way, *QUICK)
    assert (error.code, error.fields) == ("not-empty", (str(tmp_path / "out"),))


def test_a_folder_cannot_hold_distorted_pictures(tmp_path: Path, way: Path) -> None:
    lens = ("--set", "robot.cameras.camera.distortion=[-0.1,0,0,0,0]")
    words = ("-o", tmp_path / "out", "--trajectory", way, *QUICK, *lens)
    assert refusal(2, "sim", "warehouse", *words) == ("distorted", "left")


def test_a_folder_of_a_robot_without_lidar_is_refused(tmp_path: Path) -> None:
    robot = robot_named("turtlebot3_waffle_pi").model_copy(update={"lidars": {}})
    with (
        pytest.raises(ConfigError, check=has_code("missing-sensor", "lidars")),
        folder_writer(tmp_path / "out", robot),
    ):
        pass


def test_frames_written_before_an_error_are_kept(tmp_path: Path) -> None:
    robot = merged(small_robot(), {"cameras": {"camera": {"rate_hz": 2.0}}})
    events = simulate(hall(), robot, straight())
    with (
        pytest.raises(DataError, match="stop"),
        folder_writer(tmp_path / "out", robot) as writer,
    ):
        for event in events:
            writer.write(event)
            if event.time_ns > 1000.6e9:
                raise DataError("stop")
    assert len(open_dataset(tmp_path / "out")) == 2


def test_no_half_frame_is_kept(tmp_path: Path, way: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = folder.write_png

    def full(path: Path, data: np.ndarray) -> None:
        if path.name == "000002.png":
            raise DataError(f"cannot write {path}: No space left on device")
        whole(path, data)

    monkeypatch.setattr(folder, "write_png", full)
    line = fails(1, "sim", "warehouse", "-o", tmp_path / "out", "--trajectory", way, *QUICK)
    assert "000002.png: No space left on device" in line
    assert len(open_dataset(tmp_path / "out")) == 2


SMALL = ("--seconds", "0.3", *QUICK[2:8])


def never(settings: object) -> World:
    raise AssertionError("the world was made before the mistake was found")


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
    assert refusal(2, *words, "--config", tmp_path / "more.yaml") == ("unknown-key", "world.seed")


def test_planned_drives_have_a_length_unless_told_otherwise() -> None:
    for given, expected in (((), 100.0), (("--set", "plan.length_m=null"), None)):
        text = succeeds("sim", "house", "--print-config", *given).stdout
        assert yaml.safe_load(text)["plan"]["length_m"] == expected
    lengths = {name: embedded_config(name).plan.length_m for name in EMBEDDED}
    assert lengths == {"warehouse": None, "house": None, "hospital": 350.0}


def test_a_drive_and_its_map_are_saved_and_driven_again(tmp_path: Path) -> None:
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


def test_a_robot_that_does_not_fit_is_told(tmp_path: Path) -> None:
    words = ("sim", "warehouse", "-o", tmp_path / "out", "--set", "robot.radius_m=3")
    error = error_of(1, *words)
    assert error.code == "no-room" and re.match("hall: .* 3.0 m: ", str(error))


def test_a_drive_faster_than_the_robot_is_driven_with_a_warning(tmp_path: Path) -> None:
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
