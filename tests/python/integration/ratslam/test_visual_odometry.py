# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Visual odometry in a round room of known size, and on images of a simulated drive."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.datasets import open_dataset
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.geometry.trajectory import read_trajectory
from fusionslam.ratslam import VisualOdometry, VisualSpeed
from fusionslam.ratslam.visual_odometry import fit_speed
from fusionslam.sensors.frame import Camera
from rows import rows
from worlds import RADIUS_M, ROOM_HEIGHT, ROOM_WIDTH, VIEW, room_image

TENTH = 100_000_000


def drive(odometry: VisualOdometry, images: list[Any], gap_ns: int = TENTH) -> list[Any]:
    found = [odometry.process(image, gap_ns * n) for n, image in enumerate(images)]
    assert found[0] is None
    return found[1:]


@rows("turn", [0.0, 0.0011, 0.02, -0.047, 0.09, -0.17])
def test_a_turn_is_found_to_a_fraction_of_a_pixel_whatever_its_size(turn: Any) -> None:
    images = [room_image(yaw=turn * n) for n in range(6)]
    for seen in drive(VisualOdometry(), images):
        assert seen.w * seen.dt == pytest.approx(turn, abs=0.15 * VIEW / ROOM_WIDTH)
        assert abs(seen.v) < 0.1 and not seen.why


def test_the_original_sees_no_turn_beyond_its_largest_shift() -> None:
    images = [room_image(yaw=0.17 * n) for n in range(6)]
    found = drive(VisualOdometry(preset="openratslam"), images)
    assert all(abs(seen.w - 1.7) > 0.3 for seen in found)


def test_a_turn_beyond_the_search_range_is_reported() -> None:
    found = drive(VisualOdometry(max_turn=0.5), [room_image(), room_image(yaw=0.12)])
    assert found[0].doubt == "images-differ"


@rows("metres_a_second", [0.0, 0.2, 0.6, -0.4])
def test_speed_is_right_once_the_distance_is(metres_a_second: Any) -> None:
    images = [room_image(x=metres_a_second * n / 10) for n in range(-4, 5)]
    found = drive(VisualOdometry(distance_m=RADIUS_M), images)
    assert np.mean([seen.v for seen in found]) == pytest.approx(metres_a_second, abs=0.04)
    assert max(abs(seen.w) for seen in found) < 0.02


def test_fitting_to_a_metre_and_a_half_finds_how_far_the_walls_are() -> None:
    steps = np.r_[np.full(15, 0.05), np.full(25, 0.03)]
    ways = np.r_[0, np.cumsum(steps)] - 0.75
    odometry = VisualOdometry()
    found = drive(odometry, [room_image(x=way) for way in ways])
    fitted = fit_speed(odometry.config, found, steps / 0.1)
    assert fitted.distance_m == pytest.approx(RADIUS_M, rel=0.12)
    original = VisualOdometry(preset="openratslam")
    seen = drive(original, [room_image(x=way) for way in ways])
    scaled = fit_speed(original.config, seen, steps / 0.1).difference_scale
    changes = np.array([one.change for one in seen])
    assert (scaled * changes).sum() / 10 == pytest.approx(ways[-1] - ways[0], rel=0.3)


@rows(
    "speeds, error",
    [
        ([1.0, 1.0], ShapeError),
        ([1.0, 1.0, 1.0, np.nan] + [1.0] * 26, DataError),
        # Of 0.3 m, and of 1.8 m while the images do not move.
        *[([speed] * 30, DataError) for speed in (0.1, 0.6)],
    ],
)
def test_a_fit_to_unusable_speeds_is_refused(speeds: Any, error: type[Exception]) -> None:
    still = [VisualSpeed(0, 0, 0.1, 0, 0)] * 30
    with pytest.raises(error):
        fit_speed(VisualOdometry().config, still, speeds)


def test_the_stamps_count_and_not_a_fixed_rate() -> None:
    images = [room_image(), room_image(yaw=0.05)]
    for gap in (0.05, 0.1, 0.25):
        ours = drive(VisualOdometry(), images, int(gap * 1e9))[0]
        assert (ours.w, ours.dt) == (pytest.approx(0.05 / gap, rel=0.02), pytest.approx(gap))
        theirs = drive(VisualOdometry(preset="openratslam"), images, int(gap * 1e9))[0]
        assert theirs.w == pytest.approx(0.5, rel=0.1)  # as if a tenth of a second had passed


