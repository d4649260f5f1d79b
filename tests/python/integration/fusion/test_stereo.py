# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo against LiDAR, and clouds from disparity against the projection they invert."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import fusionslam
from fusionslam import Camera, ConfigError, DataError, Frame, FusionConfig, StereoConfig
from rows import rows

FOCAL, BASELINE = 200.0, 0.5
LEFT = np.array([[FOCAL, 0, 80, 9.0], [0, FOCAL, 60, 0.5], [0, 0, 1, 0.002]])
RIGHT = LEFT - [[0, 0, 0, FOCAL * BASELINE], [0, 0, 0, 0], [0, 0, 0, 0]]
SGBM = {"preset": "sgbm"}


def calibration(path: Path) -> dict[str, NDArray[np.float64]]:
    rows = (line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
    return {key: np.array(text.split(), float).reshape(3, 4) for key, text in rows}


def grey(path: Path) -> NDArray[np.uint8]:
    return np.asarray(Image.open(path))


class Predicted:
    """The disparity that each LiDAR point of KITTI 00, frame 0, predicts at its pixel."""

    def __init__(self, test_data: Path) -> None:
        folder = test_data / "kitti/sequences/00"
        self.left = grey(folder / "image_0/000000.png")
        self.right = grey(folder / "image_1/000000.png")
        matrices = calibration(folder / "calib.txt")
        scan = np.fromfile(folder / "velodyne/000000.bin", np.float32).reshape(-1, 4)[:, :3]
        points = np.c_[scan.astype(np.float64), np.ones(len(scan))]
        rectified = np.vstack([matrices["Tr"], [0, 0, 0, 1]]) @ points.T
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y, depth = matrices["P0"] @ rectified
            x_right, _, depth_right = matrices["P1"] @ rectified
            u, v, u_right = x / depth, y / depth, x_right / depth_right
        height, width = self.left.shape
        row, column = np.floor(v + 0.5), np.floor(u + 0.5)
        seen = (depth > 0) & (row >= 0) & (row < height) & (column >= 0) & (column < width)
        self.row, self.column = row[seen].astype(int), column[seen].astype(int)
        self.disparity, self.depth = (u - u_right)[seen], depth[seen]

    def unhidden(self) -> NDArray[np.bool_]:
        """Points with nothing much nearer around their pixel.

        The scanner sits 0.3 m above the camera and looks over things the camera does not: such
        points say nothing about what is seen at their pixel. Its rings are about 5 rows apart.
        """
        from scipy.ndimage import minimum_filter

        depth = np.full(self.left.shape, np.inf)
        np.minimum.at(depth, (self.row, self.column), self.depth)
        nearest = minimum_filter(depth, size=(7, 5))
        return self.depth <= 1.05 * nearest[self.row, self.column]

    def agreement(self, disparity: NDArray[np.float32], among: NDArray[np.bool_]) -> float:
        """Share of the points with a stereo disparity that are within 1 px of it."""
        measured = disparity[self.row, self.column]
        compared = (measured > 0) & among
        assert compared.sum() > 5000
        return float(np.mean(np.abs(measured - self.disparity)[compared] <= 1))


def test_stereo_agrees_with_the_scan_of_the_same_kitti_frame(test_data: Path) -> None:
    predicted = Predicted(test_data)
    # SGBM is measured with the block of BM, too, which is too large for it.
    for config, fewest, fewest_of_all in (
        (StereoConfig(), 0.70, 0.68),
        (StereoConfig(**SGBM), 0.70, 0.68),
        (StereoConfig(method="sgbm"), 0.60, 0.0),
    ):
        disparity = fusionslam.stereo_disparity(predicted.left, predicted.right, config=config)
        everywhere = predicted.agreement(disparity, np.ones(len(predicted.row), bool))
        assert predicted.agreement(disparity, predicted.unhidden()) >= fewest
        assert everywhere >= fewest_of_all


def test_colour_pairs_of_kitti_02_give_plausible_clouds(test_data: Path) -> None:
    folder = test_data / "kitti/sequences/02"
    matrices = calibration(folder / "calib.txt")
    configs = (StereoConfig(), StereoConfig(**SGBM))
    for config, number in itertools.product(configs, (0, 3, 5)):
        left, right = (grey(folder / f"image_{camera}/{number:06d}.png") for camera in (2, 3))
        disparity = fusionslam.stereo_disparity(left, right, config=config)
        assert disparity.shape == left.shape[:2] and disparity.dtype == np.float32
        assert disparity.min() >= 0 and disparity.max() < 64
        assert (disparity > 0).mean() > 0.25
        points, colors, pixels = fusionslam.cloud_from_disparity(
            disparity, left, matrices["P2"], matrices["P3"], config=config
        )
        assert len(points) > 100_000
        assert np.array_equal(colors, left.reshape(-1, 3)[pixels])
        assert points[:, 2].min() >= 0.5 and points[:, 2].max() <= 80.01
        ahead = points[(np.abs(points[:, 0]) < 3) & (points[:, 2] < 15)]
        road = np.median(ahead[ahead[:, 1] > 1][:, 1])
        assert road == pytest.approx(1.65, abs=0.25)  # the cameras ride 1.65 m above the road
        assert np.percentile(points[:, 1], 99) < 2.5  # little lies below it


# A synthetic pair whose disparity is known


def shifted_pair(shift: int, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    from scipy.ndimage import gaussian_filter

    noise = np.random.default_rng(seed).normal(size=(120, 300))
    texture = gaussian_filter(noise, 1.0)
    texture = (255 * (texture - texture.min()) / np.ptp(texture)).astype(np.uint8)
    return texture[:, 70:230].copy(), texture[:, 70 + shift : 230 + shift].copy()


@rows("config", [{}, SGBM, {"method": "sgbm"}, {"median_blur": False}])
@rows("shift", [3, 17, 40])
def test_a_shifted_texture_has_that_disparity(shift: int, config: dict[str, object]) -> None:
    left, right = shifted_pair(shift)
    disparity = fusionslam.stereo_disparity(left, right, config=StereoConfig(**config))
    found = disparity[disparity > 0]
    assert len(found) > 0.2 * disparity.size
    assert np.mean(np.abs(found - shift) < 0.3) > 0.98


@rows("config", [{}, SGBM])
def test_two_runs_and_colour_images_give_the_same_disparity(config: dict[str, object]) -> None:
    left, right = shifted_pair(11)
    coloured = [np.repeat(image[:, :, None], 3, axis=2) for image in (left, right)]
    pairs = ((left, right), (left, right), coloured)
    found = [fusionslam.stereo_disparity(*pair, config=StereoConfig(**config)) for pair in pairs]
    assert len({disparity.tobytes() for disparity in found}) == 1


# Disparity to cloud


def disparity_of(depth: NDArray[np.float64]) -> NDArray[np.float32]:
    """Of the rectified pair above, for depths in the rectified frame at each pixel."""
    u = np.arange(depth.shape[1])
    third = depth + LEFT[2, 3]
    x = (u * third - LEFT[0, 2] * depth - LEFT[0, 3]) / FOCAL
    right = (RIGHT[0, 0] * x + RIGHT[0, 2] * depth + RIGHT[0, 3]) / third
    return (u - right).astype(np.float32)


def depths(seed: int, lowest: float = 2.0, highest: float = 40.0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).uniform(lowest, highest, (120, 160))


def test_a_cloud_from_disparity_projects_back_onto_its_pixels() -> None:
    depth = depths(1)
    disparity = disparity_of(depth)
    image = np.random.default_rng(1).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    points, colors, pixels = fusionslam.cloud_from_disparity(disparity, image, LEFT, RIGHT)
    assert np.array_equal(pixels, np.arange(depth.size))
    assert np.array_equal(colors, image.reshape(-1, 3))
    assert points[:, 2] == pytest.approx(depth.ravel(), rel=1e-4)
    place = np.c_[points.astype(np.float64), np.ones(len(points))].T
    left, right = (seen[:2] / seen[2] for seen in (LEFT @ place, RIGHT @ place))
    row, column = np.divmod(pixels, 160)
    assert np.abs([left[0] - column, left[1] - row, right[1] - row]).max() < 1e-3
    assert np.abs(left[0] - right[0] - disparity.ravel()).max() < 1e-3


def test_the_cloud_is_given_in_the_frame_that_is_asked_for() -> None:
    disparity, image = disparity_of(depths(2)), np.zeros((120, 160), np.uint8)
    transform = np.eye(4)
    transform[:3, :3] = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    transform[:3, 3] = [1, -2, 3]
    plain = fusionslam.cloud_from_disparity(disparity, image, LEFT, RIGHT)[0]
    moved = fusionslam.cloud_from_disparity(
        disparity, image, LEFT, RIGHT, cloud_from_rectified=transform
    )[0]
    assert np.abs(plain @ transform[:3, :3].T + transform[:3, 3] - moved).max() < 1e-4


def test_only_depths_within_the_range_become_points() -> None:
    depth, image = depths(3, 1.0, 100.0), np.zeros((120, 160, 3), np.uint8)
    config = StereoConfig(min_range=5.0, max_range=30.0)
    disparity = disparity_of(depth)
    _, _, pixels = fusionslam.cloud_from_disparity(disparity, image, LEFT, RIGHT, config=config)
    clear = (np.abs(depth - 5) > 0.01) & (np.abs(depth - 30) > 0.1)
    kept = np.zeros(depth.size, bool)
    kept[pixels] = True
    expected = (depth >= 5) & (depth <= 30)
    assert np.array_equal(kept[clear.ravel()], expected[clear])


def test_pixels_without_a_disparity_give_no_points_and_what_is_not_finite_is_refused() -> None:
    disparity, image = disparity_of(depths(4)), np.zeros((120, 160), np.uint8)
    disparity[::2], disparity[1, :1] = 0, -5
    _, _, pixels = fusionslam.cloud_from_disparity(disparity, image, LEFT, RIGHT)
    assert not (pixels // 160 % 2 == 0).any()
    assert 160 not in pixels
    for value in (np.nan, np.inf):
        disparity[1, 2] = value
        with pytest.raises(DataError, match=r"disparity .*\b1, .*\b2\b"):
            fusionslam.cloud_from_disparity(disparity, image, LEFT, RIGHT)


def test_fuse_makes_the_same_cloud_in_the_frame_of_the_scan() -> None:
    left, right = shifted_pair(12)
    place = np.array([[0, -1.0, 0, 0.1], [0, 0, -1, 0.2], [1, 0, 0, 0.3], [0, 0, 0, 1]])
    cameras = {"left": Camera(LEFT, place), "right": Camera(RIGHT, place)}
    frame = Frame(images={"left": left, "right": right}, cameras=cameras)
    made = fusionslam.fuse(frame, FusionConfig(source="stereo"))
    disparity = fusionslam.stereo_disparity(left, right)
    expected, colors, _ = fusionslam.cloud_from_disparity(
        disparity, left, LEFT, RIGHT, cloud_from_rectified=np.linalg.inv(place)
    )
    assert len(made) > 1000
    assert np.array_equal(made.points, expected) and np.array_equal(made.colors, colors)
    assert np.median(made.points[:, 0]) == pytest.approx(FOCAL * BASELINE / 12 - 0.3, rel=0.05)


# What is refused


@rows(
    "config, message",
    [
        ({"num_disparities": 40}, "num_disparities"),
        ({"block_size": 8}, "block_size"),
        ({"block_size": 3}, "block_size"),
        ({"block_size": 201}, "block_size"),
        ({"pre_filter_size": 6}, "pre_filter_size"),
        ({"method": "sgbm", "p1": 300, "p2": 200}, "p1 .*p2"),
        ({"min_range": 9.0, "max_range": 3.0}, "min_range .*max_range"),
    ],
)
def test_sizes_that_opencv_refuses_are_named(config: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=f"stereo.*{message}"):
        fusionslam.stereo_disparity(*shifted_pair(6), config=StereoConfig(**config))


def test_images_of_different_size_are_refused() -> None:
    left, right = shifted_pair(5)
    with pytest.raises(fusionslam.ShapeError, match=r"160x120.*150x120"):
        fusionslam.stereo_disparity(left, right[:, :150])


@rows("method", ["bm", "sgbm"])
def test_more_disparities_than_columns_are_survived(method: str) -> None:
    config = StereoConfig(method=method, num_disparities=512)
    try:
        disparity = fusionslam.stereo_disparity(*shifted_pair(7), config=config)
    except (ConfigError, DataError) as error:
        assert "num_disparities" in str(error)
    else:
        assert disparity.shape == (120, 160)


def test_an_image_narrower_than_the_disparities_gives_the_same_every_time() -> None:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 255, (48, 64), np.uint8)
    given = set()
    for value in range(40):
        used = np.full(image.size * 4, value, np.float32)  # memory that is free again at once
        given.add(fusionslam.stereo_disparity(image, image).tobytes())
        assert used[0] == value
    assert len(given) == 1


@rows(
    "right, message",
    [
        (LEFT, "no baseline"),
        (2 * LEFT - RIGHT, "left and right are exchanged"),
        (RIGHT * [[1.1], [1], [1]], "rectified stereo pair"),
        (RIGHT + np.array([[0, 0, 0, 0], [0, 0, 4, 0], [0, 0, 0, 0]]), "rectified stereo pair"),
        (np.zeros((3, 4)), "singular"),
        (np.full((3, 4), np.nan), "not finite"),
    ],
)
def test_projections_of_no_rectified_pair_are_refused(
    right: NDArray[np.float64], message: str
) -> None:
    image = np.zeros((120, 160), np.uint8)
    with pytest.raises(DataError, match=message):
        fusionslam.cloud_from_disparity(disparity_of(depths(8)), image, LEFT, right)
