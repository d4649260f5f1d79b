# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages to frames as on a robot: places and times, late and missing messages, wrong content."""

import logging
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import bags
import fusionslam
from fusionslam.datasets.bags import open_bag
from fusionslam.errors import DataError
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
)
from fusionslam.sensors.synchronizer import CLOCK_JUMP, SyncConfig
from messages import (
    BASE_FROM_LIDAR,
    CAMERA_MATRIX,
    OPTICAL,
    S,
    check,
    drive,
    info,
    ns,
    odom_from_base,
    picture,
    pixel,
    run,
    scan,
    true_pixel,
)


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


def test_motion_comes_from_tf_where_there_is_no_odometry() -> None:
    messages: list[Message] = []
    for message in drive():
        if isinstance(message, Odometry):
            moved = FrameTransform(
                stamp_ns=message.stamp_ns,
                parent="odom",
                child="base",
                parent_from_child=message.pose,
            )
            message = FrameTransforms(transforms=(moved,))
        messages.append(message)
    frames = run(FrameBuilder(OnlineConfig(robot_frame="base")), messages)
    wanted = run(FrameBuilder(), drive())
    assert len(frames) == 4
    for frame, same in zip(frames, wanted, strict=True):
        np.testing.assert_allclose(pixel(frame), pixel(same), atol=1e-9)
        np.testing.assert_allclose(frame.odometry, same.odometry, atol=1e-12)


def test_without_any_motion_the_robot_is_taken_to_stand() -> None:
    frames = run(FrameBuilder(), [m for m in drive() if not isinstance(m, Odometry)])
    assert len(frames) == 4 and all(frame.odometry is None for frame in frames)
    np.testing.assert_allclose(pixel(frames[0]), true_pixel(0.2), atol=1e-3)


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


def test_scans_before_the_first_odometry_are_placed_as_if_standing() -> None:
    messages = [m for m in drive() if not (isinstance(m, Odometry) and m.stamp_ns < ns(0.22))]
    builder = FrameBuilder()
    frames = run(builder, messages)
    assert [frame.odometry is None for frame in frames] == [True, False, False, False]
    assert builder.still == 1


@settings(max_examples=30, deadline=None)
@given(st.randoms(), st.floats(0, 0.3))
def test_frames_do_not_depend_on_the_order_of_arrival(rng: object, late: float) -> None:
    messages = drive()
    head, rest = messages[:2], messages[2:]
    rest.sort(key=lambda m: m.stamp_ns + ns(rng.uniform(0, late)))
    config = OnlineConfig(sync=SyncConfig(lateness=0.3), wait=5.0)
    frames = run(FrameBuilder(config), [*head, *rest])
    wanted = run(FrameBuilder(config), messages)
    assert [frame.stamp_ns for frame in frames] == [frame.stamp_ns for frame in wanted]
    for frame, same in zip(frames, wanted, strict=True):
        np.testing.assert_array_equal(pixel(frame), pixel(same))


def test_a_recording_played_again_goes_on_from_its_start() -> None:
    builder = FrameBuilder()
    frames = [frame for _ in range(2) for m in drive(4.0) for frame in builder.process(m)]
    assert len({frame.stamp_ns for frame in frames}) == len(frames) // 2 == 8
    assert builder.sync.jumps == 1 and {why for _, why in builder.dropped} <= {CLOCK_JUMP}
    for frame in frames:
        np.testing.assert_allclose(pixel(frame), true_pixel(frame.stamp_ns / S + 0.03), atol=0.01)


@pytest.mark.parametrize(
    ("wrong", "message"),
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


def test_transforms_that_form_a_loop_are_refused_and_the_rest_goes_on() -> None:
    wrong = FrameTransform(stamp_ns=0, parent="lidar", child="base", parent_from_child=np.eye(4))
    messages = drive()
    messages[1:1] = [FrameTransforms(transforms=(wrong,))] * 3
    builder = FrameBuilder()
    assert len(run(builder, messages)) == 4 and builder.refused == {"FrameTransforms": 3}


def test_memory_is_bounded_when_everything_stalls() -> None:
    config = OnlineConfig(sync=SyncConfig(buffer=5), wait=1000.0)
    builder = FrameBuilder(config)
    for n in range(100):
        builder.process(scan(0.1 * n))
        builder.process(picture(0.1 * n))
        assert builder.waiting["points"] <= 10
    check(builder, [])


def test_a_projection_of_zeros_means_the_camera_matrix_itself() -> None:
    camera = camera_from(info(projection=np.zeros((3, 4))), np.eye(4))
    np.testing.assert_array_equal(camera.projection, np.c_[CAMERA_MATRIX, np.zeros(3)])
    with pytest.raises(DataError, match=r"/image .*K"):
        camera_from(info(camera_matrix=np.zeros((3, 3))), np.eye(4), "/image")
    with pytest.raises(DataError, match=r"/image: .*projection"):
        camera_from(info(projection=np.full((3, 4), np.nan)), np.eye(4), "/image")


def test_the_cameras_rectification_turns_points() -> None:
    turn = Rotation.from_euler("y", 0.1).as_matrix()
    camera = camera_from(info(rectification=turn), OPTICAL)
    np.testing.assert_allclose(camera.rectified_from_points[:3, :3], turn @ OPTICAL[:3, :3])


def test_only_distorted_images_are_changed() -> None:
    image = np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8)
    taken = Picture(stamp_ns=0, frame_id="camera", image=image)
    assert rectify(taken, info()) is image
    bent = rectify(taken, info(distortion=np.array([-0.3, 0.1, 0, 0, 0])))
    assert bent.shape == image.shape and (bent != image).mean() > 0.3
    assert bent[24, 32] == image[24, 32]  # the principal point stays


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"distortion_model": "fov"}, "'fov'"),
        ({"distortion": np.ones(2)}, "plumb_bob"),
    ],
)
def test_a_lens_that_nobody_knows_is_an_error_of_the_data(
    changes: dict[str, object], message: str
) -> None:
    unknown = info(**{"distortion": np.full(5, 0.1), **changes})
    with pytest.raises(DataError, match=f"/image: .*{message}"):
        rectify(picture(0), unknown, "/image")


def test_a_wrong_transform_does_not_take_the_others_along() -> None:
    wrong = FrameTransform(stamp_ns=0, parent="base", child="base", parent_from_child=np.eye(4))
    messages = drive()
    good = messages[0].transforms
    messages[0] = FrameTransforms(transforms=(wrong, *good))
    builder = FrameBuilder()
    assert len(run(builder, messages)) == 4 and builder.refused == {"FrameTransforms": 1}


def test_a_robot_sees_the_same_frames_as_those_who_read_its_bag(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    path = bags.write_bag(tmp_path / "drive.bag", bags.drive(10))
    builder = FrameBuilder()
    with open_bag(path) as bag:
        frames = run(builder, (event.message for event in bag.events()))
    dataset = fusionslam.open_dataset(path)
    assert len(frames) == len(dataset) == 21 and not builder.dropped and not builder.still
    for frame, read in zip(frames, dataset, strict=True):
        assert frame.stamp_ns == read.stamp_ns
        np.testing.assert_array_equal(frame.points, read.points)
        np.testing.assert_array_equal(frame.images["left"], read.images["left"])
        for mine, its in (
            (
                frame.cameras["left"].projection_from_points,
                read.cameras["left"].projection_from_points,
            ),
            (frame.odometry, read.odometry),
            (frame.robot_from_points, read.robot_from_points),
        ):
            np.testing.assert_allclose(mine, its, atol=1e-9)
