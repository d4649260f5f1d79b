# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs out of bags: which topics, where the cameras are, how deep, and what is refused."""

import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags import (
    BASELINE_M,
    INFOS,
    OPTICAL,
    RIGHT_FRAME,
    SECOND,
    START,
    STEREO_FOCAL,
    SUFFIXES,
    TOPICS,
    WALL_M,
    changed,
    delayed,
    info,
    put_bag,
    rectified_from_points,
    seen,
    stereo_drive,
    translation,
    without,
    write_bag,
)
from cli import info_of
from error_codes import has_code
from fusionslam import FusionConfig, fuse, open_dataset
from fusionslam.datasets.bags.reader import Topic
from fusionslam.datasets.bags.topics import choose_topics
from fusionslam.errors import DataError
from fusionslam.pipelines.recording import Recording
from fusionslam.sensors.messages import Event
from fusionslam.sensors.synchronizer import SyncConfig
from rows import rows

Logs = pytest.LogCaptureFixture

STEREO = FusionConfig(source="stereo")
PAIR = ("left", "right")


def distances(points: np.ndarray, camera_from_points: np.ndarray) -> np.ndarray:
    """Along the optical axis."""
    return points @ camera_from_points[2, :3] + camera_from_points[2, 3]


@rows("suffix", SUFFIXES)
def test_scans_have_both_images_and_the_cameras_have_one_place(tmp_path: Path, suffix: str) -> None:
    dataset = open_dataset(write_bag(tmp_path / f"drive.{suffix}", stereo_drive()))
    assert dataset.sensors == ("points", "left", "right") and dataset.has_stereo
    assert dataset.counts == {"points": 3, "left": 11, "right": 11} and len(dataset) == 3
    for camera in (dataset.cameras, dataset[1].cameras):
        for side in PAIR:
            place = camera[side].rectified_from_points
            np.testing.assert_allclose(place, rectified_from_points(), atol=1e-12)
        assert camera["right"].projection[0, 3] == -STEREO_FOCAL * BASELINE_M
    assert dataset.sensor_stamps("right").tolist() == dataset.stamps_ns.tolist()


@rows("right_frame", ["camera", RIGHT_FRAME, "nowhere_in_tf"])
def test_the_wall_is_as_far_whichever_frame_the_right_camera_names(
    tmp_path: Path, right_frame: str
) -> None:
    frame = open_dataset(put_bag(tmp_path, stereo_drive(right_frame=right_frame)))[0]
    cloud = fuse(frame, STEREO)
    assert len(cloud) > 8000 and cloud.colors is not None
    found = distances(cloud.points, rectified_from_points())
    assert abs(np.median(found) - WALL_M) < 0.01
    assert np.quantile(np.abs(found - WALL_M), 0.9) < 0.1


def test_both_images_are_rectified_by_their_own_calibration(tmp_path: Path) -> None:
    images = open_dataset(put_bag(tmp_path, stereo_drive()))[0].images
    assert difference(images["left"], images["right"]) < 0.2
    assert difference(images["left"], seen("right")) > 0.7
    assert difference(seen("left"), images["right"]) > 0.7


def difference(left: np.ndarray, right: np.ndarray) -> float:
    """Of two views of the wall, in parts of its contrast."""
    shift = round(STEREO_FOCAL * BASELINE_M / WALL_M)
    first = left[20:-20, 60:-40].astype(float)
    second = right[20:-20, 60 - shift : -40 - shift]
    return float(np.abs(first - second).mean() / np.abs(first - first.mean()).mean())


def test_without_scans_the_left_camera_leads_and_has_the_points(tmp_path: Path) -> None:
    dataset = open_dataset(put_bag(tmp_path, without(stereo_drive(), "/points")))
    assert dataset.sensors == PAIR and len(dataset) == 11
    assert dataset.numbers.tolist() == list(range(11)) and dataset.poses is not None
    frame = dataset[4]
    assert frame.stamp_ns == START + 4 * SECOND // 10 and frame.points is None
    np.testing.assert_allclose(frame.robot_from_points, OPTICAL)
    np.testing.assert_allclose(dataset.body_from_points, OPTICAL)
    scanner = translation(-0.1, 0, 0.3)
    turned = rectified_from_points() @ np.linalg.inv(np.linalg.inv(OPTICAL) @ scanner)
    np.testing.assert_allclose(frame.cameras["left"].rectified_from_points, turned, atol=1e-12)
    robot = fuse(frame, FusionConfig(source="stereo", frame="robot"))
    assert abs(np.median(robot.points[:, 0]) - 0.1 - WALL_M) < 0.05