def test_the_exposure_does_not_change_the_speed() -> None:
    first, second = room_image(), room_image(x=0.05, yaw=0.03)
    darker = (second * 0.7 + 12).round().astype(np.uint8)
    plain, exposed = (drive(VisualOdometry(), [first, image])[0] for image in (second, darker))
    assert exposed.v == pytest.approx(plain.v, abs=0.02)
    assert exposed.w == pytest.approx(plain.w, abs=0.005)
    original = VisualOdometry(preset="openratslam")
    lit = drive(original, [first, darker])[0]
    assert lit.change > 3 * drive(VisualOdometry(preset="openratslam"), [first, second])[0].change


def test_the_original_is_its_formula() -> None:
    rng = np.random.default_rng(1)
    wide = rng.integers(0, 256, (10, 140), np.uint8)
    left, right = np.ascontiguousarray(wide[:, 20:120]), np.ascontiguousarray(wide[:, 13:113])
    odometry = VisualOdometry(preset="openratslam", turn_rows=(0.0, 1.0), speed_rows=(0.0, 1.0))
    seen = drive(odometry, [left, right])[0]
    assert seen == VisualSpeed(0.0, pytest.approx(7 * 1.0 / 100 * 10), 0.1, 7.0, 0.0)
    other = rng.integers(0, 256, (10, 100), np.uint8)
    profiles = [image.mean(0) / 255 for image in (right, other)]
    least = min(
        np.abs(
            profiles[1][max(k, 0) : 100 + min(k, 0)] - profiles[0][max(-k, 0) : 100 - max(k, 0)]
        ).mean()
        for k in range(-40, 41)
    )
    seen = odometry.process(other, 2 * TENTH)
    assert (seen.change, seen.v) == (pytest.approx(least), pytest.approx(min(20 * least, 1.0)))


def test_the_field_of_view_is_the_cameras() -> None:
    view = 1.5
    focal = ROOM_WIDTH / 2 / np.tan(view / 2)
    matrix = np.array([[focal, 0, (ROOM_WIDTH - 1) / 2, 0], [0, focal, 12, 0], [0, 0, 1, 0]])
    images = [room_image(view=view), room_image(yaw=0.08, view=view)]
    seen = drive(VisualOdometry(camera=Camera(matrix, size=(ROOM_WIDTH, ROOM_HEIGHT))), images)[0]
    assert seen.w == pytest.approx(0.8, abs=0.01)
    assert abs(drive(VisualOdometry(), images)[0].w - 0.8) > 0.1
    with pytest.raises(ShapeError, match="640x480"):
        VisualOdometry(camera=Camera(matrix, size=(640, 480))).process(images[0], 0)
    with pytest.raises(ConfigError, check=has_code("out-of-range", "camera")):
        VisualOdometry(camera=Camera(-matrix))


def test_unused_rows_may_be_missing_if_the_camera_has_its_size() -> None:
    matrix = np.array([[290, 0, (ROOM_WIDTH - 1) / 2, 0], [0, 290, 12, 0], [0, 0, 1, 0]], float)
    camera = Camera(matrix, size=(ROOM_WIDTH, ROOM_HEIGHT))
    images = [room_image(), room_image(x=0.03, yaw=0.05)]
    used = VisualOdometry().rows_used(ROOM_HEIGHT)
    assert used < ROOM_HEIGHT
    upper = [image[:used] for image in images]
    assert drive(VisualOdometry(camera=camera), upper) == drive(
        VisualOdometry(camera=camera), images
    )
    for image in (images[0][: used - 1], np.vstack([images[0], images[0]])):
        with pytest.raises(ShapeError, match="320x24"):
            VisualOdometry(camera=camera).process(image, 0)


def test_images_without_contrast_say_so_and_give_no_nan() -> None:
    blank = np.full((ROOM_HEIGHT, ROOM_WIDTH), 77, np.uint8)
    for images in ([blank, blank], [room_image(), blank], [blank, room_image()]):
        seen = drive(VisualOdometry(), images)[0]
        assert (seen.v, seen.w, seen.doubt) == (0.0, 0.0, "no-contrast")


def test_after_a_gap_the_next_image_is_a_first_one_again(caplog: pytest.LogCaptureFixture) -> None:
    odometry = VisualOdometry()
    odometry.process(room_image(), 0)
    with caplog.at_level(logging.WARNING):
        assert odometry.process(room_image(yaw=0.3), 3_000_000_000) is None
    assert "3.00 s" in caplog.text
    seen = odometry.process(room_image(yaw=0.32), 3_100_000_000)
    assert seen.w == pytest.approx(0.2, abs=0.02)


