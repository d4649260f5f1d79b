# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs as they arrive: with scans and without, as from a bag, and what comes to nothing."""

import dataclasses
import random
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from bags import (
    INFOS,
    OPTICAL,
    SECOND,
    START,
    TOPICS,
    WALL_M,
    rectified_from_points,
    stereo_drive,
    write_bag,
)
from fusionslam import Frame, FrameBuilder, FusionConfig, OnlineConfig, fuse, open_dataset
from fusionslam.errors import ConfigError
from fusionslam.sensors.frame_builder import BAD_CALIBRATION, NO_CAMERA_INFO
from fusionslam.sensors.messages import CameraInfo, Event, FrameTransforms, Odometry, Picture, Scan
from fusionslam.sensors.synchronizer import NO_IMAGE, SyncConfig
from rows import rows

STEREO = FusionConfig(source="stereo")
PAIR = ("left", "right")


def run(builder: FrameBuilder, events: Iterable[Event]) -> list[Frame]:
    frames = []
    for event in events:
        side = "right" if "/right/" in event.topic else "left"
        frames += builder.process(event.message, side)
        lead = builder.sync.scans
        lost = sum(n for (sensor, _), n in builder.dropped.items() if sensor == lead)
        assert builder.sync.added[lead] == len(frames) + lost + builder.waiting[lead]
    return frames + builder.flush()


def test_a_robot_sees_the_same_pairs_as_those_who_read_its_bag(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="bags are an extra")
    builder = FrameBuilder(cameras=PAIR)
    frames = run(builder, stereo_drive())
    dataset = open_dataset(write_bag(tmp_path / "drive.mcap", stereo_drive()))
    assert len(frames) == len(dataset) == 3 and not builder.dropped
    assert not any(builder.waiting.values())
    for frame, read in zip(frames, dataset, strict=True):
        assert frame.stamp_ns == read.stamp_ns
        for side in PAIR:
            np.testing.assert_array_equal(frame.images[side], read.images[side])
            np.testing.assert_allclose(
                frame.cameras[side].projection_from_points,
                read.cameras[side].projection_from_points,
                atol=1e-9,
            )
        np.testing.assert_allclose(frame.odometry, read.odometry, atol=1e-9)
    cloud = fuse(frames[0], STEREO).points
    place = rectified_from_points()
    assert abs(np.median(cloud @ place[2, :3] + place[2, 3]) - WALL_M) < 0.01


def test_without_a_scanner_every_pair_is_a_frame() -> None:
    events = [event for event in stereo_drive() if not isinstance(event.message, Scan)]
    builder = FrameBuilder(cameras=PAIR, scans=False)
    frames = run(builder, events)
    assert len(frames) == 11 and not builder.dropped and builder.sync.added["left"] == 11
    assert all(frame.points is None and frame.odometry is not None for frame in frames)
    np.testing.assert_allclose(frames[3].robot_from_points, OPTICAL)
    forward = fuse(frames[3], FusionConfig(source="stereo", frame="robot")).points[:, 0]
    assert abs(np.median(forward) - 0.1 - WALL_M) < 0.05
    # Pairs need no transforms; odometry of a robot whose camera TF does not place is waited for.
    events = [e for e in stereo_drive() if isinstance(e.message, Picture | CameraInfo)]
    frames = run(FrameBuilder(cameras=PAIR, scans=False), events)
    assert len(frames) == 11 and frames[0].robot_from_points is None
    events = [e for e in stereo_drive() if not isinstance(e.message, FrameTransforms | Scan)]
    assert len(run(FrameBuilder(cameras=PAIR, scans=False), events)) == 11


def test_the_halves_of_a_pair_are_taken_at_one_time() -> None:
    missing = START + SECOND // 2
    events = [e for e in stereo_drive() if (e.topic, e.time_ns) != (TOPICS["right"], missing)]
    config = OnlineConfig(sync=SyncConfig(max_difference=0.05))
    builder = FrameBuilder(config, cameras=PAIR)
    assert [(f.stamp_ns - START) / SECOND for f in run(builder, events)] == [0, 1]
    assert builder.dropped == {("points", NO_IMAGE): 1, ("left", NO_IMAGE): 1}
    builder = FrameBuilder(cameras=PAIR, scans=False)
    assert len(run(builder, [e for e in events if not isinstance(e.message, Scan)])) == 10
    assert builder.dropped == {("left", NO_IMAGE): 1}


def test_the_order_of_arrival_changes_nothing() -> None:
    events = list(stereo_drive())
    head, rest = events[:1], events[1:]
    rng = random.Random(5)
    rest.sort(key=lambda event: event.time_ns + rng.randrange(SECOND // 5))
    config = OnlineConfig(sync=SyncConfig(lateness=0.25), wait=5.0)
    frames = run(FrameBuilder(config, cameras=PAIR), [*head, *rest])
    assert [(frame.stamp_ns - START) / SECOND for frame in frames] == [0, 0.5, 1]
    builder = FrameBuilder(cameras=PAIR)  # goes on from the start of a recording played again
    frames = run(builder, [*stereo_drive(3.0), *stereo_drive(3.0)])
    assert [(frame.stamp_ns - START) / SECOND for frame in frames] == [k / 2 for k in range(7)] * 2
    assert builder.sync.jumps == 1 and not builder.dropped


def test_memory_is_bounded_while_one_side_is_silent() -> None:
    config = OnlineConfig(sync=SyncConfig(buffer=5))
    builder = FrameBuilder(config, cameras=PAIR)
    for event in (e for e in stereo_drive(4.0) if "/right/" not in e.topic):
        assert not builder.process(event.message)
        assert all(count <= 6 for count in builder.waiting.values())
    builder.flush()
    assert builder.dropped["left", NO_IMAGE] + builder.dropped["left", "buffer full"] == 41


@rows(
    "topic, changes, reason, word",
    [
        (INFOS["right"], None, NO_CAMERA_INFO, "right"),
        (INFOS["right"], {"projection": np.eye(3, 4)}, BAD_CALIBRATION, "left and right"),
        (TOPICS["right"], {"image": np.zeros((9, 9), np.uint8)}, BAD_CALIBRATION, "9x9"),
    ],
)
def test_a_right_camera_that_cannot_be_used_is_counted_and_named(
    topic: str,
    changes: dict[str, object] | None,
    reason: str,
    word: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    events = [
        dataclasses.replace(e, message=dataclasses.replace(e.message, **changes or {}))
        if e.topic == topic
        else e
        for e in stereo_drive()
        if e.topic != topic or changes
    ]
    builder = FrameBuilder(cameras=PAIR)
    assert not run(builder, events)
    assert builder.dropped == {("points", reason): 3} and word in caplog.text


def test_what_the_builder_was_not_made_for_is_refused() -> None:
    with pytest.raises(ConfigError, match="cameras"):
        FrameBuilder(scans=False)
    builder = FrameBuilder(cameras=PAIR, scans=False)
    (scan, *_) = (e.message for e in stereo_drive() if isinstance(e.message, Scan))
    with pytest.raises(ConfigError, match=r"'points'.* left, right"):
        builder.process(scan)
    (odometry, *_) = (e.message for e in stereo_drive() if isinstance(e.message, Odometry))
    assert builder.process(odometry) == []
