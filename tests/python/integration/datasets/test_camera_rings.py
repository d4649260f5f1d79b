# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings with cameras all round: plain folders and bags, and frames as they arrive."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import yaml

from bags import SUFFIXES, changed, without, write_bag
from camera_rings import RING, calibration, ring_events, write_ring_folder
from error_codes import has_code
from fusionslam import Frame, FrameBuilder, FusionConfig, fuse, open_dataset
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.recording import Recording
from fusionslam.sensors.messages import Event
from rows import rows

Logs = pytest.LogCaptureFixture

FURTHER = tuple(name for name in RING if name != "left")
TOPICS = {"left": "/left/image", **{name: f"/{name}/image" for name in FURTHER}}
ALONE = FusionConfig(cameras=("left",))


def all_round(frame: Frame) -> bool:
    """Whether a frame's whole scan is coloured."""
    assert frame.points is not None
    return len(fuse(frame)) == len(frame.points)


def test_a_folder_has_the_cameras_that_its_calibration_names(tmp_path: Path, caplog: Logs) -> None:
    folder = write_ring_folder(tmp_path / "ring")
    dataset = Recording.at(folder).open("lidar")
    assert dataset.sensors == ("points", "left") and list(dataset.cameras) == list(RING)
    assert dataset.counts == {"points": 3} | dict.fromkeys(RING, 3)
    assert len(dataset.files()) == 15 and "80x60" in dataset.content("rear")
    assert all(all_round(frame) for frame in dataset)
    assert list(Recording.at(folder).open("cloud").cameras) == []
    # A frame may lack the image of a further camera, and all of them may.
    (folder / "rear/001.png").unlink()
    (folder / "side_left/002.png").write_bytes(b"no image")
    dataset = open_dataset(folder)
    assert len(dataset) == 3 and "rear" not in dataset[1].images
    assert [all_round(frame) for frame in dataset] == [True, False, False]
    for name in ("000", "002"):
        (folder / f"rear/{name}.png").unlink()
    caplog.clear()
    assert list(open_dataset(folder).cameras) == ["left", "side_left", "side_right"]
    assert any("rear" in message for message in caplog.messages)
    (folder / "left/001.png").unlink()
    with pytest.raises(DataError):
        open_dataset(folder)


def test_without_a_left_camera_the_first_of_the_calibration_is_the_main_one(tmp_path: Path) -> None:
    folder = write_ring_folder(tmp_path / "ring", names={"left": "front"})
    dataset = open_dataset(folder)
    assert dataset.sensors == ("points", "left")
    assert list(dataset[0].images) == ["left", *FURTHER] and all_round(dataset[0])
    same = open_dataset(write_ring_folder(tmp_path / "other"))
    assert np.array_equal(fuse(dataset[2]).colors, fuse(same[2]).colors)


@rows("suffix", SUFFIXES)
def test_a_bag_has_the_further_cameras_that_are_named(tmp_path: Path, suffix: str) -> None:
    path = write_bag(tmp_path / f"ring.{suffix}", ring_events())
    dataset = open_dataset(path, topics=TOPICS)
    assert {*dataset[0].images} == {*dataset[0].cameras} == {*dataset.cameras} == {*RING}
    assert dataset.counts["rear"] == 11 and len(dataset) == 6
    assert all(all_round(frame) for frame in dataset)
    assert all_round(dataset[2:4][1])
    unnamed = open_dataset(path, topics={"left": "/left/image"})
    assert not all_round(unnamed[0]) and set(unnamed[0].images) <= {"left", "right"}


def test_a_bag_does_without_a_camera_that_is_late_or_nowhere(tmp_path: Path, caplog: Logs) -> None:
    events = [e for e in ring_events() if e.topic != "/rear/image" or e.time_ns % 10**9 > 6 * 10**8]
    events = list(changed(events, "/side_left/info", frame_id="nowhere"))
    dataset = open_dataset(write_bag(tmp_path / "ring.bag", events), topics=TOPICS)
    assert ["rear" in frame.images for frame in dataset] == [False] * 3 + [True] * 3
    assert all("side_left" in f.images and "side_left" not in f.cameras for f in dataset)
    assert not any(all_round(frame) for frame in dataset)
    assert any("/rear/image" in message for message in caplog.messages)


def test_a_calibration_file_serves_the_further_cameras_of_a_bag(tmp_path: Path) -> None:
    unplaced = ("/tf_static", *(f"/{name}/info" for name in RING))
    events = [event for event in ring_events() if event.topic not in unplaced]
    file = tmp_path / "calib.yaml"
    file.write_text(yaml.safe_dump(calibration({name: name for name in RING})))
    path = write_bag(tmp_path / "ring.bag", events)
    assert all_round(open_dataset(path, topics=TOPICS, calibration=file)[0])


def test_wrong_names_of_topics_are_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "ring.bag", ring_events(0.2))
    for topics in (
        {"lefft": "/rear/image"},
        {"rear": "/points"},
        {"rear_camera_info": "/rear/info"},
        {"a b": "/rear/image"},
    ):
        with pytest.raises(ConfigError):
            open_dataset(path, topics=topics)
    with pytest.raises(DataError, check=has_code("topic-type", "/points", "rear_camera_info")):
        open_dataset(path, topics={"rear": "/rear/image", "rear_camera_info": "/points"})


def process(builder: FrameBuilder, event: Event) -> list[Frame]:
    camera = event.topic.split("/")[1]
    return builder.process(event.message, camera if camera in RING else "left")


def run(builder: FrameBuilder, events: Iterable[Event]) -> list[Frame]:
    frames = [frame for event in events for frame in process(builder, event)]
    return frames + builder.flush()


def test_frames_that_arrive_have_what_frames_of_their_bag_have(tmp_path: Path) -> None:
    builder = FrameBuilder(surround=FURTHER)
    frames = run(builder, ring_events())
    read = open_dataset(write_bag(tmp_path / "ring.bag", ring_events()), topics=TOPICS)
    assert len(frames) == len(read) == 6 and not builder.surround.missing
    for frame, other in zip(frames, read, strict=True):
        ours, theirs = fuse(frame), fuse(other)
        assert np.array_equal(ours.points, theirs.points)
        assert np.array_equal(ours.colors, theirs.colors)


def test_a_camera_that_fell_silent_costs_its_colours_and_no_frame() -> None:
    late = [e for e in ring_events(3) if e.topic != "/rear/image" or e.time_ns % 10**9 < 10**8]
    builder = FrameBuilder(surround=FURTHER)
    frames = [frame for event in late for frame in process(builder, event)]
    # Scans up to the last but one are out before the end: nothing waits for the silent camera.
    assert len(frames) >= 13
    frames += builder.flush()
    assert len(frames) == 16
    lacking = [number for number, frame in enumerate(frames) if "rear" not in frame.images]
    assert builder.surround.missing == {"rear": len(lacking)} and 0 < len(lacking) < 16


def test_a_camera_without_calibration_or_place_is_no_camera_of_the_frame() -> None:
    events = without(ring_events(), "/rear/info")
    events = list(changed(events, "/side_left/info", frame_id="nowhere"))
    frames = run(FrameBuilder(surround=FURTHER), events)
    assert len(frames) == 6
    for frame in frames:
        assert set(frame.cameras) == {"left", "side_right"} and set(frame.images) == set(RING)
        assert frame.robot_from_points is not None or frame.odometry is None
        assert 0 < len(fuse(frame, ALONE)) < len(fuse(frame))