def test_invalid_input_is_refused_and_changes_nothing() -> None:
    odometry, untouched, later = VisualOdometry(), VisualOdometry(), room_image(yaw=0.05)
    for one in (odometry, untouched):
        drive(one, [room_image(), room_image(yaw=0.02)])
    for stamp in (TENTH, 0):
        with pytest.raises(DataError):
            odometry.process(later, stamp)
    zeros = [np.zeros(shape, np.uint8) for shape in ((24, 320, 4), (0, 320), (24, 8))]
    for image in (later[:, :300], later.astype(float), *zeros):
        with pytest.raises(ShapeError):
            odometry.process(image, 2 * TENTH)
    assert odometry.process(later, 3 * TENTH) == untouched.process(later, 3 * TENTH)


def test_a_run_that_goes_on_from_its_state_is_the_same_bit_for_bit() -> None:
    images = [room_image(x=0.01 * n, yaw=0.02 * n) for n in range(8)]
    whole = drive(VisualOdometry(), images)
    first, second = VisualOdometry(), VisualOdometry()
    second.restore(first.state())
    drive(first, images[:4])
    second.restore(first.state())
    rest = [second.process(image, (4 + n) * TENTH) for n, image in enumerate(images[4:])]
    assert rest == whole[3:]


def test_a_broken_state_is_refused() -> None:
    odometry = VisualOdometry()
    odometry.process(room_image(), 0)
    state = odometry.state()
    for broken in (
        state | {"turn": state["turn"][:-1]},
        state | {"speed": state["speed"] * np.nan},
        state | {"shape": np.array([1])},
        state | {"stamp_ns": np.array("x")},
        {"turn": state["turn"]},
    ):
        with pytest.raises(DataError):
            odometry.restore(broken)
    np.testing.assert_equal(odometry.state(), state)


@rows(
    "changes, message",
    [
        ({"turn_rows": (0.5, 0.5)}, "turn_rows"),
        ({"speed_rows": (-0.1, 0.5)}, "speed_rows"),
        ({"field_of_view": 3.2}, "field_of_view"),
        ({"distance": 3.0}, "distance_m"),
    ],
)
def test_bad_configurations_name_the_key(changes: Any, message: Any) -> None:
    with pytest.raises(ConfigError, match=message):
        VisualOdometry(**changes)


def test_shifts_between_the_references_images_are_those_that_it_was_given(test_data: Path) -> None:
    folder = test_data / "reference" / "ratslam"
    images = np.load(folder / "lv_images.npz")["images"]
    _, lap, place, moved_px = np.loadtxt(folder / "lv_truth.csv", int, delimiter=",", skiprows=1).T
    again = np.flatnonzero(lap == 1)
    pairs = [(images[2 * place[frame]], images[frame]) for frame in again]
    theirs = [drive(VisualOdometry(preset="openratslam"), pair)[0].shift_px for pair in pairs]
    # Truth counts the crop that moved: what is seen moves against it, and has another exposure.
    assert np.abs(theirs + moved_px[again]).max() <= 2
    ours = [drive(VisualOdometry(max_turn=4.0), pair)[0] for pair in pairs]
    assert not any(seen.why for seen in ours)
    assert np.abs([seen.shift_px for seen in ours] + moved_px[again]).max() < 1
    others = [drive(VisualOdometry(), images[[n, n + 1]])[0] for n in range(1, 119, 2)]
    assert all(seen.doubt == "images-differ" for seen in others)


@pytest.mark.slow
def test_turns_and_speeds_of_a_simulated_drive_are_near_the_truth(test_data: Path) -> None:
    dataset = open_dataset(test_data / "bags" / "small_house_20s.bag")
    images = dataset.camera_images()
    way = read_trajectory(test_data / "worlds" / "small_house.trajectory.csv")
    x, y, yaw = way.places(images.seconds - images.seconds[0])
    middle = yaw[:-1] + np.diff(yaw) / 2
    v = (np.cos(middle) * np.diff(x) + np.sin(middle) * np.diff(y)) * 10
    w = np.diff(yaw) * 10
    pictures = [images.image(n) for n in range(len(images))]
    ours = np.array([seen[:2] for seen in drive(VisualOdometry(), pictures)])
    theirs = np.array([seen[:2] for seen in drive(VisualOdometry(preset="openratslam"), pictures)])
    ours, theirs = (np.sqrt(((one - np.stack([v, w], 1)) ** 2).mean(0)) for one in (ours, theirs))
    assert ours[1] < 0.02 and theirs[1] > 5 * ours[1]
    assert ours[0] < 0.16 < v.std() < theirs[0]
