# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""An IMU is found by how it and a LiDAR move, or the motion that is missing is said."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import ortho_group

from error_codes import has_code
from fusionslam.base.arrays import Floats
from fusionslam.calibration.estimate import Estimate
from fusionslam.calibration.lidar_imu import ImuRows, calibrate_imu, read_imu, solve
from fusionslam.calibration.scan_path import PathPiece, PoseSpline, ScanPath
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import exp
from fusionslam.sensors.messages import Imu
from fusionslam.sim.imu import simulate_imu
from fusionslam.sim.robot import ImuMount

S = 1_000_000_000
MOUNT = exp(np.array([0.1, -0.05, 0.15, 0.3, -0.5, 1.2]))
"""lidar_from_imu."""
LATE_S = 0.06
TURNS, PLACES = np.radians([6.0, 5.0, 20.0]), np.array([0.3, 0.2, 0.05])
"""Of the motion in the hand: amplitudes about and along x, y, z."""
TURN_SD, PLACE_SD = np.radians(0.03), 0.003
"""Of poses of scans."""


def poses(seconds: Floats, turns: Sequence[float] | Floats = TURNS) -> Floats:
    """Poses at times: a slow way ahead, and waves of six rates."""
    waves = np.sin(2 * np.pi * np.outer(seconds, [0.31, 0.43, 0.23, 1.0, 0.9, 0.7]) + range(6))
    found = np.tile(np.eye(4), (len(seconds), 1, 1))
    found[:, :3, :3] = Rotation.from_rotvec(waves[:, 3:] * turns).as_matrix()
    ahead = np.c_[0.3 * seconds, 0 * seconds, 0 * seconds]
    found[:, :3, 3] = ahead + waves[:, :3] * PLACES * (np.linalg.norm(turns) > 0)
    return found


def moved(
    turns: Sequence[float] | Floats = TURNS, *, count: int = 120, seed: int = 0
) -> tuple[ScanPath, ImuRows]:
    """The path of a LiDAR at 10 Hz, and an IMU at 100 Hz that speaks before and after, too."""
    rng = np.random.default_rng([51, seed])
    at = np.arange(count) / 10
    noisy = poses(at, turns)
    noise = Rotation.from_rotvec(TURN_SD * rng.standard_normal((count, 3))).as_matrix()
    noisy[:, :3, :3] = noisy[:, :3, :3] @ noise
    noisy[:, :3, 3] += PLACE_SD * rng.standard_normal((count, 3))
    seconds = np.arange(-150, 10 * count + 150) / 100
    track = simulate_imu(lambda t: poses(t, turns) @ MOUNT, ImuMount(rate_hz=100.0), seconds, rng)
    path = ScanPath(0, [PathPiece(at, noisy)])
    return path, ImuRows(seconds + LATE_S, track.angular, track.linear)


def named(estimates: list[Estimate]) -> dict[str, Estimate]:
    return {each.name: each for each in estimates}


def test_turn_place_and_delay_are_found() -> None:
    path, imu = moved()
    off = exp(np.array([0.1, 0.0, 0.05, 0.02, -0.03, 0.05]))
    found = named(calibrate_imu(path, imu, off @ MOUNT).estimates)
    back = Rotation.from_matrix(off[:3, :3]).inv().as_rotvec(degrees=True)
    for axis, turn, place in zip("xyz", back, MOUNT[:3, 3], strict=True):
        said = found[f"IMU turned about {axis}"]
        assert said.value == pytest.approx(turn, abs=0.1) and said.differs
        held = found[f"IMU at {axis}"]
        assert held.value == pytest.approx(place, abs=held.half_width) and held.value is not None
    assert found["IMU late by"].value == pytest.approx(1000 * LATE_S, abs=2)
    assert found["IMU late by"].half_width == pytest.approx(0, abs=2)


def test_the_pose_that_is_given_back_is_the_true_one() -> None:
    path, imu = moved()
    found = calibrate_imu(path, imu, None)
    off = Rotation.from_matrix(found.lidar_from_imu[:3, :3] @ MOUNT[:3, :3].T)
    assert np.degrees(off.magnitude()) < 0.1
    np.testing.assert_allclose(found.lidar_from_imu[:3, 3], MOUNT[:3, 3], atol=0.03)


def test_the_turning_that_is_given_back_is_that_of_the_lidar() -> None:
    path, imu = moved()
    at = np.linspace(0.5, 11, 50)
    turning = calibrate_imu(path, imu, None).turning
    assert turning is not None
    turned = turning(at)
    true = Rotation.from_matrix(poses(at)[:, :3, :3])
    off = (true[0].inv() * true).inv() * (turned[0].inv() * turned)
    assert np.degrees(off.magnitude()).max() < 0.3  # the bias is known so well


def test_a_straight_drive_cannot_say_anything_of_an_imu() -> None:
    path, imu = moved(np.zeros(3))
    for each in calibrate_imu(path, imu, MOUNT).estimates:
        assert each.value is None and each.half_width is None
        assert each.missing is not None and "needed" in each.missing


def test_a_drive_on_a_plane_cannot_say_what_its_turns_do_not_show() -> None:
    path, imu = moved([0, 0, 1.5])
    found = calibrate_imu(path, imu, MOUNT)
    estimates = named(found.estimates)
    said = {name for name, each in estimates.items() if each.value is not None}
    assert said == {"IMU late by"}
    assert estimates["IMU late by"].value == pytest.approx(1000 * LATE_S, abs=2)
    missing = estimates["IMU turned about z"].missing
    assert missing is not None and "about x or y" in missing
    assert found.turning is None
    # Nothing replaces what is stated where a part of the turn is unknown.
    np.testing.assert_array_equal(found.lidar_from_imu, MOUNT)


