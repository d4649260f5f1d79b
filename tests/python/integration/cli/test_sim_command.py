# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command that simulates: every output, every option, and what is wrong with the input."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from cli import error_of, fails, succeeds
from error_codes import has_code
from fusionslam.config import merged
from fusionslam.datasets import open_dataset
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.trajectory import write_trajectory
from fusionslam.sensors.messages import Event, Odometry, Picture, Scan
from fusionslam.sim import catalogue, simulator
from fusionslam.sim import folder_writer as folder
from fusionslam.sim.catalogue import Entry
from fusionslam.sim.folder_writer import folder_writer
from fusionslam.sim.robot import RobotConfig, base_from, base_from_camera, robot_named
from fusionslam.sim.simulator import SimulationConfig, simulate
from rows import rows
from worlds import hall, straight

QUICK = (
    *("--seconds", "0.6", "--jobs", "1"),
    *("--set", "robot.cameras.camera.width=64", "--set", "robot.cameras.camera.height=48"),
    *("--set", "robot.lidars.velodyne.rate_hz=10"),
)


@pytest.fixture(autouse=True)
def small_world(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hall in place of the warehouse, which takes longer to make."""
    entry = catalogue.MADE["warehouse"]
    hall_of = Entry(entry.settings, lambda settings: hall(), entry.robot)
    monkeypatch.setitem(catalogue.MADE, "warehouse", hall_of)


def small_robot(**lidar: float) -> RobotConfig:
    """The robot as QUICK sets its camera."""
    camera = {"width": 64, "height": 48}
    changes = {"cameras": {"camera": camera}, "lidars": {"velodyne": lidar}}
    return merged(robot_named("turtlebot3_waffle_pi"), changes)


@pytest.fixture
def way(tmp_path: Path) -> Path:
    write_trajectory(tmp_path / "way.csv", straight())
    return tmp_path / "way.csv"


def events_of(path: Path) -> list[Event]:
    bags = pytest.importorskip("fusionslam.datasets.bags")
    pytest.importorskip("rosbags", reason="bags are an extra")
    with bags.open_bag(path) as bag:
        return list(bag.events())


def files_of(out: Path) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


@rows("name", ["out.bag", "out.mcap", "out.db3"])
def test_a_bag_holds_what_was_simulated(tmp_path: Path, way: Path, name: str) -> None:
    pytest.importorskip("rosbags", reason="bags are an extra")
    png = ("--set", "robot.cameras.camera.stored=png")
    result = succeeds("sim", "warehouse", "-o", tmp_path / name, "--trajectory", way, *QUICK, *png)
    written = events_of(tmp_path / name)
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
    settings = [word for setting in small for word in ("--set", setting)]
    words = ("--robot", "car", "--trajectory", way, "--seconds", "0.2", "--jobs", "1", *settings)
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
    error = error_of(2, "sim", "warehouse", *words)
    assert (error.code, error.fields) == ("distorted", ("left",))


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
