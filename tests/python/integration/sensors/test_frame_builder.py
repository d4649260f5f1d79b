# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages to frames as on a robot: places and times, late and missing messages, wrong content."""

import logging
import random
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import bags
import fusionslam
from fusionslam.base.arrays import Matrix
from fusionslam.datasets.bags import open_bag
from fusionslam.errors import DataError
from fusionslam.geometry.se2 import places_of
from fusionslam.sensors.camera_info import camera_from, rectify
from fusionslam.sensors.frame_builder import (
    BAD_CALIBRATION,
    NO_CAMERA_INFO,
    NO_TRANSFORM,
    FrameBuilder,
    OnlineConfig,
)
from fusionslam.sensors.messages import (
    CameraInfo,
    FrameTransform,
    FrameTransforms,
    Message,
    Odometry,
    Picture,
    Scan,
)
from fusionslam.sensors.pose_buffer import PoseBuffer
from fusionslam.sensors.synchronizer import CLOCK_JUMP, SyncConfig
from rows import rows

S = 1_000_000_000
# The point that every scan sees, standing still in odom.
POINT = np.array([6.0, 1.0, 0.5])
CAMERA_MATRIX = np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]])
OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])


def ns(seconds: float) -> int:
    return round(seconds * S)


def place(x: float, y: float = 0, z: float = 0, yaw: float = 0) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def odom_from_base(t: float) -> NDArray[np.float64]:
    return place(0.4 * t, yaw=0.3 * t)


BASE_FROM_LIDAR = place(-0.1, z=0.2)
BASE_FROM_CAMERA = place(0.1, z=0.1) @ OPTICAL


def fixed() -> FrameTransforms:
    places = {"lidar": BASE_FROM_LIDAR, "camera": BASE_FROM_CAMERA}
    return FrameTransforms(
        transforms=tuple(
            FrameTransform(stamp_ns=0, parent="base", child=n, parent_from_child=p, static=True)
            for n, p in places.items()
        )
    )


def info(**changes: Any) -> CameraInfo:
    whole = CameraInfo(
        stamp_ns=0,
        frame_id="camera",
        size=(64, 48),
        camera_matrix=CAMERA_MATRIX,
        projection=np.hstack([CAMERA_MATRIX, np.zeros((3, 1))]),
    )
    return replace(whole, **changes)


def odometry(t: float) -> Odometry:
    pose = odom_from_base(t)
    return Odometry(stamp_ns=ns(t), frame_id="odom", child_frame_id="base", pose=pose)


def scan(t: float) -> Scan:
    seen = np.linalg.inv(odom_from_base(t) @ BASE_FROM_LIDAR) @ [*POINT, 1]
    points = np.array([seen[:3], [np.nan] * 3], np.float32)
    return Scan(stamp_ns=ns(t), frame_id="lidar", points=points)


def picture(t: float, size: tuple[int, int] = (64, 48)) -> Picture:
    return Picture(
        stamp_ns=ns(t), frame_id="camera", image=np.zeros((size[1], size[0], 3), np.uint8)
    )


def drive(until: float = 2.0, image_delay: float = 0.03) -> list[Message]:
    """Scans at 2 Hz, images at 10 Hz taken a little later, odometry at 20 Hz; in order."""
    timed: list[tuple[float, Message]] = [(t, odometry(t)) for t in np.arange(0, until, 0.05)]
    timed += [(t, scan(t)) for t in np.arange(0.2, until - 0.2, 0.5)]
    times = np.arange(image_delay, until, 0.1)
    timed += [(t, picture(t)) for t in times]
    return [fixed(), info(), *(message for _, message in sorted(timed, key=lambda each: each[0]))]


def run(builder: FrameBuilder, messages: Iterable[Message]) -> list[fusionslam.Frame]:
    frames = [frame for message in messages for frame in builder.process(message)]
    check(builder, frames)
    frames += builder.flush()
    check(builder, frames)
    return frames


def check(builder: FrameBuilder, frames: list[fusionslam.Frame]) -> None:
    lost = sum(n for (sensor, _), n in builder.dropped.items() if sensor == "points")
    assert builder.frames == len(frames) == len({frame.stamp_ns for frame in frames})
    assert builder.sync.added["points"] == len(frames) + lost + builder.waiting["points"]


def pixel(frame: fusionslam.Frame) -> NDArray[np.float64]:
    assert frame.points is not None and len(frame.points) == 1
    seen = frame.cameras["left"].projection_from_points @ [*frame.points[0], 1]
    return np.asarray(seen[:2] / seen[2])


