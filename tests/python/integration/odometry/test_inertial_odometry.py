# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry by LiDAR and IMU agrees with the truth, says what it felt, or is refused."""

import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bags
from cli import refusal, succeeds
from clouds import make_room
from error_codes import has_code
from fusionslam import open_dataset
from fusionslam.base.arrays import Floats
from fusionslam.datasets.bags import open_bag
from fusionslam.errors import ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.odometry import LidarOdometry, LidarOdometryConfig
from fusionslam.pipelines.lidar_odometry import LidarTrack, track_lidar
from fusionslam.pipelines.place_maps import odometry_of
from fusionslam.sensors.messages import Event, FrameTransforms, Imu
from inertial_house import inertial_house
from rows import rows

pytest.importorskip("rko_lio", reason="the library of odometry by LiDAR and IMU is an extra")

S = 1_000_000_000
MOUNT = exp(np.array([0.1, -0.05, 0.3, 0.2, -0.4, 1.5]))
"""scan_from_imu."""
BIAS = np.array([0.004, -0.002, 0.006])
G = 9.81


@pytest.fixture(scope="module")
def house() -> Path:
    return inertial_house()


@pytest.fixture(scope="module")
def track(house: Path) -> LidarTrack:
    return track_lidar(open_dataset(house, sensors=["points"]))


def errors(track: LidarTrack, truth: Floats) -> Floats:
    """Metres from the truth, beginning at the fifth pose."""
    found, true = (inverse(each[5:6]) @ each[5:] for each in (track.poses, truth))
    return np.asarray(np.linalg.norm((found - true)[:, :3, 3], axis=1))


@pytest.mark.slow
def test_a_robot_is_followed_by_scans_and_imu(house: Path, track: LidarTrack) -> None:
    dataset = open_dataset(house, sensors=["points"])
    assert dataset.poses is not None and track.felt is not None
    # What sets out slowly seems to stand still for a moment, as by scans alone.
    assert errors(track, dataset.poses).max() < 0.2
    assert track.felt.gravity == pytest.approx(9.81, abs=0.1)
    # The robot sets out at once, which tilts what is felt.
    np.testing.assert_allclose(track.felt.up, [0, 0, 1], atol=0.08)
    assert track.felt.bias is None and "by scans and IMU" in str(track)


@pytest.mark.slow
def test_the_command_says_by_what(house: Path, tmp_path: Path, track: LidarTrack) -> None:
    text = succeeds("odometry", house, "-o", tmp_path / "felt.txt")
    assert str(track) in text.output
    alone = succeeds(
        "odometry", house, "-o", tmp_path / "alone.txt", "--set", "lidar_odometry.imu=never"
    )
    assert "by scans alone" in alone.output
    code = refusal(1, "odometry", house, "-o", tmp_path / "x.txt", "--topic", "imu=/nothing")
    assert code[0] == "no-topic"


def test_maps_take_it(house: Path, track: LidarTrack) -> None:
    dataset = open_dataset(house, sensors=["points"])
    found = odometry_of(dataset, "inertial")
    np.testing.assert_array_equal(found, track.poses @ dataset.body_from_robot)


@pytest.mark.slow
def test_nothing_is_written_to_standard_output(house: Path) -> None:
    code = (
        "import sys; from fusionslam import open_dataset;"
        "from fusionslam.pipelines.lidar_odometry import track_lidar;"
        "track_lidar(open_dataset(sys.argv[1], sensors=['points'])[:3])"
    )
    done = subprocess.run([sys.executable, "-c", code, house], capture_output=True, check=True)
    assert not done.stdout and not done.stderr


def changed(house: Path, path: Path, change: Callable[[Event], Sequence[Event]]) -> Path:
    with open_bag(house) as bag:
        events = [made for event in bag.events() for made in change(event)]
    return bags.write_bag(path, events)


def scaled(event: Event, angular: float = 1.0, linear: float = 1.0) -> list[Event]:
    imu = event.message
    if isinstance(imu, Imu):
        imu = replace(imu, angular=imu.angular * angular, linear=imu.linear * linear)
    return [replace(event, message=imu)]


def without(event: Event, begin_s: float, end_s: float) -> list[Event]:
    lost = isinstance(event.message, Imu) and begin_s * S < event.time_ns - 1000 * S < end_s * S
    return [] if lost else [event]


def unlinked(event: Event) -> list[Event]:
    links = event.message
    if not isinstance(links, FrameTransforms):
        return [event]
    kept = tuple(link for link in links.transforms if link.child != "imu")
    return [replace(event, message=FrameTransforms(transforms=kept))] if kept else []


