# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Frames to clouds, in the frames of scan, camera, robot and odometry, and without the ground."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import fusionslam
from clouds import PROJECTION, ground_and_things, homogeneous, scene
from error_codes import has_code
from fusionslam import Camera, DataError, Frame, FusionConfig, ShapeError
from fusionslam.base.arrays import Matrix
from fusionslam.base.texts import PER_FRAME
from fusionslam.config import merged
from fusionslam.datasets import open_dataset
from fusionslam.fusion import plane_of, require_up, segments_of
from fusionslam.pipelines.export_folder import write_clouds
from fusionslam.pipelines.recording import Recording
from kitti import write_sequence
from rows import rows

Logs = pytest.LogCaptureFixture

CLOUD = FusionConfig(source="cloud")


def frame(seed: int = 18, **changes: object) -> Frame:
    points, image = scene(seed)
    parts = {
        "points": points,
        "images": {"left": image},
        "cameras": {"left": Camera(PROJECTION, size=(320, 240))},
    }
    return Frame(index=7, **(parts | changes))


@rows("place", [np.eye(4), homogeneous(np.eye(3), (0.3, -0.1, 0.2))])
def test_fuse_colours_the_scan_of_a_frame_from_the_place_of_the_scanner(place: Matrix) -> None:
    given = frame(cameras={"left": Camera(PROJECTION, place)})
    made = fusionslam.fuse(given)
    points, colors, _ = fusionslam.colorize(given.points, given.images["left"], PROJECTION @ place)
    assert np.array_equal(made.points, points) and np.array_equal(made.colors, colors)