def true_pixel(t: float) -> NDArray[np.float64]:
    seen = np.linalg.inv(odom_from_base(t) @ BASE_FROM_CAMERA) @ [*POINT, 1]
    return np.asarray((CAMERA_MATRIX @ seen[:3] / seen[2])[:2])


def test_points_fall_where_the_camera_saw_them_though_the_robot_turned_in_between() -> None:
    frames = run(FrameBuilder(), drive())
    assert [frame.stamp_ns for frame in frames] == [ns(t) for t in (0.2, 0.7, 1.2, 1.7)]
    assert [frame.index for frame in frames] == [0, 1, 2, 3]
    for frame in frames:
        t = frame.stamp_ns / S
        np.testing.assert_allclose(pixel(frame), true_pixel(t + 0.03), atol=0.01)
        assert np.abs(pixel(frame) - true_pixel(t)).max() > 0.4
        np.testing.assert_allclose(frame.odometry, odom_from_base(t), atol=1e-9)
        np.testing.assert_allclose(frame.robot_from_points, BASE_FROM_LIDAR, atol=1e-12)
        assert frame.images["left"].shape == (48, 64, 3)


def transform(parent: str, child: str, stamp_ns: int = 0, **pose: Matrix) -> FrameTransforms:
    pose = {"parent_from_child": np.eye(4)} | pose
    moved = FrameTransform(stamp_ns=stamp_ns, parent=parent, child=child, **pose)
    return FrameTransforms(transforms=(moved,))


def test_motion_comes_from_tf_where_there_is_no_odometry() -> None:
    messages = [
        transform("odom", "base", m.stamp_ns, parent_from_child=m.pose)
        if isinstance(m, Odometry)
        else m
        for m in drive()
    ]
    frames = run(FrameBuilder(OnlineConfig(robot_frame="base")), messages)
    wanted = run(FrameBuilder(), drive())
    assert len(frames) == 4
    for frame, same in zip(frames, wanted, strict=True):
        np.testing.assert_allclose(pixel(frame), pixel(same), atol=1e-9)
        np.testing.assert_allclose(frame.odometry, same.odometry, atol=1e-12)


def test_late_transforms_are_waited_for() -> None:
    messages = drive()
    statics = messages.pop(0)
    builder = FrameBuilder(OnlineConfig(wait=10.0))
    assert run(builder, [*messages, statics])[0].stamp_ns == ns(0.2)
    assert not builder.dropped and builder.frames == 4


def test_what_never_comes_is_waited_for_no_longer_than_wait() -> None:
    builder = FrameBuilder(OnlineConfig(wait=0.3))
    for message in drive()[1:]:
        assert not builder.process(message)
        assert builder.waiting["points"] <= 2
    assert builder.dropped["points", NO_TRANSFORM] >= 3
    builder = FrameBuilder()
    assert not run(builder, [m for m in drive() if not isinstance(m, CameraInfo)])
    assert builder.dropped == {("points", NO_CAMERA_INFO): 4}


def test_scans_before_the_first_odometry_or_without_any_are_placed_as_if_standing() -> None:
    builder = FrameBuilder()
    late = [m for m in drive() if not isinstance(m, Odometry) or m.stamp_ns >= ns(0.22)]
    frames = run(builder, late)
    assert [frame.odometry is None for frame in frames] == [True, False, False, False]
    assert builder.still == 1
    frames = run(FrameBuilder(), [m for m in drive() if not isinstance(m, Odometry)])
    assert len(frames) == 4 and all(frame.odometry is None for frame in frames)
    np.testing.assert_allclose(pixel(frames[0]), true_pixel(0.2), atol=1e-3)


PATIENT = OnlineConfig(sync=SyncConfig(lateness=0.3), wait=5.0)


@pytest.fixture(scope="module")
def in_order() -> list[fusionslam.Frame]:
    return run(FrameBuilder(PATIENT), drive())


@settings(max_examples=20, derandomize=True)
@given(st.randoms(), st.floats(0, 0.3))
def test_the_order_of_arrival_changes_nothing(
    in_order: list[fusionslam.Frame], rng: random.Random, late: float
) -> None:
    fixed, info, *rest = drive()
    rest.sort(key=lambda m: m.stamp_ns + ns(rng.uniform(0, late)))
    frames = run(FrameBuilder(PATIENT), [fixed, info, *rest])
    assert [frame.stamp_ns for frame in frames] == [frame.stamp_ns for frame in in_order]
    for frame, same in zip(frames, in_order, strict=True):
        np.testing.assert_array_equal(pixel(frame), pixel(same))


