# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fusion against NumPy and SciPy: colours, depth, ground, voxels, invalid points."""

import logging
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import fusionslam
from fusionslam import Camera, ConfigError, DataError, Frame, FusionConfig

PROJECTION = np.array([[300.0, 0, 160, 12], [0, 310, 120, 3], [0, 0, 1, 0.05]])
UP_AXES = ("x", "y", "z", "-x", "-y", "-z")
NEAR_EDGE = 1e-3
"""Pixels: nearer to the border of a pixel than this, either neighbour is right."""


def scene(seed: int, count: int = 5000) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points all around the camera, half of them behind it, and an image."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-30, -12, -40], [30, 12, 40], (count, 3)).astype(np.float32)
    return points, rng.integers(0, 256, (240, 320, 3), dtype=np.uint8)


def numpy_projection(
    points: NDArray[np.float32], projection: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """u, v in pixels and depth, in double precision."""
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y, depth = projection @ np.c_[points.astype(np.float64), np.ones(len(points))].T
        return x / depth, y / depth, depth


def check_against_numpy(
    points: NDArray[np.float32], image: NDArray[np.uint8], projection: NDArray[np.float64]
) -> int:
    """Compare colorize with NumPy for every point that is clear of pixel edges; their number."""
    height, width = image.shape[:2]
    u, v, depth = numpy_projection(points, projection)
    column, row = np.floor(u + 0.5), np.floor(v + 0.5)
    inside = (depth > 0) & (column >= 0) & (row >= 0) & (column < width) & (row < height)
    clear = (np.abs(u + 0.5 - np.rint(u + 0.5)) > NEAR_EDGE) & (
        np.abs(v + 0.5 - np.rint(v + 0.5)) > NEAR_EDGE
    )
    kept_points, colors, indices = fusionslam.colorize(points, image, projection)
    assert (kept_points.dtype, colors.dtype, indices.dtype) == (np.float32, np.uint8, np.int64)
    assert np.array_equal(kept_points, points[indices])
    assert (depth[indices] > 0).all(), "a point behind the camera has a colour"
    kept = np.zeros(len(points), bool)
    kept[indices] = True
    assert np.array_equal(kept[clear], inside[clear])
    sure = indices[clear[indices]]
    expected = image[row[sure].astype(int), column[sure].astype(int)]
    expected = expected if image.ndim == 3 else np.repeat(expected[:, None], 3, axis=1)
    assert np.array_equal(colors[clear[indices]], expected)
    return len(sure)


def calibration(path: Path) -> dict[str, NDArray[np.float64]]:
    """The matrices of a KITTI calibration file, as flat rows."""
    rows = (line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
    return {key: np.array(text.split(), float) for key, text in rows if "time" not in key}


def homogeneous(rotation: NDArray[np.float64], shift: object = (0, 0, 0)) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.reshape(3, 3), shift
    return matrix


def raw_projection(folder: Path) -> NDArray[np.float64]:
    cameras = calibration(folder / "calib_cam_to_cam.txt")
    scanner = calibration(folder / "calib_velo_to_cam.txt")
    rectified = homogeneous(cameras["R_rect_00"])
    return cameras["P_rect_02"].reshape(3, 4) @ rectified @ homogeneous(scanner["R"], scanner["T"])


def object_projection(folder: Path) -> NDArray[np.float64]:
    cameras = calibration(folder / "calib/000000.txt")
    scanner = np.vstack([cameras["Tr_velo_to_cam"].reshape(3, 4), [0, 0, 0, 1]])
    return cameras["P2"].reshape(3, 4) @ homogeneous(cameras["R0_rect"]) @ scanner


def read_scan(path: Path) -> NDArray[np.float32]:
    return np.fromfile(path, np.float32).reshape(-1, 4)[:, :3].copy()


# Colours


@pytest.mark.parametrize("number", [0, 4, 9])
def test_colours_of_a_kitti_raw_scan_are_those_of_a_numpy_projection(
    test_data: Path, number: int
) -> None:
    folder = test_data / "kitti/raw_2011_09_26"
    points = read_scan(folder / f"velodyne_points/data/{number:010d}.bin")
    image = np.asarray(Image.open(folder / f"image_02/data/{number:010d}.png"))
    assert check_against_numpy(points, image, raw_projection(folder)) > 15_000


def test_colours_of_a_kitti_object_scan_are_those_of_a_numpy_projection(test_data: Path) -> None:
    folder = test_data / "kitti/object/training"
    points = read_scan(folder / "velodyne/000000.bin")
    image = np.asarray(Image.open(folder / "image_2/000000.png"))
    assert check_against_numpy(points, image, object_projection(folder)) > 15_000


@pytest.mark.parametrize("seed", range(3))
def test_colours_of_a_synthetic_cloud_are_those_of_a_numpy_projection(seed: int) -> None:
    points, image = scene(seed)
    assert check_against_numpy(points, image, PROJECTION) > 500
    assert check_against_numpy(points, image[:, :, 0].copy(), PROJECTION) > 500


def test_a_general_projection_matrix_is_followed_too() -> None:
    points, image = scene(3)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    transform = homogeneous(turn, (1, -2, 0.5))
    assert check_against_numpy(points, image, PROJECTION @ transform) > 100


def test_a_scene_behind_the_camera_gets_no_colours() -> None:
    points, image = scene(4)
    behind = points[points[:, 2] < -1]
    assert len(behind) > 1000
    assert len(fusionslam.colorize(behind, image, PROJECTION)[2]) == 0
    assert not fusionslam.depth_image(behind, PROJECTION, width=320, height=240).any()


def test_a_pixel_reaches_half_a_pixel_around_its_centre() -> None:
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    eye = np.eye(3, 4)
    for u, v, inside in [(-0.49, 0, True), (-0.51, 0, False), (3.49, 2.49, True), (3.51, 0, False),
                         (0, -0.51, False), (0, 2.51, False), (1.49, 1.51, True)]:  # fmt: skip
        _, colors, _ = fusionslam.colorize(np.array([[u, v, 1]], np.float32), image, eye)
        assert len(colors) == inside, (u, v)
        if inside:
            assert colors[0, 0] == image[round(v), round(u)]


@pytest.mark.parametrize("grey", [False, True])
def test_bilinear_colours_are_those_of_scipy(grey: bool) -> None:
    from scipy.ndimage import map_coordinates

    points, image = scene(5)
    image = image[:, :, 0].copy() if grey else image
    kept, colors, indices = fusionslam.colorize(points, image, PROJECTION, interpolation="bilinear")
    assert np.array_equal(indices, fusionslam.colorize(points, image, PROJECTION)[2])
    u, v, _ = numpy_projection(kept, PROJECTION)
    for channel in range(3):
        plane = image if grey else image[:, :, channel]
        expected = map_coordinates(plane.astype(float), [v, u], order=1, mode="nearest")
        assert np.abs(colors[:, channel] - expected).max() <= 1


def test_at_pixel_centres_bilinear_and_nearest_agree() -> None:
    image = scene(6)[1]
    v, u = np.mgrid[:240, :320].reshape(2, -1)
    points = np.c_[u, v, np.ones(len(u))].astype(np.float32)
    eye = np.eye(3, 4)
    for interpolation in ("nearest", "bilinear"):
        colors = fusionslam.colorize(points, image, eye, interpolation=interpolation)[1]
        assert np.array_equal(colors, image.reshape(-1, 3))


def test_an_image_of_one_pixel_can_be_read_either_way() -> None:
    image = np.array([[[10, 20, 30]]], np.uint8)
    point = np.array([[0.2, -0.3, 1]], np.float32)
    for interpolation in ("nearest", "bilinear"):
        _, colors, _ = fusionslam.colorize(point, image, np.eye(3, 4), interpolation=interpolation)
        assert colors.tolist() == [[10, 20, 30]]


@pytest.mark.parametrize(
    ("projection", "message"),
    [
        (np.zeros((3, 4)), "singular"),
        (np.array([[1.0, 0, 0, 0], [2, 0, 0, 0], [0, 0, 1, 0]]), "singular"),
        (np.where(PROJECTION == 310, np.nan, PROJECTION), "not finite"),
    ],
)
def test_a_missing_or_singular_calibration_is_refused(
    projection: NDArray[np.float64], message: str
) -> None:
    points, image = scene(7)
    with pytest.raises(DataError, match=message):
        fusionslam.colorize(points, image, projection)
    with pytest.raises(DataError, match=message):
        fusionslam.depth_image(points, projection, width=320, height=240)
    with pytest.raises(DataError, match=message):
        Camera(projection)


def test_an_empty_image_and_an_unknown_interpolation_are_refused() -> None:
    points, image = scene(8)
    with pytest.raises(DataError, match="image is empty"):
        fusionslam.colorize(points, image[:0], PROJECTION)
    for width in (0, -1, 1 << 20):
        with pytest.raises(DataError, match=f"image of {width}x240"):
            fusionslam.depth_image(points, PROJECTION, width=width, height=240)
    with pytest.raises(ConfigError, match=r"interpolation.*nearest, bilinear"):
        fusionslam.colorize(points, image, PROJECTION, interpolation="cubic")


# Depth


def numpy_depth(
    points: NDArray[np.float32], projection: NDArray[np.float64], width: int, height: int
) -> NDArray[np.float64]:
    u, v, depth = numpy_projection(points, projection)
    column, row = np.floor(u + 0.5), np.floor(v + 0.5)
    inside = (depth > 0) & (column >= 0) & (row >= 0) & (column < width) & (row < height)
    image = np.full((height, width), np.inf)
    np.minimum.at(image, (row[inside].astype(int), column[inside].astype(int)), depth[inside])
    return np.where(np.isfinite(image), image, 0)


def test_the_depth_image_holds_the_nearest_point_of_each_pixel(test_data: Path) -> None:
    folder = test_data / "kitti/object/training"
    points, projection = read_scan(folder / "velodyne/000000.bin"), object_projection(folder)
    depth = fusionslam.depth_image(points, projection, width=1224, height=370)
    expected = numpy_depth(points, projection, 1224, 370)
    assert depth.shape == (370, 1224) and depth.dtype == np.float32
    differing = np.abs(depth - expected) > 1e-4  # a point on an edge may go to either pixel
    assert differing.sum() <= 10 and (depth > 0).sum() > 15_000


def test_the_depth_image_of_a_synthetic_cloud_is_that_of_numpy() -> None:
    points, _ = scene(9, 30_000)
    small = np.diag([0.25, 0.25, 1]) @ PROJECTION
    depth = fusionslam.depth_image(points, small, width=80, height=60)
    assert (depth > 0).sum() > 1500
    assert np.abs(depth - numpy_depth(points, small, 80, 60)).max() < 1e-4


# Ground


def towards(up: str, points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Points given with z up, turned so that ``up`` is up."""
    axis, sign = "xyz".index(up[-1]), -1 if up.startswith("-") else 1
    turned = np.roll(points, axis - 2, axis=1)
    turned[:, axis] *= sign
    return turned.astype(np.float32)


def ground_and_things(seed: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A rough, slightly sloping floor at z = -1.7 and things on it; which points are floor."""
    rng = np.random.default_rng(seed)
    floor = rng.uniform([-30, -30, -0.05], [30, 30, 0.05], (3000, 3))
    floor[:, 2] += -1.7 + 0.02 * floor[:, 0]
    things = rng.uniform([-30, -30, -0.5], [30, 30, 4], (2000, 3))
    things[:, 2] += 0.02 * things[:, 0]
    return np.concatenate([floor, things]), np.arange(5000) < 3000


@pytest.mark.parametrize("up", UP_AXES)
def test_points_above_a_height_are_those_of_a_numpy_comparison(up: str) -> None:
    points = ground_and_things(10)[0]
    kept = fusionslam.above_height(towards(up, points), -1.0, up=up)
    assert np.array_equal(kept, np.flatnonzero(points[:, 2].astype(np.float32) > -1.0))
    assert kept.dtype == np.int64


@pytest.mark.parametrize("up", UP_AXES)
def test_the_ground_plane_is_found_for_every_up_axis(up: str) -> None:
    points, is_floor = ground_and_things(11)
    turned = towards(up, points)
    kept, plane = fusionslam.remove_ground_plane(turned, up=up)
    assert np.array_equal(kept, np.flatnonzero(~is_floor))
    expected = towards(up, np.array([[-0.02, 0, 1]]) / np.hypot(0.02, 1))[0]
    assert plane[:3] == pytest.approx(expected, abs=0.01)
    assert plane[3] == pytest.approx(1.7, abs=0.1)
    distances = np.abs(turned @ plane[:3] + plane[3])
    assert np.array_equal(kept, np.flatnonzero(distances > 0.2))


@pytest.mark.parametrize(
    "scan", ["00/velodyne/000000.bin", "00/velodyne/000198.bin", "08/velodyne/000720.bin"]
)
def test_the_ground_of_a_kitti_scan_is_level_and_under_the_car(test_data: Path, scan: str) -> None:
    points = read_scan(test_data / "kitti/sequences" / scan)
    kept, plane = fusionslam.remove_ground_plane(points)
    height = -plane[3] / plane[2]
    tilt = np.degrees(np.arccos(plane[2] / np.linalg.norm(plane[:3])))
    assert height == pytest.approx(-1.73, abs=0.1) and tilt < 3
    assert 0.3 < len(kept) / len(points) < 0.75
    again = fusionslam.remove_ground_plane(points)
    assert np.array_equal(kept, again[0]) and np.array_equal(plane, again[1])


def test_a_wall_is_no_ground() -> None:
    rng = np.random.default_rng(12)
    wall = rng.uniform([-20, -0.01, -2], [20, 0.01, 6], (2000, 3)).astype(np.float32)
    config = fusionslam.GroundPlaneConfig(distance=0.001, max_tilt=5)
    kept, plane = fusionslam.remove_ground_plane(wall, config=config)
    assert len(kept) > 1900
    assert not plane.any() or plane[2] > np.cos(np.radians(5)) - 1e-6


def test_ground_removal_refuses_what_it_cannot_do() -> None:
    points = ground_and_things(13)[0].astype(np.float32)
    with pytest.raises(ConfigError, match=r"up is 'w', expected one of x, y, z, -x, -y, -z"):
        fusionslam.above_height(points, 0.0, up="w")
    with pytest.raises(ConfigError, match="height"):
        fusionslam.above_height(points, float("nan"))
    with pytest.raises(DataError, match="2 points"):
        fusionslam.remove_ground_plane(points[:2])


def test_points_without_any_plane_are_all_kept_and_nothing_is_printed(
    capfd: pytest.CaptureFixture[str],
) -> None:
    same = np.ones((10, 3), np.float32)
    kept, plane = fusionslam.remove_ground_plane(same)
    assert len(kept) == 10 and not plane.any()
    assert capfd.readouterr() == ("", "")


# Voxels and invalid points


@pytest.mark.parametrize("size", [0.3, 1.0, 7.5])
def test_voxels_are_those_of_numpy(size: float) -> None:
    points, _ = scene(14)
    colors = np.random.default_rng(14).integers(0, 256, points.shape, dtype=np.uint8)
    cubes = np.floor(points.astype(np.float64) / size).astype(int)
    _, first, group, counts = np.unique(
        cubes, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    order = np.argsort(first)  # cubes in the order in which they are first met
    sums = np.zeros((len(first), 6))
    np.add.at(sums, group.ravel(), np.c_[points.astype(np.float64), colors])
    means = (sums / counts[:, None])[order]
    given_points, given_colors, indices = fusionslam.voxel_downsample(points, colors, size=size)
    assert np.array_equal(indices, first[order])
    assert np.abs(given_points - means[:, :3]).max() < 1e-5
    assert np.abs(given_colors - means[:, 3:]).max() <= 0.5 + 1e-9
    plain, none, same_indices = fusionslam.voxel_downsample(points, size=size)
    assert np.array_equal(plain, given_points) and np.array_equal(indices, same_indices)
    assert none.shape == (0, 3)


@pytest.mark.parametrize("size", [0.0, -1.0, float("nan")])
def test_a_voxel_size_must_be_positive(size: float) -> None:
    with pytest.raises(ConfigError, match="voxel size"):
        fusionslam.voxel_downsample(scene(15)[0], size=size)


def test_voxels_far_too_small_are_refused() -> None:
    with pytest.raises(DataError, match="voxels"):
        fusionslam.voxel_downsample(scene(16)[0], size=1e-9)


def test_invalid_points_are_dropped_and_the_rest_keep_their_order() -> None:
    points, _ = scene(17)
    points[[3, 700], 0], points[[3, 41], 2] = np.nan, -np.inf
    kept = fusionslam.drop_invalid(points)
    assert np.array_equal(kept, np.delete(np.arange(len(points)), [3, 41, 700]))


# Frames to clouds


def frame(seed: int = 18, **changes: object) -> Frame:
    points, image = scene(seed)
    parts = {
        "points": points,
        "images": {"left": image},
        "cameras": {"left": Camera(PROJECTION, size=(320, 240))},
    }
    return Frame(index=7, **(parts | changes))  # type: ignore[arg-type]


def test_fuse_colours_the_scan_of_a_frame() -> None:
    given, made = frame(), fusionslam.fuse(frame())
    points, colors, _ = fusionslam.colorize(given.points, given.images["left"], PROJECTION)
    assert np.array_equal(made.points, points) and np.array_equal(made.colors, colors)


def test_fuse_uses_the_place_of_the_scanner() -> None:
    shift = homogeneous(np.eye(3), (0.3, -0.1, 0.2))
    made = fusionslam.fuse(frame(cameras={"left": Camera(PROJECTION, shift)}))
    given = frame()
    expected = fusionslam.colorize(given.points, given.images["left"], PROJECTION @ shift)
    assert np.array_equal(made.points, expected[0]) and np.array_equal(made.colors, expected[1])


def test_fuse_drops_and_counts_invalid_points(caplog: pytest.LogCaptureFixture) -> None:
    points, _ = scene(19)
    clean = fusionslam.fuse(frame(points=points))
    spoilt = np.insert(points, [5, 5, 90], np.nan, axis=0)
    with caplog.at_level(logging.WARNING, logger="fusionslam"):
        made = fusionslam.fuse(frame(points=spoilt))
    assert np.array_equal(made.points, clean.points)
    assert "frame 7: dropped 3 points" in caplog.text


def test_fuse_removes_ground_and_thins_out() -> None:
    points, _ = ground_and_things(20)
    colors = np.random.default_rng(20).integers(0, 256, points.shape, dtype=np.uint8)
    given = Frame(points=points.astype(np.float32), colors=colors)
    plain = fusionslam.fuse(given, FusionConfig(source="cloud"))
    assert np.array_equal(plain.points, given.points) and np.array_equal(plain.colors, colors)
    config = FusionConfig(source="cloud", ground="height", ground_height=-1.0, voxel=2.0)
    kept = fusionslam.above_height(given.points, -1.0)
    expected = fusionslam.voxel_downsample(given.points[kept], colors[kept], size=2.0)
    made = fusionslam.fuse(given, config)
    assert np.array_equal(made.points, expected[0]) and np.array_equal(made.colors, expected[1])
    made = fusionslam.fuse(given, FusionConfig(source="cloud", ground="plane"))
    kept, _ = fusionslam.remove_ground_plane(given.points)
    assert np.array_equal(made.points, given.points[kept])


def test_fuse_names_what_a_frame_lacks() -> None:
    _, image = scene(21)
    cases: list[tuple[Frame, FusionConfig, str]] = [
        (frame(points=None), FusionConfig(), "frame 7 has no scan"),
        (frame(images={}), FusionConfig(), "frame 7 has no left image"),
        (frame(cameras={}), FusionConfig(), "frame 7 has no calibration of the left camera"),
        (frame(), FusionConfig(source="stereo"), "frame 7 has no right image"),
        (
            frame(images={"left": image[:100]}),
            FusionConfig(),
            r"frame 7: the left image is 320x100, its calibration is for 320x240",
        ),
    ]
    for given, config, message in cases:
        with pytest.raises(DataError, match=message):
            fusionslam.fuse(given, config)


def test_a_camera_far_from_the_origin_is_not_singular() -> None:
    """A frame in UTM coordinates has an offset of millions of metres and a sound calibration."""
    points, image = scene(21)
    shift = np.array([4e2, 5e2, 1e1])
    moved = PROJECTION.copy()
    moved[:, 3] -= PROJECTION[:, :3] @ shift
    _, _, kept = fusionslam.colorize(points, image, PROJECTION)
    _, _, again = fusionslam.colorize((points + shift).astype(np.float32), image, moved)
    assert len(kept) and len(set(kept.tolist()) ^ set(again.tolist())) < 0.01 * len(kept) + 2
    far = PROJECTION.copy()
    far[:, 3] = [5e9, 5e9, 5e6]
    fusionslam.colorize(points, image, far)  # nothing may be in view, but nothing is wrong either
