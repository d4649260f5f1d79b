# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Several cameras colour one scan, against NumPy and against one camera each."""

import logging
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from camera_rings import RING, camera_at, picture, points_around, ring, world_colors
from clouds import PROJECTION, scene
from error_codes import has_code
from fusionslam import Camera, ConfigError, DataError, Frame, FusionConfig, ShapeError
from fusionslam.base.texts import PER_FRAME
from fusionslam.fusion import color_cameras, main_camera
from rows import rows

GAINS = np.array([[1.0, 1.0, 1.0], [0.8, 0.9, 1.0], [1.2, 1.1, 1.0], [0.9, 1.0, 1.25]])


def inputs(cameras: dict[str, Camera], gains: Any = 1.0) -> tuple[list[Any], list[Any]]:
    factors = np.broadcast_to(np.asarray(gains, float), (len(cameras), 3))
    images = [picture(camera, gain) for camera, gain in zip(cameras.values(), factors, strict=True)]
    return images, [camera.projection_from_points for camera in cameras.values()]


def centre_distances(points: NDArray[np.float32], cameras: dict[str, Camera]) -> Any:
    """Distance from each image's centre in its half sizes, (N, K); infinite where not seen."""
    found = []
    for camera in cameras.values():
        assert camera.size is not None
        width, height = camera.size
        x, y, depth = camera.projection_from_points @ np.c_[points, np.ones(len(points))].T
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = x / depth, y / depth
        inside = (depth > 0) & (u >= -0.5) & (v >= -0.5) & (u < width - 0.5) & (v < height - 0.5)
        far = np.hypot((u + 0.5) / (width / 2) - 1, (v + 0.5) / (height / 2) - 1)
        found.append(np.where(inside, far, np.inf))
    return np.stack(found, axis=1)


@rows("interpolation", ["nearest", "bilinear"])
def test_one_camera_colours_as_colorize_does(interpolation: str) -> None:
    points, image = scene(5)
    expected = fusionslam.colorize(points, image, PROJECTION, interpolation=interpolation)
    *found, cameras, gains = fusionslam.colorize_all_round(
        points, [image], [PROJECTION], interpolation=interpolation
    )
    assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
    assert not cameras.any() and np.array_equal(gains, np.ones((1, 3)))


def test_a_point_takes_the_camera_to_whose_centre_it_is_nearest() -> None:
    """Images of unlike sizes, seen by two cameras or three."""
    cameras = {"left": camera_at(0, (160, 120)), "side_left": camera_at(70)}
    cameras |= {"between": camera_at(40, (40, 30)), "rear": camera_at(180)}
    points = points_around(2000)
    images, projections = inputs(cameras)
    kept, colors, indices, chosen, _ = fusionslam.colorize_all_round(
        points, images, projections, balance=False
    )
    distances = centre_distances(points, cameras)
    seen = np.isfinite(distances).any(axis=1)
    assert 0.7 < seen.mean() < 0.95 and (np.isfinite(distances).sum(axis=1) == 3).any()
    assert np.array_equal(indices, np.flatnonzero(seen)) and np.array_equal(kept, points[seen])
    nearest = np.sort(distances[seen], axis=1)
    clear = nearest[:, 1] - nearest[:, 0] > 1e-5
    assert np.array_equal(chosen[clear], distances[seen].argmin(axis=1)[clear])
    for number, (image, projection) in enumerate(zip(images, projections, strict=True)):
        _, alone, whose = fusionslam.colorize(points, image, projection)
        own = dict(zip(whose.tolist(), alone.tolist(), strict=True))
        mine = chosen == number
        assert colors[mine].tolist() == [own[index] for index in indices[mine].tolist()]


def test_equally_near_cameras_leave_the_point_to_the_first() -> None:
    image = np.full((60, 80, 3), 50, np.uint8)
    twice = [camera_at(0).projection_from_points] * 2
    _, colors, _, cameras, _ = fusionslam.colorize_all_round(
        points_around(), [image, 2 * image], twice, balance=False
    )
    assert not cameras.any() and (colors == 50).all()


def test_four_cameras_close_the_circle_and_balance_recovers_their_gains() -> None:
    points = points_around()
    images, projections = inputs(ring(), GAINS)
    kept, colors, _, chosen, gains = fusionslam.colorize_all_round(points, images, projections)
    assert len(kept) == len(points) and set(chosen.tolist()) == {0, 1, 2, 3}
    expected = np.exp(np.log(GAINS).mean(axis=0)) / GAINS
    assert np.abs(gains / expected - 1).max() < 0.01
    assert np.abs(np.log(gains).mean(axis=0)).max() < 0.01
    truth = world_colors(kept) * np.exp(np.log(GAINS).mean(axis=0))
    raw = fusionslam.colorize_all_round(points, images, projections, balance=False)
    assert np.abs(colors - truth).mean() < 3 < np.abs(raw[1] - truth).mean() / 2
    assert np.array_equal(raw[4], np.ones((4, 3)))


def test_cameras_without_common_points_keep_their_colours() -> None:
    """Ahead and to the left overlap; the rear camera sees alone."""
    cameras = {name: ring()[name] for name in ("left", "side_left", "rear")}
    cameras["rear"] = camera_at(-135)
    images, projections = inputs(cameras, GAINS[:3])
    gains = fusionslam.colorize_all_round(points_around(), images, projections)[4]
    assert np.array_equal(gains[2], np.ones(3))
    assert np.abs(gains[0] / gains[1] / (GAINS[1] / GAINS[0]) - 1).max() < 0.01