OPTICAL = Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Turns x ahead and z up to x right, y down and z ahead."""


def corridor(seed: int = 5) -> NDArray[np.float64]:
    """What a depth camera 1.2 m above the floor sees of a corridor: ahead, within 45 degrees."""
    random = np.random.default_rng(seed)
    x, y, z = random.uniform((1, -1, -1.2), (15, 1, 1.2), (2000, 3)).T
    side = random.integers(4, size=len(x))
    y = np.where(side < 2, np.sign(y), y)
    points = np.column_stack([x, y, np.where(side < 2, z, np.sign(z) * 1.2)])
    return points[np.abs(points[:, 1:]).max(axis=1) < x]


@rows(
    "turn, told",
    [
        (OPTICAL, True),
        (Rotation.from_euler("x", 20, degrees=True) * OPTICAL, True),
        (Rotation.identity(), False),
        (Rotation.from_euler("y", -25, degrees=True), False),  # up a ramp
        (Rotation.from_euler("y", 90, degrees=True), False),  # down, as from a drone
    ],
)
def test_clouds_of_an_optical_frame_are_told_frame_by_frame(
    turn: Rotation, told: bool, caplog: Logs
) -> None:
    points = turn.apply(corridor()).astype(np.float32)
    for number in (3, 4):
        require_up(CLOUD, Frame(index=number, points=points))
    require_up(CLOUD, Frame(points=points, robot_from_points=np.eye(4)))  # who says so knows
    messages = [each.getMessage() for each in caplog.records]
    assert len(set(messages)) == len(messages) == 2 * told
    assert len({getattr(each, PER_FRAME) for each in caplog.records}) == told
    assert all("calib.yaml" in each for each in messages)


def test_points_too_far_for_a_lidar_are_refused_and_dropouts_are_not(caplog: Logs) -> None:
    config, points = CLOUD, np.ones((100, 3), np.float32)
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
    caplog.clear()  # millimetres
    points = 1000 * np.random.default_rng(0).uniform(1, 9, (100, 3)).astype(np.float32)
    fusionslam.fuse(Frame(points=points, number=8), config)
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


def test_fuse_drops_and_counts_invalid_points(caplog: Logs) -> None:
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
    plain = fusionslam.fuse(given, CLOUD)
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
    above = FusionConfig(source="cloud", ground="height", ground_height=0.0)
    for config in (FusionConfig(), above):
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
    small = {"left": scene(21)[1][:100]}
    cases: list[tuple[Frame, FusionConfig, tuple[str, ...]]] = [
        (frame(points=None), FusionConfig(), ("missing-sensor", "points")),
        (frame(images={}), FusionConfig(), ("missing-sensor", "left")),
        (frame(cameras={}), FusionConfig(), ("no-calibration", "left")),
        (frame(), FusionConfig(source="stereo"), ("missing-sensor", "right")),
        (frame(images=small), FusionConfig(), ("image-size", "left")),
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
        fusionslam.fuse(frame, CLOUD)


FRAMES = ("scan", "camera", "robot", "odometry")


def pose(shift: tuple[float, float, float], **degrees: float) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(
        "zyx", [degrees.get(name, 0) for name in ("yaw", "pitch", "roll")], degrees=True
    ).as_matrix()
    matrix[:3, 3] = shift
    return matrix


# A LiDAR 0.17 m above the floor, turned to the right, on a robot that looks left in its odometry.
ROBOT_FROM_POINTS = pose((-0.064, 0, 0.17), yaw=-90)
ODOMETRY = pose((5, -3, 0), yaw=60)
CAMERA_FROM_POINTS = np.array(
    [[0.0, -1, 0, 0.01], [0, 0, -1, -0.07], [1, 0, 0, -0.14], [0, 0, 0, 1]]
)


def floor_and_boxes(seed: int = 1) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Points in the scan's frame, the floor at z = -0.17, and which of them are floor."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-8, -8, -0.19], [8, 8, -0.15], (4000, 3))
    points[3000:, 2] = rng.uniform(0.2, 1.5, 1000)
    return points.astype(np.float32), np.arange(4000) < 3000


def on_robot(**changes: Any) -> Frame:
    projection = np.array([[300.0, 0, 320, 0], [0, 300, 240, 0], [0, 0, 1, 0]])
    parts: dict[str, Any] = {
        "points": floor_and_boxes()[0],
        "colors": np.random.default_rng(2).integers(0, 256, (4000, 3), dtype=np.uint8),
        "cameras": {"left": Camera(projection, CAMERA_FROM_POINTS)},
        "odometry": ODOMETRY,
        "robot_from_points": ROBOT_FROM_POINTS,
    }
    return Frame(index=7, **(parts | changes))


def moved(points: NDArray[np.float32], a_from_b: NDArray[np.float64]) -> NDArray[np.float64]:
    return (a_from_b @ np.c_[points, np.ones(len(points))].T).T[:, :3]


EXPECTED = {
    "scan": np.eye(4),
    "camera": CAMERA_FROM_POINTS,
    "robot": ROBOT_FROM_POINTS,
    "odometry": ODOMETRY @ ROBOT_FROM_POINTS,
}


@rows("name", FRAMES)
def test_a_cloud_is_in_the_frame_that_was_asked_for(name: Any) -> None:
    given = on_robot()
    cloud = fusionslam.fuse(given, FusionConfig(source="cloud", frame=name))
    assert cloud.points.dtype == np.float32 and cloud.points.flags.c_contiguous
    assert np.abs(cloud.points - moved(floor_and_boxes()[0], EXPECTED[name])).max() < 1e-5
    assert np.array_equal(cloud.colors, given.colors)
    # The default frame changes no bit of the scan.
    assert np.array_equal(fusionslam.fuse(given, CLOUD).points, given.points)


@rows("ground", ["height", "plane", "segments"])
@rows("name", FRAMES)
def test_the_ground_goes_in_every_frame(name: Any, ground: Any) -> None:
    points, is_floor = floor_and_boxes()
    # In the scan's frame, where camera clouds lose their ground too, the default is a car's.
    height = -0.05 if name in ("scan", "camera") else None
    config = FusionConfig(source="cloud", frame=name, ground=ground, ground_height=height)
    cloud = fusionslam.fuse(on_robot(), config)
    assert np.abs(cloud.points - moved(points[~is_floor], EXPECTED[name])).max() < 1e-5


def test_the_height_is_that_of_the_frame_and_by_default_a_cars_in_the_scans() -> None:
    """A robot that climbs: its floor is at z = 0 in its own frame, at 2 m in odometry."""
    raised = on_robot(odometry=pose((0, 0, 2.0)))
    for name, expected in (("robot", 1000), ("odometry", 4000)):
        config = FusionConfig(source="cloud", frame=name, ground="height")
        assert len(fusionslam.fuse(raised, config)) == expected
    points = np.array([[3, 0, -1.5], [3, 1, -1.41], [3, 2, -1.39]], np.float32)
    cloud = fusionslam.fuse(Frame(points=points), FusionConfig(source="cloud", ground="height"))
    assert np.array_equal(cloud.points, points[2:])


@rows("ground", ["plane", "segments"])
def test_what_is_not_set_of_the_ground_is_a_cars_or_a_small_robots(ground: Any) -> None:
    """A floor and low things 0.13 m above, which a car drives over and a small robot does not."""
    points, is_floor = floor_and_boxes()
    points[~is_floor, 2] = -0.17 + 0.13
    given = on_robot(points=points)
    for name, expected in (("scan", 0), ("camera", 0), ("robot", 1000), ("odometry", 1000)):
        config = FusionConfig(source="cloud", frame=name, ground=ground)
        assert len(fusionslam.fuse(given, config)) == expected
        # What is set counts in every frame, and the rest still follows the frame.
        for distance, left in ((0.2, 0), (0.06, 1000)):
            changed = merged(config, {ground: {"distance": distance}})
            assert len(fusionslam.fuse(given, changed)) == left


def test_values_of_the_ground_follow_the_frame_one_by_one() -> None:
    robots = FusionConfig(frame="robot")
    assert (plane_of(robots).distance, plane_of(robots).max_tilt) == (0.05, 5)
    assert (segments_of(robots).distance, segments_of(robots).seed_height) == (0.1, 0.2)
    for name in FRAMES[:2]:
        config = FusionConfig(frame=name)
        core = fusionslam.GroundPlaneConfig(), fusionslam.GroundSegmentsConfig()
        assert (repr(plane_of(config)), repr(segments_of(config))) == tuple(map(repr, core))
    changed = merged(robots, {"plane": {"max_tilt": 9.0}, "segments": {"seed_height": 0.3}})
    assert (plane_of(changed).distance, plane_of(changed).max_tilt) == (0.05, 9)
    assert (segments_of(changed).distance, segments_of(changed).seed_height) == (0.1, 0.3)


def test_segments_lie_along_the_robot_whatever_odometry_calls_forward() -> None:
    """A ramp ahead of the robot, which looks along odometry's y."""
    rng = np.random.default_rng(4)
    points = rng.uniform([-10, -3, 0], [20, 3, 0], (5000, 3))
    points[:, 2] = 0.1 * np.maximum(points[:, 0], 0)
    things = np.arange(5000) % 4 == 0
    points[things, 2] += rng.uniform(0.5, 1.5, things.sum())
    given = on_robot(
        points=points.astype(np.float32),
        colors=None,
        robot_from_points=np.eye(4),
        odometry=pose((4, 2, 0), yaw=90),
    )
    config = FusionConfig(source="cloud", frame="odometry", ground="segments")
    assert len(fusionslam.fuse(given, config)) == things.sum()


