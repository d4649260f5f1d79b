# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions of robots: those of the package, one's own, and what is wrong with others."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from error_codes import has_code
from fusionslam.config import merged, with_settings
from fusionslam.errors import ConfigError
from fusionslam.sim.camera import LensConfig
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.lidar import LidarConfig, LidarMount
from fusionslam.sim.motion.occupancy import occupancy_of
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.robot import (
    RobotConfig,
    base_from,
    base_from_camera,
    robot_named,
    robot_names,
    static_transforms,
)
from fusionslam.sim.town.car import RING, RingConfig, StereoConfig, car_from_ring_camera
from rows import rows
from worlds import hall

SENSOR = "lidars.velodyne"


def test_the_package_brings_its_robots() -> None:
    cars = ["car", "car_four_cameras", "car_lidar"]
    assert robot_names() == [*cars, "turtlebot3_vlp16", "turtlebot3_waffle_pi"]
    for name in robot_names():
        robot = robot_named(name)
        assert robot.lidars and bool(robot.cameras) == (name != "car_lidar")


def test_the_waffle_pi_is_that_of_the_thesis() -> None:
    robot = robot_named("turtlebot3_waffle_pi")
    lidar, camera = robot.lidars["velodyne"], robot.cameras["camera"]
    assert (lidar.rings, lidar.azimuths, lidar.rate_hz, lidar.shapes) == (18, 120, 2, "collision")
    assert (lidar.min_range_m, lidar.range_m, lidar.noise_m) == (0.9, 130, 0.008)
    assert (camera.width, camera.height, camera.rate_hz, camera.view_rad) == (640, 480, 30, 1)
    assert base_from(robot, lidar.frame_id)[:3, 3] == pytest.approx((-0.064, 0, 0.170), abs=1e-3)
    assert base_from(robot, camera.frame_id)[:3, 3] == pytest.approx((0.076, 0, 0.103))
    assert robot.drive.max_speed_m_s == 0.69 and robot.odometry.errors.neutral


def test_the_car_has_the_sensors_of_the_embedded_drive() -> None:
    car = robot_named("car")
    ours = [car.lidars["velodyne"], car.cameras["left"], car.cameras["right"]]
    theirs = [LidarConfig(), StereoConfig(), StereoConfig()]
    for mount, config, kind in zip(ours, theirs, (LidarConfig, *[LensConfig] * 2), strict=True):
        for key in kind.model_fields:
            assert getattr(mount, key) == getattr(config, key), key


def test_other_cars_have_the_ring_of_the_town_or_a_lidar_alone() -> None:
    car, config = robot_named("car_four_cameras"), RingConfig()
    assert list(car.cameras) == list(RING)
    for name, mount in car.cameras.items():
        assert np.allclose(base_from_camera(car, mount), car_from_ring_camera(config, name))
        assert np.array_equal(mount.matrix(), config.matrix())
        assert (mount.width, mount.height) == (config.width, config.height)
    car, alone = robot_named("car"), robot_named("car_lidar")
    assert (alone.drive, alone.radius_m) == (car.drive, car.radius_m)
    lidar = alone.lidars["velodyne"]
    assert lidar.scan_motion and not car.lidars["velodyne"].scan_motion
    assert lidar.model_copy(update={"scan_motion": False}) == car.lidars["velodyne"]