def lost(piece: PathPiece) -> PathPiece:
    """The piece, whose scans were registered wrongly: pitch sways by 3 degrees."""
    wrong = piece.poses.copy()
    sway = np.outer(np.radians(3) * np.sin(5 * piece.seconds), [0, 1, 0])
    wrong[:, :3, :3] = Rotation.from_rotvec(sway).as_matrix() @ wrong[:, :3, :3]
    return PathPiece(piece.seconds, wrong)


def test_a_path_that_turns_otherwise_than_the_gyroscope_is_refused() -> None:
    path, imu = moved()
    wrong = ScanPath(0, [lost(path.pieces[0])])
    with pytest.raises(DataError, match="otherwise", check=has_code("path")):
        calibrate_imu(wrong, imu, MOUNT)


def test_a_piece_of_a_path_that_is_wrong_does_not_count() -> None:
    path, imu = moved(count=200)
    whole = path.pieces[0]
    good, bad = (PathPiece(whole.seconds[k], whole.poses[k]) for k in np.split(np.arange(200), 2))
    alone = calibrate_imu(ScanPath(0, [good]), imu, MOUNT)
    both = calibrate_imu(ScanPath(0, [good, lost(bad)]), imu, MOUNT)
    for one, other in zip(alone.estimates, both.estimates, strict=True):
        assert other.value == pytest.approx(one.value, abs=0.1 * (one.half_width or 0))


def test_intervals_allow_for_what_the_last_round_changed() -> None:
    path, imu = moved()
    first = calibrate_imu(path, imu, MOUNT)
    off = exp(np.array([0, 0, 0, 0, 0, np.radians(0.2)]))[:3, :3]
    leaned = type(first)(**{**vars(first), "turn": off @ first.turn, "delay": first.delay + 0.003})
    again = named(calibrate_imu(path, imu, MOUNT, leaned).estimates)
    assert (again["IMU turned about z"].half_width or 0) >= 0.2
    assert (again["IMU late by"].half_width or 0) >= 3


def test_accelerations_in_g_are_taken_for_that() -> None:
    path, imu = moved()
    found = calibrate_imu(path, imu._replace(linear=imu.linear / 9.80665), MOUNT)
    assert found.unit == 9.80665
    assert named(found.estimates)["IMU at x"].value == pytest.approx(MOUNT[0, 3], abs=0.03)


def test_wrong_imus_are_named() -> None:
    path, imu = moved()
    with pytest.raises(DataError, match="expected gravity", check=has_code("imu-unit")):
        calibrate_imu(path, imu._replace(linear=imu.linear * 0.3), None)
    with pytest.raises(DataError, match="late", check=has_code("clock")):
        calibrate_imu(path, imu._replace(seconds=imu.seconds + 1.2), None)
    apart = (imu.seconds < 0) | (imu.seconds > 10)
    with pytest.raises(DataError, match="too little", check=has_code("gap")):
        calibrate_imu(path, ImuRows(*(rows[apart] for rows in imu)), None)


def message(seconds: float, angular: float = 0.0, linear: float = 9.8) -> Imu:
    return Imu(
        stamp_ns=round(seconds * S),
        frame_id="imu",
        angular=np.array([angular, 0, 0]),
        linear=np.array([0, 0, linear]),
    )


def test_messages_that_cannot_be_are_refused() -> None:
    path, _ = moved()
    with pytest.raises(DataError, match="no messages", check=has_code("no-imu")):
        read_imu([], path)
    with pytest.raises(DataError, match="3000000000 ns", check=has_code("not-finite")):
        read_imu([message(2), message(3, linear=np.nan)], path)
    with pytest.raises(DataError, match="degrees", check=has_code("imu-unit")):
        read_imu([message(2, angular=57.0)], path)
    with pytest.raises(DataError, match="clocks are apart", check=has_code("clock")):
        read_imu([message(3600), message(3601)], path)


def test_messages_are_sorted_by_stamp_and_counted_once() -> None:
    path, _ = moved()
    rows = read_imu([message(3, 0.3), message(2, 0.2), message(3, 0.3)], path)
    np.testing.assert_allclose(rows.seconds, [2, 3])
    np.testing.assert_allclose(rows.angular[:, 0], [0.2, 0.3])


def test_intervals_hold_where_errors_that_follow_each_other_are_alike() -> None:
    rng, held = np.random.default_rng(52), []
    labels = np.repeat(np.arange(60), 4)
    for _ in range(60):
        model = np.c_[np.ones(240), np.repeat(rng.standard_normal(60), 4)]
        errors = np.repeat(rng.standard_normal(60), 4) + 0.3 * rng.standard_normal(240)
        fit = solve(model, model @ [2.0, -1.0] + errors, labels)
        held += (np.abs(fit.values - [2.0, -1.0]) <= fit.half_widths).tolist()
    assert 0.9 <= np.mean(held) <= 0.99


def test_columns_that_cannot_be_told_apart_have_no_interval() -> None:
    rng = np.random.default_rng(53)
    one = rng.standard_normal(100)
    fit = solve(np.c_[one, 2 * one, rng.standard_normal(100)], one, np.arange(100) // 5)
    assert (fit.half_widths[:2] > 1e3 * fit.half_widths[2]).all()


def test_a_path_turns_as_told_between_its_poses() -> None:
    at, between = np.arange(0, 10, 0.5), np.linspace(1, 9, 100)
    fixed = ortho_group.rvs(3, random_state=1)
    fixed *= np.linalg.det(fixed)

    def told(seconds: Floats) -> Rotation:
        return Rotation.from_matrix(fixed @ poses(seconds)[:, :3, :3])

    spline = PoseSpline(at, poses(at), told)
    np.testing.assert_allclose(spline.at(between)[:, :3, :3], poses(between)[:, :3, :3], atol=1e-9)
