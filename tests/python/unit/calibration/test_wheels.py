# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry's factors and delay are found by the path of a LiDAR, or the motion that is missing."""

from dataclasses import replace

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.base.arrays import Floats
from fusionslam.calibration.scan_path import PathPiece, ScanPath
from fusionslam.calibration.wheels import calibrate_wheels
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import exp
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.messages import Odometry

S = 1_000_000_000
ROBOT_FROM_LIDAR = exp(np.array([-0.1, 0.02, 0.5, 0.0, 0.0, 0.3]))
LATE_S, WAY, TURN = -0.07, 1.03, 0.98
"""Of odometry, and what it makes of a metre and a radian."""


def drive(seconds: Floats, way: float = 1.0, turn: float = 1.0, turns: bool = True) -> Floats:
    """Poses (M, 4, 4) of a robot whose speed and turn rate go up and down, by fine steps."""
    at = np.arange(-5, 45, 0.01)
    ahead = way * (0.6 + 0.4 * np.sin(1.1 * at)) * 0.01
    yaw = np.cumsum(turn * turns * 0.8 * np.sin(0.7 * at + 1) * 0.01)
    middle = yaw - np.diff(yaw, prepend=yaw[0]) / 2
    x, y = np.cumsum(ahead * np.cos(middle)), np.cumsum(ahead * np.sin(middle))
    return ground_poses(*(np.interp(seconds, at, each) for each in (x, y, yaw)))


def lidar(turns: bool = True, count: int = 300) -> ScanPath:
    """The path of a LiDAR on the robot, in two pieces, with errors of millimetres."""
    at = np.arange(count) / 10
    rng = np.random.default_rng(54)
    noise = exp(rng.standard_normal((count, 6)) * np.r_[np.full(3, 0.003), np.full(3, 0.0005)])
    poses = drive(at, turns=turns) @ ROBOT_FROM_LIDAR @ noise
    half = count // 2
    return ScanPath(0, [PathPiece(at[:half], poses[:half]), PathPiece(at[half:], poses[half:])])


def odometry(turns: bool = True, apart_s: float = 0.0) -> list[Odometry]:
    seconds = np.arange(-60, 1000) / 30
    return [
        Odometry(
            stamp_ns=round((at + LATE_S + apart_s) * S),
            frame_id="odom",
            child_frame_id="base",
            pose=pose,
        )
        for at, pose in zip(seconds.tolist(), drive(seconds, WAY, TURN, turns), strict=True)
    ]


def test_factors_and_delay_are_found() -> None:
    way, turn, late = calibrate_wheels(lidar(), odometry(), ROBOT_FROM_LIDAR)
    for found, true in ((way, 1 / WAY), (turn, 1 / TURN), (late, 1000 * LATE_S)):
        assert found.half_width is not None and found.differs
        assert found.value == pytest.approx(true, abs=found.half_width)
    assert (way.half_width or 1) < 0.005 and (turn.half_width or 1) < 0.005
    assert (late.half_width or 99) < 20


def test_a_straight_drive_says_nothing_of_turns() -> None:
    way, turn, _ = calibrate_wheels(lidar(False), odometry(False), ROBOT_FROM_LIDAR)
    assert way.value == pytest.approx(1 / WAY, abs=0.005)
    assert turn.value is None and turn.missing is not None and "turns by" in turn.missing


def test_noise_on_a_straight_drive_is_no_turn() -> None:
    rng = np.random.default_rng(55)
    noisy = [
        replace(each, pose=each.pose @ exp(np.r_[np.zeros(5), 0.001 * rng.standard_normal()]))
        for each in odometry(False)
    ]
    way, turn, _ = calibrate_wheels(lidar(False), noisy, ROBOT_FROM_LIDAR)
    assert way.value is not None and turn.value is None


def test_odometry_of_another_time_is_refused() -> None:
    with pytest.raises(DataError, match="0 seconds of the scans", check=has_code("clock")):
        calibrate_wheels(lidar(), odometry(apart_s=3600.0), ROBOT_FROM_LIDAR)


def test_a_drive_of_some_seconds_is_too_short() -> None:
    with pytest.raises(DataError, match="expected 10", check=has_code("few-scans")):
        calibrate_wheels(lidar(count=80), odometry(), ROBOT_FROM_LIDAR)
