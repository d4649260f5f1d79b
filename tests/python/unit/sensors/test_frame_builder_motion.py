# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What odometry and transforms mean as they arrive: truth, missing names, stamps ahead."""

from dataclasses import replace

import numpy as np
import pytest

from fusionslam.sensors.frame_builder import FrameBuilder, OnlineConfig
from fusionslam.sensors.messages import FrameTransform, FrameTransforms, Message, Odometry
from messages import (
    BASE_FROM_LIDAR,
    S,
    drive,
    ns,
    odom_from_base,
    pixel,
    place,
    run,
    true_pixel,
)


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


@pytest.mark.parametrize("config", [{"truth_frame": ""}, {"odometry_frame": "world"}])
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
    ahead = FrameTransform(
        stamp_ns=ns(9.0), parent="map", child="odom", parent_from_child=np.eye(4)
    )
    messages = sorted(drive()[2:], key=lambda m: m.stamp_ns + isinstance(m, Odometry) * ns(0.2))
    builder = FrameBuilder()
    frames = run(builder, [*drive()[:2], FrameTransforms(transforms=(ahead,)), *messages])
    assert len(frames) == 4 and not builder.still
