# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Frames to clouds."""

import logging
from collections.abc import Callable

import numpy as np
import pytest

import fusionslam
from clouds import PROJECTION, ground_and_things, homogeneous, scene
from error_codes import has_code
from fusionslam import Camera, DataError, Frame, FusionConfig, ShapeError
from fusionslam.storage.arrays import Matrix
from rows import rows


def frame(seed: int = 18, **changes: object) -> Frame:
    points, image = scene(seed)
    parts = {
        "points": points,
        "images": {"left": image},
        "cameras": {"left": Camera(PROJECTION, size=(320, 240))},
    }
    return Frame(index=7, **(parts | changes))


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


def test_points_farther_than_any_lidar_sees_are_refused_and_dropouts_at_the_scanner_are_not(
    caplog: pytest.LogCaptureFixture,
) -> None:
    config, points = FusionConfig(source="cloud"), np.ones((100, 3), np.float32)
    points[:10, 1] = 2e4
    assert len(fusionslam.fuse(Frame(points=points), config)) == 100
    points[10, 1] = -2e4
    with pytest.raises(DataError, check=has_code("far-points", "11", "100")):
        fusionslam.fuse(Frame(points=points), config)
    points[:60] = 0
    assert len(fusionslam.fuse(Frame(points=points, index=1, number=8), config)) == 100
    (record,) = caplog.records
    assert isinstance(record.args, tuple) and record.args[:3] == (8, 60, 100)
    # No return, for many drivers.
    points[:60] = np.inf
    assert len(fusionslam.fuse(Frame(points=points), config)) == 40


def test_scans_in_millimetres_are_fused_with_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    points = 1000 * np.random.default_rng(0).uniform(1, 9, (100, 3)).astype(np.float32)
    fusionslam.fuse(Frame(points=points, number=8), FusionConfig(source="cloud"))
    (record,) = caplog.records
    assert isinstance(record.args, tuple) and record.args[:3] == (8, 100, 100)


@rows(
    "change, code",
    [
        (lambda matrix: matrix.T, "not-a-rotation"),
        (lambda matrix: 2 * matrix, "not-a-rotation"),
        (lambda matrix: np.diag([-1.0, 1, 1, 1]) @ matrix, "not-a-rotation"),
        (lambda matrix: matrix * [[1, 1, 1, 1000]] * [[1], [1], [1], [0.001]], "not-metres"),
    ],
)
def test_a_camera_is_where_a_rotation_and_translation_in_metres_put_it(
    change: Callable[[Matrix], Matrix], code: str
) -> None:
    mounted = np.array([[0, -1, 0, 0.1], [0, 0, -1, 0.2], [1, 0, 0, -0.3], [0, 0, 0, 1]])
    projection = np.array([[700.0, 0, 600, 0], [0, 700, 180, 0], [0, 0, 1, 0]])
    assert Camera(projection, mounted).size is None
    with pytest.raises(DataError, check=has_code(code)) as raised:
        Camera(projection, change(mounted))
    assert raised.value.fields[0] == "rectified_from_points"


@rows("name", ["pose", "odometry", "robot_from_points"])
def test_a_frame_takes_rigid_motions_and_whole_nanoseconds(name: str) -> None:
    moved = np.eye(4)
    moved[0, 3] = 2
    assert np.array_equal(getattr(Frame(**{name: moved.tolist()}), name), moved)
    with pytest.raises(DataError, check=has_code("not-a-rotation", name)):
        Frame(**{name: moved.T})
    with pytest.raises(ShapeError, check=lambda error: error.fields == (name,)):
        Frame(**{name: moved[:3]})
    with pytest.raises(DataError, check=has_code("stamp")):
        Frame(stamp_ns=1.5)


def test_fuse_drops_and_counts_invalid_points(caplog: pytest.LogCaptureFixture) -> None:
    points, _ = scene(19)
    clean = fusionslam.fuse(frame(points=points))
    spoilt = np.insert(points, [5, 5, 90], np.nan, axis=0)
    with caplog.at_level(logging.WARNING, logger="fusionslam"):
        made = fusionslam.fuse(frame(points=spoilt))
    assert np.array_equal(made.points, clean.points)
    assert [record.args for record in caplog.records] == [(7, "3 points")]


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


def test_intensities_stay_with_their_points() -> None:
    points, image = scene(18)
    # Each point's own x, so that it can be told in any selection of them.
    intensities = points[:, 0].copy()
    given = frame(points=points, images={"left": image}, intensities=lambda: intensities)
    for config in (
        FusionConfig(),
        FusionConfig(source="cloud", ground="height", ground_height=0.0),
    ):
        made = fusionslam.fuse(given, config)
        assert 0 < len(made) < len(points)
        assert made.intensities is not None and np.array_equal(made.intensities, made.points[:, 0])
    thin = fusionslam.fuse(given, FusionConfig(source="cloud", voxel=2.0))
    _, _, first = fusionslam.voxel_downsample(points, size=2.0)
    assert thin.intensities is not None and np.array_equal(thin.intensities, intensities[first])
    assert fusionslam.fuse(frame()).intensities is None
    with pytest.raises(ShapeError, check=has_code("shape", "intensities")):
        fusionslam.fuse(frame(intensities=intensities[:-1]))


def test_fuse_names_what_a_frame_lacks() -> None:
    _, image = scene(21)
    cases: list[tuple[Frame, FusionConfig, tuple[str, ...]]] = [
        (frame(points=None), FusionConfig(), ("missing-sensor", "points")),
        (frame(images={}), FusionConfig(), ("missing-sensor", "left")),
        (frame(cameras={}), FusionConfig(), ("no-calibration", "left")),
        (frame(), FusionConfig(source="stereo"), ("missing-sensor", "right")),
        (frame(images={"left": image[:100]}), FusionConfig(), ("image-size", "left")),
    ]
    for given, config, expected in cases:
        with pytest.raises(DataError, match="frame 7", check=has_code(*expected)):
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


@rows("count", [10, 99])
@rows("invalid", [False, True])
def test_colours_of_another_number_than_the_points_are_refused(count: int, invalid: bool) -> None:
    points = np.ones((50, 3), np.float32)
    points[3:4] = np.nan if invalid else 1
    frame = Frame(points=points, colors=np.zeros((count, 3), np.uint8))
    with pytest.raises(ShapeError, check=has_code("shape", "colors")):
        fusionslam.fuse(frame, FusionConfig(source="cloud"))
