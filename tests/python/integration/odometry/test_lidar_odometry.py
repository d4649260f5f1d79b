# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry by LiDAR agrees with the truth of simulated drives and of KITTI, or is refused."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from artefacts import artefact
from clouds import make_room, read_scan
from error_codes import has_code
from fusionslam.base.arrays import Floats, Matrix, Points
from fusionslam.errors import ClockError, ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.odometry import LidarOdometry
from fusionslam.sim import SimulationConfig, robot_named, simulate
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.robot import base_from
from rows import rows

pytest.importorskip("kiss_icp", reason="the library of odometry by LiDAR is an extra")

PERIOD_NS = 100_000_000


@dataclass
class Drive:
    """Scans of a simulated drive and their true poses."""

    scans: list[Points]
    seconds: list[Floats]
    stamps_ns: list[int]
    truth: Matrix
    odometry: LidarOdometry = field(default_factory=LidarOdometry)
    """As it is at the end of the drive."""
    poses: Matrix = field(init=False)
    """By that odometry."""

    @property
    def length_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.truth[:, :3, 3], axis=0), axis=1).sum())

    def run(self, odometry: LidarOdometry, stride: int = 1, *, times: bool = True) -> Matrix:
        return np.stack(
            [
                odometry.process(
                    self.scans[k], self.stamps_ns[k], self.seconds[k] if times else None
                )
                for k in range(0, len(self.scans), stride)
            ]
        )

    def errors(self, poses: Matrix) -> Floats:
        """Metres from the truth, beginning at the fifth pose: the first one tells no velocity."""
        found, truth = (np.linalg.inv(p[5]) @ p[5:] for p in (poses, self.truth))
        return np.asarray(np.linalg.norm((found - truth)[:, :3, 3], axis=1))


def record(file: Path, world: str, robot_name: str, seconds: float) -> None:
    entry = MADE[world]
    robot = robot_named(robot_name).model_copy(update={"cameras": {}})
    place, way = drive_through(entry.make(entry.settings), robot, PlanConfig(length_m=20.0))
    (lidar,) = robot.lidars.values()
    events = simulate(place, robot, way, SimulationConfig(seconds=seconds), jobs=2)
    scans = [event.message for event in events if event.topic == lidar.topic]
    stamps_ns = np.array([scan.stamp_ns for scan in scans])
    times = (stamps_ns - stamps_ns[0]) / 1e9 + way.seconds[0]
    truth = way.at(times) @ base_from(robot, lidar.frame_id)
    arrays = {f"points{k}": scan.points for k, scan in enumerate(scans)}
    arrays |= {f"seconds{k}": scan.fields["time"] for k, scan in enumerate(scans)}
    np.savez(file, stamps_ns=stamps_ns, truth=truth, **arrays)


def drive(world: str, robot_name: str, seconds: float) -> Drive:
    pytest.importorskip("embreex")

    def make(folder: Path) -> None:
        record(folder / "drive.npz", world, robot_name, seconds)

    with np.load(artefact(f"odometry-{world}", make) / "drive.npz") as stored:
        stamps_ns, truth = stored["stamps_ns"].tolist(), stored["truth"]
        numbers = range(len(stamps_ns))
        times = [stored[f"seconds{k}"].astype(np.float64) for k in numbers]
        found = Drive([stored[f"points{k}"] for k in numbers], times, stamps_ns, truth)
    found.poses = found.run(found.odometry)
    return found


@pytest.fixture(scope="module")
def town() -> Drive:
    return drive("town", "car_lidar", 4.0)


@pytest.fixture(scope="module")
def house() -> Drive:
    return drive("house", "turtlebot3_vlp16", 6.0)


def test_a_car_is_followed_through_a_town(town: Drive) -> None:
    assert town.length_m > 30
    assert town.errors(town.poses).max() < 0.01 * town.length_m
    assert town.odometry.overlap > 0.9


