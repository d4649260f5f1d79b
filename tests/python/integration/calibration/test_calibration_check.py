# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Wrong turns, shifts and delays put in on purpose are found; right calibrations are left alone."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

import fusionslam
from artefacts import artefact
from benchmarks.accuracy.calibration import Turned
from cli import succeeds
from error_codes import has_code
from fusionslam.calibration.check import (
    CalibrationCheck,
    Curve,
    Turn,
    _verdict,
    check_calibration,
    frames_of,
    write_overlays,
)
from fusionslam.calibration.edges import depth_edges, edge_map
from fusionslam.calibration.search import (
    CalibrationCheckConfig,
    Recording,
    camera_shifts,
    camera_turns,
)
from fusionslam.config import with_settings
from fusionslam.errors import DataError
from fusionslam.pipelines.compare_descriptors import QUICK_TOWN
from fusionslam.sensors.frame import Frame
from fusionslam.sim import SimConfig, record
from recordings import town_drive
from rows import rows
from turning_robot import OPTICAL, Drive, make_drive

Degrees = tuple[float, float, float]
CONFIG = CalibrationCheckConfig(points=250)


def check(recording: Recording, **changes: float) -> CalibrationCheck:
    return check_calibration(recording, CONFIG.model_copy(update=changes))


def camera_turned(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """points_turn: how points move in optical axes if the camera turns so (degrees).

    Composed in the robot's axes (x forward, y left, z up), where roll is right side down, pitch
    is nose down and yaw is to the left.
    """
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("zyx", [yaw, pitch, roll], degrees=True).as_matrix()
    return OPTICAL @ np.linalg.inv(turn) @ np.linalg.inv(OPTICAL)


def test_the_angles_are_those_of_a_robot_that_looks_along_the_camera() -> None:
    for angles in ((5, 0, 0), (0, 5, 0), (0, 0, 5)):
        np.testing.assert_allclose(
            camera_turns(np.array([angles], dtype=float))[0], camera_turned(*angles), atol=1e-12
        )
    moved = camera_shifts(np.array([[0.1, 0.2, 0.3]]))[0] @ [1.0, 1, 1, 1]
    np.testing.assert_allclose(moved, [0.9, 0.8, 0.7, 1])


def test_a_right_calibration_fits() -> None:
    found = check(make_drive(8))
    assert found.fits
    assert np.abs(found.turn.degrees[1:]).max() <= 0.3
    assert abs(found.curves["delay"].best) <= 0.02
    assert found.curves["yaw"].scores.max() > 1.3 * found.curves["yaw"].scores[0]


@rows("angles", [(0.0, 0.0, 1.5), (0.0, -1.5, 0.0), (0.0, 1.0, -2.0)])
def test_a_turned_camera_is_found(angles: Degrees) -> None:
    present = np.linalg.inv(camera_turned(*angles)) @ OPTICAL
    found = check(make_drive(6, present=present))
    assert found.fits is False
    assert np.abs(np.subtract(found.turn.degrees, angles))[1:].max() <= 0.3
    for (low, high), angle in zip(found.turn.ranges[1:], angles[1:], strict=True):
        assert low - 0.2 <= angle <= high + 0.2


@pytest.mark.parametrize(("delay", "words"), [(0.1, "late by 0.1 s"), (-0.08, "early by 0.08 s")])
def test_a_delay_is_found_on_a_turn(delay: float, words: str) -> None:
    found = check(make_drive(8, delay=delay))
    assert found.fits is False and "images" in found.verdict
    assert abs(found.curves["delay"].best - delay) <= 0.021
    assert words in found.verdict


def test_a_delay_of_whole_frames_is_found_without_odometry() -> None:
    found = check(make_drive(7, delay=0.4, odometry=False), delay=0.8)
    assert found.curves["delay"].best == pytest.approx(0.4)
    np.testing.assert_allclose(found.curves["delay"].values, [-0.8, -0.4, 0, 0.4, 0.8])
    assert "0.4 s" in found.verdict
    # A single frame tells nothing of it.
    assert "delay" not in check(make_drive(1, odometry=False)).curves


def test_images_without_edges_say_nothing() -> None:
    grey = {"left": np.full((200, 320, 3), 99, np.uint8)}
    frames = [
        Frame(stamp_ns=f.stamp_ns, points=f.points, images=grey, cameras=f.cameras)
        for f in make_drive(4).frames
    ]
    assert check(Drive(frames)).fits is None


def test_extrinsics_that_are_wholly_wrong_are_named_as_a_possible_cause() -> None:
    upside_down = camera_turned(180, 0, 0) @ OPTICAL
    found = check(make_drive(8, present=upside_down))
    assert found.points > 500 and found.fits is None
    assert "wholly wrong" in found.verdict
    few = check(make_drive(3, present=upside_down), points=100)
    assert few.fits is None and "wholly wrong" not in few.verdict
    # Inverted extrinsics leave no point in these images.
    with pytest.raises(DataError, match="wholly wrong", check=has_code("few-edges")):
        check(make_drive(2, present=np.linalg.inv(OPTICAL)))


@rows(
    "roll, score, words",
    [
        (0.2, 0.021, "calibration fits (little can be said about roll)"),
        (1.5, 0.015, "calibration fits (little can be said about roll)"),
        (1.5, 0.020, "cannot say: roll +1.5 deg scores 0.0200 against 0.0138"),
        (3.5, 0.014, "cannot say: the best roll lies at the edge of what was tried"),
        (-3.0, 0.014, "cannot say: the best roll lies at the edge of what was tried"),
    ],
)
def test_a_doubtful_best_is_not_said_to_fit(roll: float, score: float, words: str) -> None:
    ranges = ((-3.5, 3.5), (-0.5, 0.5), (-0.5, 0.5))
    turn = Turn(degrees=(roll, 0.0, 0.0), ranges=ranges, score=score, errors=1.5)
    verdict, fits = _verdict(0.0138, turn, {}, CalibrationCheckConfig(), "try more")
    assert verdict.startswith(words) and fits is (True if "fits" in words else None)
    assert ("0.4 deg" in verdict and "0.06 m" in verdict) == bool(fits)


@rows("bound, fits", [(0.9, True), (1.4, None)])
def test_it_fits_only_if_an_error_of_a_degree_would_be_noticed(
    bound: float, fits: bool | None
) -> None:
    ranges = ((-0.5, 0.5), (-bound, 0.2), (-0.5, 0.5))
    turn = Turn(degrees=(0.0, -0.1, 0.0), ranges=ranges, score=0.014, errors=0.5)
    assert _verdict(0.0138, turn, {}, CalibrationCheckConfig(), "try more")[1] is fits


@rows("low, high, flat", [(-0.2, 0.1, True), (-0.1, 0.2, True), (-0.1, 0.1, False)])
def test_a_value_is_undetermined_if_nearly_all_are_plausible(
    low: float, high: float, flat: bool
) -> None:
    values = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    assert Curve("delay", values, np.zeros(5), low, high, errors=0.0).flat is flat


def test_a_shift_is_not_believed_if_a_turn_gains_far_more() -> None:
    values = np.array([-0.2, 0.0, 0.2])
    down = Curve("down", values, np.array([0.10, 0.08, 0.07]), low=-0.2, high=-0.2, errors=4.0)
    for score, fits in ((0.105, False), (0.15, None)):
        ranges = ((-0.5, 0.5), (-0.9, 0.2), (-0.5, 0.5))
        turn = Turn(degrees=(0.0, -0.5, 0.0), ranges=ranges, score=score, errors=1.9)
        assert _verdict(0.08, turn, {"down": down}, CalibrationCheckConfig(), "try")[1] is fits


@pytest.fixture(scope="module")
def town() -> fusionslam.Dataset:
    return fusionslam.open_dataset(town_drive(), sensors=["points", "left"])


@pytest.mark.parametrize("degrees", [(0.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, -1.0)])
def test_a_town_is_judged_right(town: fusionslam.Dataset, degrees: Degrees) -> None:
    found = check_calibration(Turned(town, degrees), CalibrationCheckConfig(frames=5))
    assert found.fits is not any(degrees)
    assert np.abs(np.subtract(found.turn.degrees, degrees)).max() <= 0.5


@pytest.mark.nightly
def test_sensors_of_the_quick_demo_are_judged_right() -> None:
    small = [*QUICK_TOWN, "sim.drive.spacing_m=6"]
    config = with_settings(SimConfig(), [each.removeprefix("sim.") for each in small])
    town = artefact("calibration-quick-town", lambda folder: record(config, folder / "drive"))
    recording = fusionslam.open_dataset(town / "drive", sensors=["points", "left"])
    right = check_calibration(recording)
    assert right.fits and abs(right.turn.degrees[1]) <= 0.4
    for degrees in ((0.0, 1.5, 0.0), (0.0, 0.0, -1.5)):
        found = check_calibration(Turned(recording, degrees))
        assert found.fits is False
        assert np.abs(np.subtract(found.turn.degrees, degrees))[1:].max() <= 0.5


@rows("jobs", [1, 2])
def test_the_same_data_give_the_same_answer(tmp_path: Path, jobs: int) -> None:
    for name in ("a.json", "b.json"):
        found = check_calibration(make_drive(2), CONFIG, jobs=1 if name == "a.json" else jobs)
        found.save(tmp_path / name)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    stored = json.loads((tmp_path / "a.json").read_text())
    assert stored["format"] == "fusionslam.calib_check.1" and stored["frames"] == [100, 101]
    assert len(stored["curves"]["yaw"]["scores"]) == len(stored["curves"]["yaw"]["values"]) == 61


UP = np.array([0.0, 0.0, 1.0])
ELEVATIONS, AZIMUTHS = np.meshgrid(
    np.radians(np.arange(-20, 10.1, 0.5)), np.radians(np.arange(-20, 20.1, 0.4))
)
FLAT = np.cos(ELEVATIONS)
RAYS = np.stack([FLAT * np.cos(AZIMUTHS), FLAT * np.sin(AZIMUTHS), np.sin(ELEVATIONS)], axis=-1)
RAYS = RAYS.reshape(-1, 3)


def seen_on(rays: NDArray[np.float64], *distances: NDArray[np.float64]) -> NDArray[np.float32]:
    """Points where the rays first hit one of several surfaces."""
    nearest = np.min(distances, axis=0)
    hit = np.isfinite(nearest)
    return (rays[hit] * nearest[hit, None]).astype(np.float32)


def plane_ahead(x: float, top: float, bottom: float = -9.0) -> NDArray[np.float64]:
    """Distances to a wall at x between two heights; inf where the rays miss it."""
    distance = x / RAYS[:, 0]
    height = distance * RAYS[:, 2]
    return np.where((height <= top) & (height >= bottom), distance, np.inf)


def ground(height: float) -> NDArray[np.float64]:
    with np.errstate(divide="ignore"):
        distance = height / RAYS[:, 2]
    return np.where((distance > 0) & (distance < 80), distance, np.inf)


def test_edges_lie_between_the_near_side_and_the_far_side_of_a_jump() -> None:
    near = np.where(AZIMUTHS.ravel() > 0.001, plane_ahead(3.0, 9.0), np.inf)
    scan = seen_on(RAYS, near, plane_ahead(5.0, 9.0))
    found, weights, level = depth_edges(scan, UP, 0.3)
    assert not level.any()
    azimuth = np.degrees(np.arctan2(found[:, 1], found[:, 0]))
    # Points of the near side are at 0.4 deg and more, those of the far side at 0 and less.
    assert len(found) > 50
    np.testing.assert_allclose(azimuth, 0.2, atol=0.01)
    np.testing.assert_allclose(found[:, 0], 3.0, rtol=0.01)
    # The jump is 2 m along x.
    np.testing.assert_allclose(weights, np.sqrt(2), rtol=0.2)
    assert len(depth_edges(scan, UP, 2.5)[0]) == 0


def test_a_road_has_no_edges_however_far_apart_the_rings() -> None:
    scan = seen_on(RAYS, ground(-1.7))
    ranges = np.unique(np.linalg.norm(scan, axis=1).round(1))
    assert np.diff(ranges).max() > 5  # rings up to several metres apart
    assert len(depth_edges(scan, UP, 0.3)[0]) == 0


def test_the_pavement_behind_a_kerb_is_no_edge() -> None:
    front = 12.0
    for kerb in (front, front + 0.7, front + 1.5):
        road, pavement = ground(-1.7), ground(-1.55)
        road[road * RAYS[:, 0] > kerb] = np.inf
        pavement[pavement * RAYS[:, 0] < kerb] = np.inf
        scan = seen_on(RAYS, road, pavement, plane_ahead(kerb, top=-1.55, bottom=-1.7))
        assert len(depth_edges(scan, UP, 0.3)[0]) == 0


def test_the_upper_edge_of_a_wall_is_found_without_a_shift_and_the_lower_one_left_out() -> None:
    offsets = []
    for x in (4.0, 4.3, 4.7, 5.1, 5.6, 6.1):
        scan = seen_on(RAYS, plane_ahead(x, top=-0.4, bottom=-0.8), plane_ahead(30.0, 9.0))
        found, _, level = depth_edges(scan, UP, 0.3)
        assert level.any()
        middle = found[level & (np.abs(found[:, 1]) < 0.3)]
        elevation = np.degrees(np.arcsin(middle[:, 2] / np.linalg.norm(middle, axis=1)))
        offsets.append(elevation.mean() - np.degrees(np.arctan2(-0.4, x)))
        assert np.ptp(elevation) < 0.5  # one edge
    assert np.abs(offsets).max() <= 0.26 and abs(np.mean(offsets)) < 0.12


def test_an_image_is_felt_around_its_edges_as_far_as_asked() -> None:
    image = np.zeros((40, 200), np.uint8)
    image[:, 100:] = 200
    near = edge_map(image, 5.0)
    np.testing.assert_array_equal(near[1], 0)
    np.testing.assert_array_equal(edge_map(image.T, 5.0), near[::-1].transpose(0, 2, 1))
    for felt, reach in ((near[0, 20], 5), (edge_map(image, 15.0)[0, 20], 15)):
        assert 97 <= felt.argmax() <= 102 and felt[100] > 0.3
        # Positive up to about the reach, negative beyond it, nothing far away.
        assert felt[100] > felt[100 + reach // 2] > 0 > felt[100 + 2 * reach]
        assert abs(felt[100 + 6 * reach]) < 0.05
        np.testing.assert_allclose(felt[70:97], felt[103:130][::-1], atol=0.02)
    np.testing.assert_array_equal(edge_map(np.full((9, 9, 3), 7, np.uint8), 10.0), 0)


def test_busy_texture_as_such_is_worth_nothing() -> None:
    image = np.zeros((100, 300), np.uint8)
    image[:, 150:] = np.random.default_rng(0).integers(0, 255, (100, 150))
    felt = edge_map(image, 10.0)
    assert np.abs(felt[..., 200:270].mean(axis=(1, 2))).max() < 0.015
    assert np.abs(felt[..., 30:100].mean(axis=(1, 2))).max() < 0.01


def test_frames_are_spread_evenly() -> None:
    assert frames_of(make_drive(3), 10) == [0, 1, 2]
    assert frames_of(Drive([Frame()] * 101), 5) == [0, 25, 50, 75, 100]


def test_what_cannot_be_checked_is_refused_with_the_reason() -> None:
    with pytest.raises(DataError, check=has_code("missing-sensor", 100)):
        check(Drive([Frame()]))
    (frame,) = make_drive(1).frames
    few = Frame(points=frame.points[:50], images=frame.images, cameras=frame.cameras)
    with pytest.raises(DataError, match="among boxes", check=has_code("few-edges")):
        check(Drive([few]))


def test_pictures_have_the_images_size_and_colour_near_and_far(tmp_path: Path) -> None:
    (path,) = write_overlays(make_drive(1), [0], tmp_path)
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    assert path.name == "overlay_000100.png" and picture.shape == (200, 320, 3)
    red, blue = picture[..., 0] - picture[..., 2], picture[..., 2] - picture[..., 0]
    assert (red > 100).sum() > 50 and (blue > 100).sum() > 50


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "frames"),
    [
        ("kitti/raw_2011_09_26", 1),
        ("bags/small_house_20s.bag", 8),  # scans with a fourteenth of the points of KITTI's
        pytest.param("kitti/raw_2011_09_26", 4, marks=pytest.mark.nightly),
        pytest.param("bags/small_house_20s.bag", 20, marks=pytest.mark.nightly),
    ],
)
def test_recordings_fit_until_they_are_turned(test_data: Path, data: str, frames: int) -> None:
    recording = fusionslam.open_dataset(test_data / data, sensors=["points", "left"])
    config = CalibrationCheckConfig(frames=frames, points=600)
    found = check_calibration(recording, config)
    assert found.fits and np.abs(found.turn.degrees).max() <= 0.5, found.turn
    degrees = (0.0, 1.0, -1.5)
    found = check_calibration(Turned(recording, degrees), config)
    assert found.fits is False
    assert np.abs(np.subtract(found.turn.degrees, degrees)).max() <= 0.5, found.turn


def test_the_command_prints_a_table_and_writes_pictures(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    few = ("--pictures", 1, "--set", "calib_check.frames=3")
    done = succeeds("calib-check", recording, "-o", out, *few)
    assert "not surely worse" in done.stdout and "frames" in done.stdout
    assert {path.name for path in out.iterdir()} == {"overlay_000000.png", "calib_check.json"}