def test_pairs_of_a_bag_with_scans_have_their_points_in_the_scans_frame(tmp_path: Path) -> None:
    path = put_bag(tmp_path, stereo_drive())
    pairs, whole = open_dataset(path, sensors=PAIR), open_dataset(path)
    assert len(pairs) == 11 and len(whole) == 3 and pairs.name == whole.name
    first, second = (fuse(dataset[0], STEREO).points for dataset in (pairs, whole))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(pairs.body_from_points, whole.body_from_points)
    alone = [event for event in stereo_drive() if "/stereo" in event.topic]
    frame = open_dataset(put_bag(tmp_path, alone))[0]  # which need no transforms
    assert frame.robot_from_points is None and len(fuse(frame, STEREO)) > 8000


def test_a_pair_is_taken_at_one_time(tmp_path: Path, caplog: Logs) -> None:
    """The right image of the second scan is missing; the next one is near enough for a scan."""
    missing = START + SECOND // 2
    events = [e for e in stereo_drive() if (e.topic, e.time_ns) != (TOPICS["right"], missing)]
    path = put_bag(tmp_path, events)
    dataset = open_dataset(path, sync=SyncConfig(max_difference=0.05))
    assert dataset.numbers.tolist() == [0, 2] and dataset.gaps == [1]
    dropped = [record.args[2:] for record in caplog.records]
    assert dropped == [(TOPICS["left"], "no image near"), ("/points", "no image near")]
    # A scan may also go with the pair before it, but never with two halves of pairs.
    near = open_dataset(path)
    assert len(near) == 3
    both = [near.sensor_stamps(side)[1] for side in PAIR]
    assert both == [missing - SECOND // 10] * 2
    pairs = open_dataset(path, sensors=PAIR)
    assert len(pairs) == 10 and pairs.gaps == [5]
    assert len(open_dataset(path, sensors=("points", "left"))) == 3


def test_how_far_the_halves_of_a_pair_may_lie_apart_is_configuration(tmp_path: Path) -> None:
    path = put_bag(tmp_path, delayed(stereo_drive(), TOPICS["right"], 20_000_000))
    with pytest.raises(DataError, check=has_code("no-pairs", *TOPICS.values())):
        open_dataset(path)
    dataset = open_dataset(path, sync=SyncConfig(stereo_difference=0.03))
    assert set(dataset.sensor_stamps("right") - dataset.sensor_stamps("left")) == {20_000_000}


def topics(*names: str) -> dict[str, Topic]:
    kinds = {"info": "CameraInfo", "points": "PointCloud2", "pressed": "CompressedImage"}
    found = {}
    for name in names:
        kind = next((kind for end, kind in kinds.items() if name.endswith(end)), "Image")
        found[name] = Topic(name, f"sensor_msgs/{kind}", 5)
    return found


@rows(
    "names, right, right_info",
    [
        (("/left/image", "/left/info", "/right/image", "/right/info"), "/right/image", None),
        (("/a/left/image", "/a/left/info", "/a/right/image"), "/a/right/image", ""),
        (("/a/left_image", "/a/left_info", "/a/right_image", "/a/right_info"), None, None),
        (("/zed/left/image", "/zed/left/info", "/zed/right/grey", "/zed/right/info"), None, None),
        (("/front/image", "/front/info", "/right/image", "/right/info"), "", ""),
        (("/a/left/image", "/a/left/info", "/a/right/depth", "/a/right/info"), "", ""),
    ],
)
def test_the_right_camera_is_guessed_by_its_name(
    names: tuple[str, ...], right: str | None, right_info: str | None
) -> None:
    """None stands for the third and the fourth name."""
    chosen = choose_topics(topics(*names))
    assert (chosen["left"], chosen["camera_info"]) == names[:2]
    assert chosen.get("right", "") == (names[2] if right is None else right)
    assert chosen.get("right_camera_info", "") == (names[3] if right_info is None else right_info)


def test_a_right_calibration_is_never_taken_for_the_left_one() -> None:
    chosen = choose_topics(topics("/s/left/image", "/s/right/image", "/s/right/info"))
    assert "camera_info" not in chosen and chosen["right_camera_info"] == "/s/right/info"


def test_a_pair_of_other_names_can_be_named(tmp_path: Path) -> None:
    renamed = {TOPICS["right"]: "/infra2/image", INFOS["right"]: "/infra2/camera_info"}
    events = [Event(renamed.get(e.topic, e.topic), e.time_ns, e.message) for e in stereo_drive()]
    path = put_bag(tmp_path, events)
    assert open_dataset(path, topics={"left": TOPICS["left"]}).sensors == ("points", "left")
    dataset = open_dataset(path, topics={"right": "/infra2/image"})
    assert dataset.source.roles["right_camera_info"] == "/infra2/camera_info"
    assert len(fuse(dataset[0], STEREO)) > 8000
    out = info_of(path, "--topic", f"left={TOPICS['left']}", "--topic", "right=/infra2/image")
    assert "right /infra2/image" in out and "baseline 0.400 m" in out


def test_the_images_of_one_camera_are_no_pair(tmp_path: Path) -> None:
    path, left = put_bag(tmp_path, stereo_drive()), TOPICS["left"]
    with pytest.raises(DataError, check=has_code("no-pair", left)):
        open_dataset(path, topics={"left": left, "right": left})
    with pytest.raises(DataError, check=has_code("no-pair")):
        open_dataset(path, sensors=("points", "right"))
    # Named as the right one, the left camera is not taken for the left one.
    swapped = open_dataset(path, topics={"right": left, "right_camera_info": INFOS["left"]})
    assert swapped.source.roles["left"] == TOPICS["right"] and not swapped.has_stereo
    assert "right" not in open_dataset(path, topics={"right": ""}).source.roles


def of_info(**changes: Any) -> Iterable[Event]:
    return changed(stereo_drive(), INFOS["right"], **changes)


NO_CAMERA = {"camera_matrix": np.zeros((3, 3)), "projection": np.zeros((3, 4))}
NO_BASELINE = {"projection": info("left").projection}
EXCHANGED = {"projection": info("right").projection * [[1, 1, 1, -1]]}
OTHER_FOCAL = {"projection": info("right").projection * [[1.1], [1], [1]]}


@rows(
    "events, word",
    [
        (without(stereo_drive(), TOPICS["right"]), "'right'"),
        (without(stereo_drive(), INFOS["right"]), TOPICS["right"]),
        (of_info(**NO_BASELINE), rf"{INFOS['right']} .*P\[0, 3\] = 0"),
        (of_info(**EXCHANGED), rf"{INFOS['right']} .*P\[0, 3\] = 80"),
        (of_info(**OTHER_FOCAL), f"{INFOS['left']} and {INFOS['right']}"),
        (of_info(size=(640, 96)), rf"{INFOS['right']} .*640x96"),
        (of_info(**NO_CAMERA), f"{INFOS['right']} .*K"),
    ],
)
def test_a_right_camera_that_cannot_be_used_is_named_and_the_left_one_still_works(
    tmp_path: Path, events: Iterable[Event], word: str, caplog: Logs
) -> None:
    path = put_bag(tmp_path, events)
    with pytest.raises(DataError, match=word) as error:
        open_dataset(path, sensors=PAIR)
    assert str(path) in str(error.value)
    with caplog.at_level(logging.WARNING):
        dataset = open_dataset(path)
    assert dataset.sensors == ("points", "left") and len(fuse(dataset[0])) > 0
    assert bool(caplog.records) == (word != "'right'")
    assert Recording.at(path).sources() == ("lidar",)


def test_a_right_image_of_another_size_is_refused_when_it_is_read(tmp_path: Path) -> None:
    small = np.zeros((48, 160, 3), np.uint8)
    frame = open_dataset(put_bag(tmp_path, changed(stereo_drive(), TOPICS["right"], image=small)))[
        0
    ]
    with pytest.raises(DataError, check=has_code("image-size", TOPICS["right"])):
        fuse(frame, STEREO)
    assert len(fuse(frame)) > 0


def test_info_and_bench_know_the_pair(tmp_path: Path) -> None:
    path = put_bag(tmp_path, stereo_drive())
    assert Recording.at(path).sources() == ("lidar", "stereo")
    out = info_of(path)
    assert "stereo baseline 0.400 m" in out and f"right {TOPICS['right']}" in out
    blind = write_bag(path.with_name("blind.bag"), without(stereo_drive(), "/points"))
    assert Recording.at(blind).sources() == ("stereo",)
    out = info_of(blind)
    assert "points of the first stereo pair" in out and "not possible" not in out
    flat = np.full_like(seen("left"), 90)
    dull = changed(without(stereo_drive(), "/points"), TOPICS["left"], image=flat)
    out = info_of(write_bag(path.with_name("dull.bag"), dull))
    assert "doubtful: the images of the first stereo pair have nothing in common" in out