def test_a_robot_is_followed_through_a_house(house: Drive) -> None:
    # What starts slowly from a stand seems to stand still for a moment; from then on it is right.
    found, truth = (np.linalg.inv(p[25]) @ p[25:] for p in (house.poses, house.truth))
    off = np.linalg.norm((found - truth)[:, :3, 3], axis=1)
    assert house.errors(house.poses).max() < 0.4
    assert off[-1] < 0.05 * np.linalg.norm(truth[-1, :3, 3])


def test_times_of_points_undo_the_motion_within_a_sweep(town: Drive) -> None:
    poses = town.poses[5:]
    step = (np.linalg.inv(poses[:-1]) @ poses[1:])[:, 0, 3]
    # Of the stamp, at which the sweep begins: half a sweep earlier than where its points are.
    untimed = town.run(LidarOdometry(), times=False)[5:]
    ahead = (np.linalg.inv(poses) @ untimed)[:, 0, 3]
    assert np.median(step) == pytest.approx(0.8, abs=0.02)
    assert np.median(ahead) == pytest.approx(0.4, abs=0.15)


def test_the_stated_deviation_bounds_the_drift(town: Drive, house: Drive) -> None:
    for each in (town, house):
        odometry, errors = each.odometry, each.errors(each.poses)
        assert errors[-1] < 3 * odometry.deviation.position * np.sqrt(each.length_m)
        assert 0 < odometry.deviation.angle < 0.1


def test_equal_scans_give_equal_bits(house: Drive) -> None:
    one, other = (house.run(LidarOdometry(), 6) for _ in range(2))
    assert one.tobytes() == other.tobytes()