def test_a_recording_played_again_goes_on_from_its_start() -> None:
    builder = FrameBuilder()
    frames = [frame for _ in range(2) for m in drive(4.0) for frame in builder.process(m)]
    assert len({frame.stamp_ns for frame in frames}) == len(frames) // 2 == 8
    assert builder.sync.jumps == 1 and {why for _, why in builder.dropped} <= {CLOCK_JUMP}
    for frame in frames:
        np.testing.assert_allclose(pixel(frame), true_pixel(frame.stamp_ns / S + 0.03), atol=0.01)


@rows(
    "wrong, message",
    [
        (info(camera_matrix=np.zeros((3, 3))), "CameraInfo of left"),
        (info(size=(640, 480)), "640x480"),
    ],
)
def test_a_wrong_calibration_is_counted_and_said_once(
    wrong: CameraInfo, message: str, caplog: pytest.LogCaptureFixture
) -> None:
    builder = FrameBuilder()
    with caplog.at_level(logging.WARNING):
        assert not run(builder, [wrong if isinstance(m, CameraInfo) else m for m in drive()])
    assert builder.dropped == {("points", BAD_CALIBRATION): 4}
    assert [message in text for text in caplog.messages] == [True]


def test_wrong_transforms_are_refused_and_the_rest_goes_on() -> None:
    tree, *messages = drive()
    assert isinstance(tree, FrameTransforms)
    builder = FrameBuilder()
    assert len(run(builder, [tree, *[transform("lidar", "base")] * 3, *messages])) == 4
    assert builder.refused == {"FrameTransforms": 3}  # they would form a loop
    mixed = replace(tree, transforms=transform("base", "base").transforms + tree.transforms)
    builder = FrameBuilder()
    assert len(run(builder, [mixed, *messages])) == 4
    assert builder.refused == {"FrameTransforms": 1}


def test_memory_is_bounded_when_everything_stalls() -> None:
    config = OnlineConfig(sync=SyncConfig(buffer=5), wait=1000.0)
    builder = FrameBuilder(config)
    for n in range(100):
        builder.process(scan(0.1 * n))
        builder.process(picture(0.1 * n))
        assert builder.waiting["points"] <= 10
    check(builder, [])


def test_a_projection_of_zeros_means_the_camera_matrix_itself_and_points_are_rectified() -> None:
    camera = camera_from(info(projection=np.zeros((3, 4))), np.eye(4))
    np.testing.assert_array_equal(camera.projection, np.c_[CAMERA_MATRIX, np.zeros(3)])
    turn = Rotation.from_euler("y", 0.1).as_matrix()
    camera = camera_from(info(rectification=turn), OPTICAL)
    np.testing.assert_allclose(camera.rectified_from_points[:3, :3], turn @ OPTICAL[:3, :3])


BENT = {"distortion": np.full(5, 0.1)}


@rows(
    "use, changes, words",
    [
        (camera_from, {"camera_matrix": np.zeros((3, 3))}, ".*K"),
        (camera_from, {"projection": np.full((3, 4), np.nan)}, ": .*projection"),
        (rectify, BENT | {"distortion_model": "fov"}, ": .*'fov'"),
        (rectify, BENT | {"distortion": np.ones(2)}, ": .*plumb_bob"),
    ],
)
def test_a_calibration_that_means_nothing_is_an_error_of_the_data(
    use: Callable[..., object], changes: dict[str, object], words: str
) -> None:
    wrong = info(**changes)
    given = (wrong, np.eye(4)) if use is camera_from else (picture(0), wrong)
    with pytest.raises(DataError, match=f"/image ?{words}"):
        use(*given, "/image")


def test_points_keep_the_times_that_their_driver_gives() -> None:
    def timed(message: Message) -> Message:
        if not isinstance(message, Scan):
            return message
        points = np.vstack([message.points, message.points])  # one ray of two returns
        return replace(
            message, points=points, fields={"time": np.array([0, 0.1, 0.2, 0.3], np.float32)}
        )

    frames = run(FrameBuilder(OnlineConfig(deskew=False)), map(timed, drive()))
    for frame in frames:
        np.testing.assert_allclose(frame.point_seconds, [0, 0.2], atol=1e-6)
    assert all(frame.point_seconds is None for frame in run(FrameBuilder(), drive()))


def test_only_distorted_images_are_changed() -> None:
    image = np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8)
    taken = Picture(stamp_ns=0, frame_id="camera", image=image)
    assert rectify(taken, info()) is image
    bent = rectify(taken, info(distortion=np.array([-0.3, 0.1, 0, 0, 0])))
    assert bent.shape == image.shape and (bent != image).mean() > 0.3
    assert bent[24, 32] == image[24, 32]  # the principal point stays