@pytest.mark.slow
@rows(
    "change, code",
    [
        (lambda event: without(event, -1, 10), "no-imu"),
        (lambda event: without(event, -1, 1), "no-imu"),
        (lambda event: without(event, 1, 1.4), "no-imu"),
        (lambda event: without(event, 1, 10), "no-imu"),
        (unlinked, "no-imu"),
        (lambda event: scaled(event, angular=180 / np.pi), "lost"),
        (lambda event: scaled(event, angular=1e5), "imu-unit"),
        (lambda event: scaled(event, linear=0.5), "imu-unit"),
        (lambda event: scaled(event, linear=0.0), "imu-unit"),
        (lambda event: scaled(event, linear=np.nan), "no-imu"),
    ],
)
def test_an_imu_that_cannot_be_used_is_named(
    change: Callable[[Event], Sequence[Event]], code: str, house: Path, tmp_path: Path
) -> None:
    path = changed(house, tmp_path / f"{code}.bag", change)
    dataset = open_dataset(path, sensors=["points"])
    with pytest.raises(DataError, check=has_code(code)):
        track_lidar(dataset, LidarOdometryConfig(imu="always"))
    path.unlink()


def test_scans_alone_do_where_the_imu_cannot(
    house: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("kiss_icp", reason="the library of odometry by LiDAR is an extra")
    path = changed(house, tmp_path / "unlinked.bag", unlinked)
    found = track_lidar(open_dataset(path, sensors=["points"])[:4])
    assert found.felt is None and "does not place 'imu'" in caplog.text


def stand(
    odometry: LidarOdometry, tilt: Floats, scans: int = 12, unit: float = 1.0, begin_s: int = 1
) -> Floats:
    """Poses of a scanner that stands in a room, tilted; rates have a bias."""
    scanned = make_room(4000, sides=6) @ tilt.astype(np.float32)
    up = MOUNT[:3, :3].T @ tilt.T @ [0, 0, 1]
    poses = []
    for scan in range(scans):
        begin_ns = begin_s * S + scan * S // 10
        for k in range(20):
            stamp_ns = begin_ns + k * S // 200
            odometry.add(Imu(stamp_ns=stamp_ns, frame_id="imu", angular=BIAS, linear=unit * G * up))
        poses.append(odometry.process(scanned, begin_ns, np.linspace(0, 0.0999, len(scanned))))
    return np.stack(poses)


@pytest.mark.slow
@rows("roll, unit", [(0.0, 1.0), (0.6, 1.0), (-2.0, 1.0), (0.6, 1 / 9.80665)])
def test_gravity_and_bias_are_felt_however_the_scanner_is_tilted(
    roll: float, unit: float, caplog: pytest.LogCaptureFixture
) -> None:
    tilt = exp(np.array([0, 0, 0, roll, 0.3 * roll, 0]))[:3, :3]
    odometry = LidarOdometry(scan_from_imu=MOUNT)
    caplog.clear()
    poses = stand(odometry, tilt, unit=unit)
    np.testing.assert_allclose(poses, np.tile(np.eye(4), (12, 1, 1)), atol=0.005)
    felt = odometry.felt
    assert felt is not None and felt.bias is not None
    np.testing.assert_allclose(felt.up, tilt.T @ [0, 0, 1], atol=1e-6)
    assert felt.gravity == pytest.approx(G, abs=0.01)
    np.testing.assert_allclose(felt.bias, BIAS, atol=1e-9)
    assert ("measure in g" in caplog.text) == (unit != 1)


def test_how_the_imu_was_carried_before_the_first_scan_is_no_matter() -> None:
    odometry = LidarOdometry(scan_from_imu=MOUNT)
    for k in range(800):  # from five seconds to one before, lying on its side
        stamp_ns = S - 5 * S + k * S // 200
        carried = np.array([0.0, G, 0.0])
        odometry.add(Imu(stamp_ns=stamp_ns, frame_id="imu", angular=np.ones(3), linear=carried))
    stand(odometry, np.eye(3), 2)
    assert odometry.felt is not None
    np.testing.assert_allclose(odometry.felt.up, [0, 0, 1], atol=1e-6)


@pytest.mark.slow
def test_equal_scans_give_equal_bits() -> None:
    one, other = (stand(LidarOdometry(scan_from_imu=MOUNT), np.eye(3), 4) for _ in range(2))
    assert one.tobytes() == other.tobytes()


def test_a_message_that_is_none_changes_nothing() -> None:
    odometry = LidarOdometry(scan_from_imu=MOUNT)
    nothing = Imu(stamp_ns=S, frame_id="imu", angular=np.zeros(3), linear=np.full(3, np.nan))
    with pytest.raises(DataError, check=has_code("not-finite")):
        odometry.add(nothing)
    for place in (np.diag([1.0, 1.0, 2.0, 1.0]), np.full((4, 4), np.nan), np.eye(3)):
        with pytest.raises((DataError, ShapeError), match="scan_from_imu"):
            LidarOdometry(scan_from_imu=place)
    with pytest.raises(ConfigError, match="scan_from_imu"):
        LidarOdometry().add(nothing)
    stand(odometry, np.eye(3), 2)


def test_the_end_of_its_process_is_an_error() -> None:
    odometry = LidarOdometry(scan_from_imu=MOUNT)
    stand(odometry, np.eye(3), 1)
    assert odometry._inertial is not None
    odometry._inertial._process.kill()
    with pytest.raises(FusionSlamError, check=has_code("process", "-9")):
        stand(odometry, np.eye(3), 2, begin_s=2)