def test_gains_stay_within_their_limits_and_few_or_dark_or_saturated_pixels_say_nothing() -> None:
    points = points_around()
    images, projections = inputs(ring())
    images[0] = (images[0] // 5).astype(np.uint8)
    gains = fusionslam.colorize_all_round(points, images, projections)[4]
    assert gains.max() == 2 and gains.min() >= 0.5
    images, projections = inputs(ring(), GAINS)
    for changed, seen in (
        ([np.full_like(image, 255) for image in images], points),
        ([np.full_like(image, 15) for image in images], points),
        (images, points_around(200)),
    ):
        gains = fusionslam.colorize_all_round(seen, changed, projections)[4]
        assert np.array_equal(gains, np.ones((4, 3)))


def test_wrong_cameras_are_refused() -> None:
    points, image = scene(1)
    for images, projections, error, options in (
        ([image], [PROJECTION] * 2, ShapeError, {}),
        ([], [], DataError, {}),
        ([image, image], [PROJECTION, np.zeros((3, 4))], DataError, {}),
        ([image], [PROJECTION], ConfigError, {"interpolation": "cubic"}),
    ):
        with pytest.raises(error):
            fusionslam.colorize_all_round(points, images, projections, **options)
    points[7, 1] = np.nan
    with pytest.raises(DataError):
        fusionslam.colorize_all_round(points, [image], [PROJECTION])


def frame(**changes: Any) -> Frame:
    cameras = ring()
    images: dict[str, Any] = {name: picture(camera) for name, camera in cameras.items()}
    parts: dict[str, Any] = {"points": points_around(), "images": images, "cameras": cameras}
    return Frame(index=7, **(parts | changes))


def test_fuse_colours_by_all_cameras_of_a_frame() -> None:
    given = frame()
    cameras = ring()
    ordered = {name: cameras[name] for name in ("left", *sorted({*RING} - {"left"}))}
    images, projections = inputs(ordered)
    points, colors, *_ = fusionslam.colorize_all_round(given.points, images, projections)
    made = fusionslam.fuse(given)
    assert np.array_equal(made.points, points) and np.array_equal(made.colors, colors)
    ahead = fusionslam.fuse(given, FusionConfig(cameras=("left",)))
    assert len(ahead) < len(made) / 3
    raw = fusionslam.fuse(frame(images={n: p // 2 for n, p in given.images.items()}))
    assert len(raw) == len(made)


def test_a_stereo_pair_still_colours_by_its_left_camera_alone() -> None:
    points, image = scene(18)
    shifted = PROJECTION - [[0, 0, 0, 40], [0] * 4, [0] * 4]
    pair = {"left": Camera(PROJECTION), "right": Camera(shifted)}
    given = Frame(points=points, images={"left": image, "right": image[::-1]}, cameras=pair)
    made, expected = fusionslam.fuse(given), fusionslam.colorize(points, image, PROJECTION)
    assert np.array_equal(made.points, expected[0]) and np.array_equal(made.colors, expected[1])
    config = FusionConfig(cameras=("left", "right"), balance=False)
    assert len(fusionslam.fuse(given, config)) > len(made)


def test_a_right_camera_that_looks_elsewhere_is_no_stereo_partner() -> None:
    cameras = {"left": camera_at(90), "right": camera_at(-90), "front": camera_at(0)}
    given = frame(cameras=cameras, images={n: picture(c) for n, c in cameras.items()})
    assert color_cameras(given, FusionConfig()) == ("left", "front", "right")
    assert main_camera(Frame(cameras={"front": camera_at(0), "rear": camera_at(180)})) == "front"


@rows("lacking", ["images", "cameras"])
def test_an_incomplete_camera_is_left_out_and_logged(
    lacking: str, caplog: pytest.LogCaptureFixture
) -> None:
    whole = frame()
    parts = {"images": dict(whole.images), "cameras": dict(whole.cameras)}
    del parts[lacking]["rear"]
    made = fusionslam.fuse(frame(**parts))
    (record,) = caplog.records
    assert record.levelno == logging.WARNING and "rear" in getattr(record, PER_FRAME)
    three = tuple(name for name in RING if name != "rear")
    expected = fusionslam.fuse(whole, FusionConfig(cameras=three))
    assert np.array_equal(made.points, expected.points)
    assert np.array_equal(made.colors, expected.colors)
    caplog.clear()  # as if it were of another size
    small = dict(whole.images) | {"rear": np.zeros((30, 40, 3), np.uint8)}
    assert len(fusionslam.fuse(frame(images=small))) < len(points_around())
    (record,) = caplog.records
    assert "image-size" in getattr(record, PER_FRAME)


def test_a_frame_without_images_keeps_the_colours_of_its_scan() -> None:
    points, colors = np.eye(3, dtype=np.float32), np.arange(9, dtype=np.uint8).reshape(3, 3)
    cloud = fusionslam.fuse(Frame(points=points, colors=colors), FusionConfig(source="lidar"))
    assert np.array_equal(cloud.points, points) and np.array_equal(cloud.colors, colors)


def test_only_a_frame_without_any_usable_camera_is_an_error() -> None:
    for given, config, *error in (
        (frame(images={}), FusionConfig(), "missing-sensor", "left"),
        (frame(cameras={}), FusionConfig(), "no-calibration", "left"),
        (frame(), FusionConfig(cameras=("roof",)), "missing-sensor", "roof"),
    ):
        with pytest.raises(DataError, check=has_code(*error)):
            fusionslam.fuse(given, config)
