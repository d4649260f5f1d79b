# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds in the frames of scan, camera, robot and odometry, and the ground in each of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import fusionslam
from error_codes import has_code
from fusionslam import Camera, Frame, FusionConfig
from fusionslam.config import merged
from fusionslam.datasets import open_dataset
from fusionslam.errors import DataError
from fusionslam.fusion import plane_of, segments_of
from fusionslam.pipelines.export_folder import write_clouds
from fusionslam.pipelines.recording import Recording
from kitti import write_sequence
from rows import rows

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


def frame(**changes: Any) -> Frame:
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
    given = frame()
    cloud = fusionslam.fuse(given, FusionConfig(source="cloud", frame=name))
    assert cloud.points.dtype == np.float32 and cloud.points.flags.c_contiguous
    assert np.abs(cloud.points - moved(floor_and_boxes()[0], EXPECTED[name])).max() < 1e-5
    assert np.array_equal(cloud.colors, given.colors)


def test_the_default_frame_changes_no_bit_of_the_scan() -> None:
    cloud = fusionslam.fuse(frame(), FusionConfig(source="cloud"))
    assert np.array_equal(cloud.points, floor_and_boxes()[0])


@rows("ground", ["height", "plane", "segments"])
@rows("name", FRAMES)
def test_the_ground_goes_in_every_frame(name: Any, ground: Any) -> None:
    points, is_floor = floor_and_boxes()
    # In the scan's frame, where camera clouds lose their ground too, the default is a car's.
    height = -0.05 if name in ("scan", "camera") else None
    config = FusionConfig(source="cloud", frame=name, ground=ground, ground_height=height)
    cloud = fusionslam.fuse(frame(), config)
    assert np.abs(cloud.points - moved(points[~is_floor], EXPECTED[name])).max() < 1e-5


def test_the_height_is_that_of_the_frame() -> None:
    """A robot that climbs: its floor is at z = 0 in its own frame, at 2 m in odometry."""
    raised = frame(odometry=pose((0, 0, 2.0)))
    for name, expected in (("robot", 1000), ("odometry", 4000)):
        config = FusionConfig(source="cloud", frame=name, ground="height")
        assert len(fusionslam.fuse(raised, config)) == expected


def test_the_default_height_in_the_frame_of_the_scan_is_a_cars() -> None:
    points = np.array([[3, 0, -1.5], [3, 1, -1.41], [3, 2, -1.39]], np.float32)
    cloud = fusionslam.fuse(Frame(points=points), FusionConfig(source="cloud", ground="height"))
    assert np.array_equal(cloud.points, points[2:])


@rows("ground", ["plane", "segments"])
def test_what_is_not_set_of_the_ground_is_a_cars_or_a_small_robots(ground: Any) -> None:
    """A floor and low things 0.13 m above, which a car drives over and a small robot does not."""
    points, is_floor = floor_and_boxes()
    points[~is_floor, 2] = -0.17 + 0.13
    given = frame(points=points)
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
    for name in ("scan", "camera"):
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
    given = frame(
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
def test_what_a_frame_lacks_for_the_frame_of_its_cloud_is_named(
    lacking: str, name: Any, code: str, field: str
) -> None:
    with pytest.raises(DataError, check=has_code(code, field)):
        fusionslam.fuse(frame(**{lacking: None}), FusionConfig(source="cloud", frame=name))


def test_where_no_ground_is_found_the_log_says_so(caplog: pytest.LogCaptureFixture) -> None:
    wall = np.stack(np.meshgrid([3.0], np.linspace(-1, 1, 20), np.linspace(0.3, 1, 20)), axis=-1)
    given = frame(points=wall.reshape(-1, 3).astype(np.float32), colors=None)
    config = FusionConfig(source="cloud", frame="robot", ground="segments")
    assert len(fusionslam.fuse(given, config)) == 400
    assert [record.args for record in caplog.records] == [(7,)]
    caplog.clear()
    fusionslam.fuse(frame(), config)
    assert not caplog.messages


def test_a_frame_without_points_left_has_no_ground_to_look_for() -> None:
    empty = frame(points=np.zeros((0, 3), np.float32), colors=np.zeros((0, 3), np.uint8))
    for ground in ("height", "plane", "segments"):
        config = FusionConfig(source="cloud", frame="robot", ground=ground)
        assert len(fusionslam.fuse(empty, config)) == 0


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