def test_the_environment_changes_nothing(house: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    scans = Drive(house.scans[:6], house.seconds[:6], house.stamps_ns[:6], house.truth[:6])
    poses = scans.run(LidarOdometry())
    monkeypatch.setenv("KISS_ICP_DATA", '{"max_range": 2.0}')
    np.testing.assert_array_equal(scans.run(LidarOdometry()), poses)


@contextmanager
def loses_its_way() -> Iterator[pytest.ExceptionInfo[DataError]]:
    with pytest.raises(DataError) as caught:
        yield caught
    assert caught.value.code in ("far-apart", "lost")


@rows("stride", [3, 5])
def test_scans_that_lie_too_far_apart_are_refused(town: Drive, stride: int) -> None:
    odometry = LidarOdometry()
    with loses_its_way() as caught:
        town.run(odometry, stride)
    with pytest.raises(DataError) as again:  # no scan after it is believed
        odometry.process(town.scans[-1], town.stamps_ns[-1])
    assert again.value is caught.value


def test_a_jump_at_a_high_rate_is_refused(town: Drive) -> None:
    odometry = LidarOdometry()
    for k in range(6):
        odometry.process(town.scans[k], town.stamps_ns[k], town.seconds[k])
    far = town.scans[6] + np.float32([3.0, 0, 0])
    with loses_its_way():
        for k in range(6, 12):
            odometry.process(far, town.stamps_ns[k], town.seconds[k])


def test_scans_of_other_places_are_no_motion(town: Drive, house: Drive) -> None:
    odometry = LidarOdometry()
    odometry.process(town.scans[0], 0)
    with loses_its_way():
        for k in range(1, 5):
            odometry.process((town, house)[k % 2].scans[k], k * PERIOD_NS)


def test_a_recording_may_not_end_with_scans_that_do_not_fit(town: Drive, house: Drive) -> None:
    odometry = LidarOdometry(max_step=100, max_turn=180)
    for k in range(3):
        odometry.process(town.scans[k], town.stamps_ns[k], town.seconds[k])
    odometry.check()
    odometry.process(house.scans[0], town.stamps_ns[3])
    with pytest.raises(DataError, check=has_code("lost", "1")):
        odometry.check()


def test_frames_of_kitti_lie_as_far_apart_as_registration_says(test_data: Path) -> None:
    from fusionslam.registration import RegistrationConfig, register

    folder = test_data / "kitti/raw_2011_09_26/velodyne_points/data"
    scans = [read_scan(folder / f"{k:010d}.bin") for k in range(10)]
    odometry = LidarOdometry()
    poses = np.stack([odometry.process(scan, k * PERIOD_NS) for k, scan in enumerate(scans)])
    guess = np.eye(4)
    guess[0, 3] = 2.0
    found = register(scans[9], scans[0], guess, config=RegistrationConfig(voxel=0.3))
    assert found.target_from_source is not None
    np.testing.assert_allclose(poses[9][:3, 3], found.target_from_source[:3, 3], atol=0.07)
    # The images and the scan in view of the camera say 2.15 m, too (PnP).
    path = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum()
    assert path == pytest.approx(2.15, abs=0.05)


def test_what_is_no_scan_changes_nothing() -> None:
    room, odometry = make_room(), LidarOdometry()
    odometry.process(room, PERIOD_NS)
    bad_time = np.zeros(len(room))
    bad_time[7] = np.nan
    for scan, seconds, kind, code in (
        (np.zeros((0, 3), np.float32), None, DataError, "few-points"),
        (room[:99], None, DataError, "few-points"),
        (np.full_like(room, np.nan), None, DataError, "few-points"),
        (room[:, :2], None, ShapeError, "no-cloud"),
        (room.astype(np.int64), None, ShapeError, "no-cloud"),
        (room, np.zeros(5), ShapeError, "shape"),
        (room, "soon", ShapeError, "shape"),
        (room, bad_time, DataError, "not-finite"),
    ):
        with pytest.raises(kind, check=has_code(code)):
            odometry.process(scan, 2 * PERIOD_NS, seconds)
    for stamp_ns in (PERIOD_NS, 0):
        with pytest.raises(ClockError, check=has_code("clock")):
            odometry.process(room, stamp_ns)
    pose = odometry.process(room, 2 * PERIOD_NS)
    np.testing.assert_allclose(pose, np.eye(4), atol=1e-3)


def test_rays_without_return_are_no_points() -> None:
    room = make_room()
    broken = np.vstack([room, np.full((50, 3), np.nan, np.float32)])
    odometries = [LidarOdometry(), LidarOdometry()]
    for k in range(3):
        poses = [
            odometry.process(scan, k * PERIOD_NS)
            for odometry, scan in zip(odometries, (room, broken), strict=True)
        ]
    np.testing.assert_array_equal(*poses)


def test_points_of_one_time_are_fine() -> None:
    room, odometry = make_room(), LidarOdometry()
    for k in range(4):
        pose = odometry.process(room, k * PERIOD_NS, np.zeros(len(room)))
    np.testing.assert_allclose(pose, np.eye(4), atol=1e-3)


def test_a_lost_scan_is_bridged(town: Drive) -> None:
    odometry = LidarOdometry()
    kept = [k for k in range(20) if k != 12]
    poses = {k: odometry.process(town.scans[k], town.stamps_ns[k], town.seconds[k]) for k in kept}
    found, truth = (np.linalg.inv(p[11]) @ p[13] for p in (poses, town.truth))
    assert np.linalg.norm((found - truth)[:3, 3]) < 0.1


def test_wrong_options_are_named() -> None:
    for name, value in (("voxel", 0.0), ("min_overlap", 1.5), ("voxels", 1.0)):
        with pytest.raises(ConfigError, match=name):
            LidarOdometry(**{name: value})


def test_without_the_library_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "kiss_icp", None)
    for version, code, name in (
        ((3, 13), "missing-extra", "odometry"),
        ((3, 14), "no-package", "kiss-icp"),
    ):
        monkeypatch.setattr(sys, "version_info", version)
        with pytest.raises(FusionSlamError, check=has_code(code, name)):
            LidarOdometry()
