# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Colours and depth images against NumPy and SciPy."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import map_coordinates

import fusionslam
from clouds import PROJECTION, homogeneous, read_scan, scene
from fusionslam import Camera, ConfigError, DataError
from rows import rows

NEAR_EDGE = 1e-3
"""Pixels: nearer to the border of a pixel than this, either neighbour is right."""


def numpy_projection(
    points: NDArray[np.float32], projection: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """u, v in pixels and depth, in double precision."""
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y, depth = projection @ np.c_[points.astype(np.float64), np.ones(len(points))].T
        return x / depth, y / depth, depth


def pixels_of(
    points: NDArray[np.float32], projection: NDArray[np.float64], width: int, height: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """Row, column and depth of each point, and whether the image has it."""
    u, v, depth = numpy_projection(points, projection)
    column, row = np.floor(u + 0.5), np.floor(v + 0.5)
    inside = (depth > 0) & (column >= 0) & (row >= 0) & (column < width) & (row < height)
    with np.errstate(invalid="ignore"):
        return row.astype(int), column.astype(int), depth, inside


def check_against_numpy(
    points: NDArray[np.float32], image: NDArray[np.uint8], projection: NDArray[np.float64]
) -> int:
    """Compare colorize with NumPy for every point that is clear of pixel edges; their number."""
    height, width = image.shape[:2]
    u, v, _ = numpy_projection(points, projection)
    row, column, depth, inside = pixels_of(points, projection, width, height)
    to_edge = np.abs([u + 0.5 - np.rint(u + 0.5), v + 0.5 - np.rint(v + 0.5)])
    clear = (to_edge > NEAR_EDGE).all(axis=0)
    kept_points, colors, indices = fusionslam.colorize(points, image, projection)
    assert (kept_points.dtype, colors.dtype, indices.dtype) == (np.float32, np.uint8, np.int64)
    assert np.array_equal(kept_points, points[indices])
    assert (depth[indices] > 0).all(), "a point behind the camera has a colour"
    kept = np.zeros(len(points), bool)
    kept[indices] = True
    assert np.array_equal(kept[clear], inside[clear])
    sure = indices[clear[indices]]
    expected = image[row[sure], column[sure]]
    expected = expected if image.ndim == 3 else np.repeat(expected[:, None], 3, axis=1)
    assert np.array_equal(colors[clear[indices]], expected)
    return len(sure)


def numpy_depth(
    points: NDArray[np.float32], projection: NDArray[np.float64], width: int, height: int
) -> NDArray[np.float64]:
    row, column, depth, inside = pixels_of(points, projection, width, height)
    image = np.full((height, width), np.inf)
    np.minimum.at(image, (row[inside], column[inside]), depth[inside])
    return np.where(np.isfinite(image), image, 0)


def calibration(path: Path) -> dict[str, NDArray[np.float64]]:
    """The matrices of a KITTI calibration file, as flat rows."""
    rows = (line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
    return {key: np.array(text.split(), float) for key, text in rows if "time" not in key}


def raw_projection(folder: Path) -> NDArray[np.float64]:
    cameras = calibration(folder / "calib_cam_to_cam.txt")
    scanner = calibration(folder / "calib_velo_to_cam.txt")
    rectified = homogeneous(cameras["R_rect_00"])
    return cameras["P_rect_02"].reshape(3, 4) @ rectified @ homogeneous(scanner["R"], scanner["T"])


def object_projection(folder: Path) -> NDArray[np.float64]:
    cameras = calibration(folder / "calib/000000.txt")
    scanner = np.vstack([cameras["Tr_velo_to_cam"].reshape(3, 4), [0, 0, 0, 1]])
    return cameras["P2"].reshape(3, 4) @ homogeneous(cameras["R0_rect"]) @ scanner


def test_colours_and_depths_of_kitti_scans_are_those_of_a_numpy_projection(test_data: Path) -> None:
    raw, split = test_data / "kitti/raw_2011_09_26", test_data / "kitti/object/training"
    for number in (0, 4, 9):
        points = read_scan(raw / f"velodyne_points/data/{number:010d}.bin")
        image = np.asarray(Image.open(raw / f"image_02/data/{number:010d}.png"))
        assert check_against_numpy(points, image, raw_projection(raw)) > 15_000
    points, projection = read_scan(split / "velodyne/000000.bin"), object_projection(split)
    image = np.asarray(Image.open(split / "image_2/000000.png"))
    assert check_against_numpy(points, image, projection) > 15_000
    depth = fusionslam.depth_image(points, projection, width=1224, height=370)
    assert depth.shape == (370, 1224) and depth.dtype == np.float32
    # A point on an edge may go to either pixel.
    assert (np.abs(depth - numpy_depth(points, projection, 1224, 370)) > 1e-4).sum() <= 10
    assert (depth > 0).sum() > 15_000


@rows("seed", range(3))
def test_colours_of_a_synthetic_cloud_are_those_of_a_numpy_projection(seed: int) -> None:
    points, image = scene(seed)
    assert check_against_numpy(points, image, PROJECTION) > 500
    assert check_against_numpy(points, image[:, :, 0].copy(), PROJECTION) > 500
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    general = PROJECTION @ homogeneous(turn, (1, -2, 0.5))
    assert check_against_numpy(points, image, general) > 100


def test_a_scene_behind_the_camera_gets_no_colours() -> None:
    points, image = scene(4)
    behind = points[points[:, 2] < -1]
    assert len(behind) > 1000
    assert len(fusionslam.colorize(behind, image, PROJECTION)[2]) == 0
    assert not fusionslam.depth_image(behind, PROJECTION, width=320, height=240).any()


def test_a_pixel_reaches_half_a_pixel_around_its_centre() -> None:
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    eye = np.eye(3, 4)
    for u, v in ((-0.49, 0), (3.49, 2.49), (1.49, 1.51)):
        _, colors, _ = fusionslam.colorize(np.array([[u, v, 1]], np.float32), image, eye)
        assert colors[0, 0] == image[round(v), round(u)]
    outside = [(-0.51, 0, 1), (3.51, 0, 1), (0, -0.51, 1), (0, 2.51, 1)]
    assert len(fusionslam.colorize(np.array(outside, np.float32), image, eye)[1]) == 0


@rows("grey", [False, True])
def test_bilinear_colours_are_those_of_scipy(grey: bool) -> None:
    points, image = scene(5)
    image = image[:, :, 0].copy() if grey else image
    kept, colors, indices = fusionslam.colorize(points, image, PROJECTION, interpolation="bilinear")
    assert np.array_equal(indices, fusionslam.colorize(points, image, PROJECTION)[2])
    u, v, _ = numpy_projection(kept, PROJECTION)
    for channel in range(3):
        plane = image if grey else image[:, :, channel]
        expected = map_coordinates(plane.astype(float), [v, u], order=1, mode="nearest")
        assert np.abs(colors[:, channel] - expected).max() <= 1


@rows("interpolation", ["nearest", "bilinear"])
def test_at_pixel_centres_and_in_an_image_of_one_pixel_both_ways_agree(interpolation: str) -> None:
    image, eye = scene(6)[1], np.eye(3, 4)
    v, u = np.mgrid[:240, :320].reshape(2, -1)
    points = np.c_[u, v, np.ones(len(u))].astype(np.float32)
    colors = fusionslam.colorize(points, image, eye, interpolation=interpolation)[1]
    assert np.array_equal(colors, image.reshape(-1, 3))
    image, point = np.array([[[10, 20, 30]]], np.uint8), np.array([[0.2, -0.3, 1]], np.float32)
    _, colors, _ = fusionslam.colorize(point, image, eye, interpolation=interpolation)
    assert colors.tolist() == [[10, 20, 30]]


@rows(
    "projection, message",
    [
        (np.zeros((3, 4)), "singular"),
        (np.array([[1.0, 0, 0, 0], [2, 0, 0, 0], [0, 0, 1, 0]]), "singular"),
        (np.where(PROJECTION == 310, np.nan, PROJECTION), "not finite"),
    ],
)
def test_a_singular_calibration_is_refused(projection: NDArray[np.float64], message: str) -> None:
    points, image = scene(7)
    for use in (
        lambda: fusionslam.colorize(points, image, projection),
        lambda: fusionslam.depth_image(points, projection, width=320, height=240),
        lambda: Camera(projection),
    ):
        with pytest.raises(DataError, match=message):
            use()


def test_an_empty_image_and_an_unknown_interpolation_are_refused() -> None:
    points, image = scene(8)
    with pytest.raises(DataError, match="image"):
        fusionslam.colorize(points, image[:0], PROJECTION)
    for width in (0, -1, 1 << 20):
        with pytest.raises(DataError, match=f"{width}x240"):
            fusionslam.depth_image(points, PROJECTION, width=width, height=240)
    with pytest.raises(ConfigError, match=r"interpolation.*nearest, bilinear"):
        fusionslam.colorize(points, image, PROJECTION, interpolation="cubic")


def test_the_depth_image_of_a_synthetic_cloud_is_that_of_numpy() -> None:
    points, _ = scene(9, 30_000)
    small = np.diag([0.25, 0.25, 1]) @ PROJECTION
    depth = fusionslam.depth_image(points, small, width=80, height=60)
    assert (depth > 0).sum() > 1500
    assert np.abs(depth - numpy_depth(points, small, 80, 60)).max() < 1e-4