def test_the_car_can_do_what_its_town_asks(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = hall().visual  # the drive does not depend on what stands beside it
    monkeypatch.setattr("fusionslam.sim.catalogue.make_town", lambda *_, **__: scene)
    grid = occupancy_of(scene)
    monkeypatch.setattr("fusionslam.sim.catalogue.occupancy_of", lambda *_, **__: grid)
    entry = MADE["town"]
    drive_through(entry.make(entry.settings), robot_named("car"), PlanConfig())
    assert "faster than the robot" not in caplog.text
    drive_through(entry.make(entry.settings), robot_named("turtlebot3_waffle_pi"), PlanConfig())
    assert "faster than the robot" in caplog.text


def test_the_right_camera_is_a_baseline_beside_the_left_one_in_its_frame() -> None:
    car = robot_named("car")
    left, right = (base_from_camera(car, car.cameras[side]) for side in ("left", "right"))
    apart = np.linalg.inv(left) @ right
    assert np.allclose(apart[:3, 3], (StereoConfig().baseline_m, 0, 0))
    assert np.allclose(apart[:3, :3], np.eye(3))
    assert [link.child for link in static_transforms(car)] == ["velodyne", "stereo_optical"]


def test_frames_are_chained_over_their_parents() -> None:
    tower = {"position_m": (1.0, 0.0, 0.0), "tilt_deg": (0.0, 0.0, 90.0)}
    top = {"parent": "tower", "position_m": (0.5, 0.0, 2.0), "tilt_deg": (0.0, 0.0, -30.0)}
    parts = {"frames": {"tower": tower}, "lidars": {"top": top}}
    robot = merged(RobotConfig(), parts, new_names=True)
    pose = base_from(robot, "lidar")
    assert np.allclose(pose[:3, 3], (1, 0.5, 2))
    assert np.arctan2(pose[1, 0], pose[0, 0]) == pytest.approx(np.deg2rad(60))
    assert all(link.static for link in static_transforms(robot))


def test_a_robot_of_ones_own_is_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("lidars:\n  low: {rings: 4, topic: /low}\nradius_m: 0.1\n")
    robot = robot_named(path)
    assert robot.lidars == {"low": LidarMount(rings=4, topic="/low")}
    assert robot.radius_m == 0.1 and not robot.cameras


def test_a_sensor_is_changed_by_its_name_and_none_added_by_mistake() -> None:
    waffle = robot_named("turtlebot3_waffle_pi")
    changed = with_settings(waffle, [f"{SENSOR}.rate_hz=5"])
    assert changed.lidars["velodyne"].rate_hz == 5
    assert changed.lidars["velodyne"].rings == 18
    assert changed.cameras == waffle.cameras
    unknown = has_code("unknown-name", "lidars", "velo")
    with pytest.raises(ConfigError, match=r"'velodyne'.* velodyne", check=unknown):
        with_settings(waffle, ["lidars.velo.noise_m=0.1"])
    with pytest.raises(ConfigError, check=has_code("unknown-name", "lidars", "top")):
        merged(RobotConfig(), {"lidars": {"top": {}}})


@rows(
    "setting, message",
    [
        (f"{SENSOR}.ringz=3", r"'lidars.velodyne.ringz'.* 'rings'"),
        (f"{SENSOR}.rings=0", r"lidars.velodyne.rings .*\b0\b.*\b1$"),
        (f"{SENSOR}=3", r"lidars.velodyne .*\b3\b.* rings, "),
        ("lidars=3", r"lidars .*\b3\b.* dictionary"),
        (f"{SENSOR}.parent=mast", r"velodyne -> mast .*base_footprint"),
        ("frames.base_link.parent=base_scan", r"base_link -> base_scan\b"),
        (f"{SENSOR}.frame_id=base_link", "frame 'base_link'"),
        (f"{SENSOR}.frame_id=odom", "frame 'odom'"),
        (f"{SENSOR}.topic=/odom", "topic '/odom'"),
        (f"{SENSOR}.topic=/tf", "topic '/tf'"),
        ("cameras.camera.side=right", r"cameras.camera .*frame_id"),
        ("cameras.camera.distortion=[-9,0,0,0,0]", r"cameras.camera.* distortion .*-9\.0"),
    ],
)
def test_what_does_not_fit_together_is_an_error_that_names_it(setting: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        with_settings(robot_named("turtlebot3_waffle_pi"), [setting])


def test_a_pair_whose_cameras_are_mounted_apart_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"cameras\.right"):
        merged(robot_named("car"), {"cameras": {"right": {"tilt_deg": (0.0, 0.0, 5.0)}}})


@rows(
    "text, message",
    [
        ("lidars: {low: {rings: many}}", r"mine.yaml: lidars.low.rings .*'many'"),
        ("wheels: 4", r"mine.yaml: .*'wheels'"),
        ("- a list", r"mine.yaml: .* list$"),
        ("a: [", r"mine.yaml: .* YAML: .*\b1, .*\b5\b"),
        ("", r"mine.yaml: .* lidars, cameras\b"),
        ("radius_m: 0.1", r"mine.yaml: .* lidars, cameras\b"),
    ],
)
def test_wrong_descriptions_name_file_and_key(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        robot_named(path)


def test_a_missing_description_or_robot_is_an_error_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="husky"):
        robot_named("husky")
    with pytest.raises(ConfigError, check=has_code("config-file", tmp_path / "none.yaml")):
        robot_named(tmp_path / "none.yaml")