def test_a_robot_sees_the_same_frames_as_those_who_read_its_bag(tmp_path: Path) -> None:
    path = bags.write_bag(tmp_path / "drive.bag", bags.drive(4))
    builder, poses = FrameBuilder(), PoseBuffer()
    with open_bag(path) as bag:
        frames = run(builder, (event.message for event in bag.events()))
        for event in bag.events(["/odom"]):
            poses.add(event.message)
    dataset = fusionslam.open_dataset(path)
    assert len(frames) == len(dataset) == 9 and not builder.dropped and not builder.still
    for frame, read in zip(frames, dataset, strict=True):
        assert frame.stamp_ns == read.stamp_ns
        np.testing.assert_array_equal(frame.points, read.points)
        np.testing.assert_array_equal(frame.images["left"], read.images["left"])
        mine, its = (each.cameras["left"].projection_from_points for each in (frame, read))
        np.testing.assert_allclose(mine, its, atol=1e-9)
        np.testing.assert_allclose(frame.odometry, read.odometry, atol=1e-9)
        np.testing.assert_allclose(frame.robot_from_points, read.robot_from_points, atol=1e-9)
    found = np.array([poses.at(stamp) for stamp in dataset.stamps_ns.tolist()])
    np.testing.assert_allclose(found, places_of(dataset.poses), atol=1e-9)


def truth(t: float, frame: str = "world") -> Odometry:
    world_from_odom = place(3.0, -2.0, yaw=1.0)
    pose = world_from_odom @ odom_from_base(t)
    return Odometry(stamp_ns=ns(t), frame_id=frame, child_frame_id="base", pose=pose)


def with_truth(frame: str = "world") -> list[Message]:
    """As ``drive``, each odometry with the truth before it."""
    pairs = [[truth(m.stamp_ns / S, frame), m] if isinstance(m, Odometry) else [m] for m in drive()]
    return [message for pair in pairs for message in pair]


def test_odometry_in_the_frame_of_the_truth_is_the_pose_of_frames() -> None:
    builder = FrameBuilder()
    frames = run(builder, with_truth())
    assert len(frames) == 4 and not builder.refused and not builder.still
    for frame in frames:
        t = frame.stamp_ns / S
        np.testing.assert_allclose(frame.pose, truth(t).pose, atol=1e-9)
        np.testing.assert_allclose(frame.odometry, odom_from_base(t), atol=1e-9)
        np.testing.assert_allclose(pixel(frame), true_pixel(t + 0.03), atol=0.01)
    frames = run(FrameBuilder(OnlineConfig(truth_frame="map")), with_truth("/map"))
    assert all(frame.pose is not None for frame in frames)
    assert all(frame.pose is None for frame in run(FrameBuilder(), drive()))


@rows("config", [{"truth_frame": ""}, {"odometry_frame": "world"}])
def test_odometry_may_be_measured_in_the_world(config: dict[str, str]) -> None:
    messages = [m for m in with_truth() if getattr(m, "frame_id", "") != "odom"]
    frames = run(FrameBuilder(OnlineConfig(**config)), messages)
    assert len(frames) == 4 and all(frame.pose is None for frame in frames)
    np.testing.assert_allclose(frames[0].odometry, truth(0.2).pose, atol=1e-9)


def test_odometry_without_a_child_frame_is_that_of_the_robots_usual_frame() -> None:
    messages = [replace(m, child_frame_id="") if isinstance(m, Odometry) else m for m in drive()]
    tree = [replace(t, parent="base_link") for t in messages[0].transforms]
    messages[0] = FrameTransforms(transforms=tuple(tree))
    frames = run(FrameBuilder(), messages)
    assert len(frames) == 4
    for frame in frames:
        np.testing.assert_allclose(frame.robot_from_points, BASE_FROM_LIDAR, atol=1e-12)
        np.testing.assert_allclose(pixel(frame), true_pixel(frame.stamp_ns / S + 0.03), atol=0.01)


def test_transforms_dated_ahead_do_not_end_the_waiting() -> None:
    # A localiser dates its transforms ahead; the odometry comes after its scan.
    ahead = transform("map", "odom", ns(9.0))
    messages = sorted(drive()[2:], key=lambda m: m.stamp_ns + isinstance(m, Odometry) * ns(0.2))
    builder = FrameBuilder()
    frames = run(builder, [*drive()[:2], ahead, *messages])
    assert len(frames) == 4 and not builder.still