@rows(
    "lacking, name, code, field",
    [
        ("cameras", "camera", "no-calibration", "left"),
        ("robot_from_points", "robot", "no-transform", "robot"),
        ("robot_from_points", "odometry", "no-transform", "odometry"),
        ("odometry", "odometry", "no-odometry", "odometry"),
    ],
)
def test_what_lacks_for_the_frame_of_a_cloud_is_named(
    lacking: str, name: Any, code: str, field: str
) -> None:
    with pytest.raises(DataError, check=has_code(code, field)):
        fusionslam.fuse(on_robot(**{lacking: None}), FusionConfig(source="cloud", frame=name))


def test_where_no_ground_is_found_the_log_says_so(caplog: Logs) -> None:
    wall = np.stack(np.meshgrid([3.0], np.linspace(-1, 1, 20), np.linspace(0.3, 1, 20)), axis=-1)
    given = on_robot(points=wall.reshape(-1, 3).astype(np.float32), colors=None)
    config = FusionConfig(source="cloud", frame="robot", ground="segments")
    assert len(fusionslam.fuse(given, config)) == 400
    assert [record.args for record in caplog.records] == [(7,)]
    caplog.clear()
    fusionslam.fuse(on_robot(), config)
    empty = on_robot(points=np.zeros((0, 3), np.float32), colors=np.zeros((0, 3), np.uint8))
    for ground in ("height", "plane", "segments"):
        assert len(fusionslam.fuse(empty, merged(config, {"ground": ground}))) == 0
    assert not caplog.messages


def test_poses_of_written_clouds_are_those_of_the_frame_they_are_in(tmp_path: Path) -> None:
    """The same points of the world, whether the folder's clouds are the scan's or the camera's."""
    sequence = write_sequence(tmp_path / "data", [0, 2, 5], [200] * 3, metres=1.5, width=64)
    worlds = []
    names: tuple[Any, ...] = ("scan", "camera")
    for name in names:
        folder = tmp_path / name
        config = FusionConfig(frame=name)
        write_clouds(Recording.at(sequence), folder, config)
        dataset = open_dataset(folder)
        last = dataset[len(dataset) - 1]
        assert last.points is not None and last.pose is not None
        worlds.append(moved(last.points, last.pose))
    assert np.abs(worlds[0] - worlds[1]).max() < 1e-3
