# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bags, and the messages in them: one camera, a stereo pair, a scanner and odometry."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from fusionslam.datasets import open_writer
from fusionslam.sensors.messages import (
    CameraInfo,
    Event,
    FrameTransform,
    FrameTransforms,
    Odometry,
    Picture,
    Scan,
)
from fusionslam.sim.camera import undistort

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
SIZE = (64, 48)
FOCAL = 60.0
SPEED = 0.5
SUFFIXES = ("bag", "db3", "mcap")
RED, BLUE = (200, 30, 20), (10, 40, 220)
"""Colours of the left and the right half of every image."""
OPTICAL = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 0.2], [0, 0, 0, 1.0]])
"""base_from_camera: x right, y down, z forward, of a camera 0.1 m before and 0.2 m above."""


def translation(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def camera_info(stamp_ns: int = START, **changes: Any) -> CameraInfo:
    matrix = np.array([[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1]])
    values: dict[str, Any] = {
        "stamp_ns": stamp_ns,
        "frame_id": "camera",
        "size": SIZE,
        "camera_matrix": matrix,
        "distortion": np.zeros(5),
        "projection": np.hstack([matrix, np.zeros((3, 1))]),
    }
    return CameraInfo(**values | changes)


def picture(stamp_ns: int = START, size: tuple[int, int] = SIZE) -> Picture:
    image = np.empty((size[1], size[0], 3), np.uint8)
    image[:, : size[0] // 2], image[:, size[0] // 2 :] = RED, BLUE
    return Picture(stamp_ns=stamp_ns, frame_id="camera", image=image)


def scan(stamp_ns: int = START, x: float = 4.0) -> Scan:
    """A wall x metres before the scanner, from left to right."""
    y = np.linspace(-1, 1, 41, dtype=np.float32)
    points = np.stack([np.full_like(y, x), y, np.zeros_like(y)], axis=1)
    fields: dict[str, NDArray[Any]] = {
        "intensity": np.arange(41, dtype=np.float32),
        "ring": np.arange(41, dtype=np.uint16),
    }
    return Scan(stamp_ns=stamp_ns, frame_id="velodyne", points=points, fields=fields)


def odometry(stamp_ns: int) -> Odometry:
    return Odometry(
        stamp_ns=stamp_ns,
        frame_id="odom",
        child_frame_id="base",
        pose=translation(SPEED * (stamp_ns - START) / SECOND),
        linear=np.array([SPEED, 0, 0]),
    )


def static(parent: str, child: str, pose: np.ndarray) -> FrameTransform:
    return FrameTransform(
        stamp_ns=START, parent=parent, child=child, parent_from_child=pose, static=True
    )


def extrinsics() -> FrameTransforms:
    scanner = static("base", "velodyne", translation(-0.1, 0, 0.3))
    return FrameTransforms(transforms=(scanner, static("base", "camera", OPTICAL)))


def drive(seconds: float = 2.0, delay_ns: int = 0) -> list[Event]:
    """Scans at 2 Hz, images and calibrations at 10 Hz, odometry at 50 Hz; they arrive later."""
    events = [Event("/tf_static", START, extrinsics())]
    for k in range(round(50 * seconds) + 1):
        stamp_ns = START + k * SECOND // 50
        messages: list[tuple[str, Any]] = [("/odom", odometry(stamp_ns))]
        if k % 5 == 0:
            messages += [("/camera/camera_info", camera_info(stamp_ns))]
            messages += [("/camera/image", picture(stamp_ns))]
        if k % 25 == 0:
            messages += [("/points", scan(stamp_ns, 4 - SPEED * k / 50))]
        events += [Event(topic, stamp_ns + delay_ns, message) for topic, message in messages]
    return events


def without(events: Iterable[Event], topic: str) -> list[Event]:
    return [event for event in events if event.topic != topic]


def changed(events: Iterable[Event], topic: str, **changes: Any) -> Iterator[Event]:
    """The events with other values in the messages of a topic."""
    for event in events:
        if event.topic == topic:
            message = dataclasses.replace(event.message, **changes)
            event = Event(event.topic, event.time_ns, message)
        yield event


def delayed(
    events: Iterable[Event], topic: str, by_ns: int, *, after_ns: int = 0
) -> Iterator[Event]:
    """The events with later stamps in the messages of a topic that arrive after a time."""
    for event in events:
        if event.topic == topic and event.time_ns > after_ns:
            message: Any = event.message
            (event,) = changed([event], topic, stamp_ns=message.stamp_ns + by_ns)
        yield event


def copies(events: Iterable[Event], topic: str, name: str) -> list[Event]:
    """The messages of a topic once more, under another name."""
    return [dataclasses.replace(event, topic=name) for event in events if event.topic == topic]


def put_bag(folder: Path, events: Iterable[Event]) -> Path:
    return write_bag(folder / "drive.bag", events)


def write_bag(
    path: Path,
    events: Iterable[Event],
    *,
    cut: Callable[[str, int], bool] = lambda topic, time_ns: False,
    bend: Callable[[str, int, bytes], bytes] = lambda topic, time_ns, data: data,
    **options: Any,
) -> Path:
    """Write a bag; messages that ``cut`` chooses by topic and time lose their last 20 bytes.

    ``bend`` changes the bytes of a message, by topic and time.
    """
    with open_writer(path, **options) as bag:
        write = bag._writer.write

        def write_some(connection: Any, time_ns: int, data: Any) -> None:
            data = bend(connection.topic, time_ns, bytes(data))
            write(connection, time_ns, data[:-20] if cut(connection.topic, time_ns) else data)

        bag._writer.write = write_some
        for event in events:
            bag.write(event)
    return path


def same(first: Any, second: Any) -> bool:
    """Whether two values are equal field by field; rotations up to rounding."""
    if isinstance(first, np.ndarray):
        tolerance = 1e-14 if first.shape == (4, 4) else 0.0
        return (first.dtype, first.shape) == (second.dtype, second.shape) and np.allclose(
            first, second, rtol=0, atol=tolerance, equal_nan=first.dtype.kind == "f"
        )
    if dataclasses.is_dataclass(first):
        names = [field.name for field in dataclasses.fields(first)]
        return type(first) is type(second) and all(
            same(getattr(first, name), getattr(second, name)) for name in names
        )
    if isinstance(first, dict):
        return list(first) == list(second) and all(same(first[k], second[k]) for k in first)
    if isinstance(first, tuple):
        return len(first) == len(second) and all(map(same, first, second))
    return bool(first == second)


STEREO_SIZE = (320, 96)
WALL_M, BASELINE_M, STEREO_FOCAL = 5.0, 0.4, 200.0
RECTIFIED = np.array([[STEREO_FOCAL, 0, 160], [0, STEREO_FOCAL, 48], [0, 0, 1.0]])
RAW = np.array([[210.0, 0, 150], [0, 205, 50], [0, 0, 1.0]])
DISTORTION = (-0.2, 0.05, 0.001, -0.0005, 0.0)
# How each raw camera is turned against the rectified pair.
TURNS = {
    side: Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    for side, angles in {"left": (1.0, -2.0, 0.5), "right": (-0.5, 1.5, 1.0)}.items()
}
TOPICS = {side: f"/stereo/{side}/image_raw" for side in TURNS}
INFOS = {side: f"/stereo/{side}/camera_info" for side in TURNS}
RIGHT_FRAME = "right_camera"


def info(side: str, stamp_ns: int = START, *, frame_id: str = "camera") -> CameraInfo:
    """As REP 104 has it: P of the right camera counts from the left one and has the baseline."""
    projection = np.hstack([RECTIFIED, np.zeros((3, 1))])
    if side == "right":
        projection[0, 3] = -STEREO_FOCAL * BASELINE_M
    return CameraInfo(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        size=STEREO_SIZE,
        camera_matrix=RAW,
        distortion=np.array(DISTORTION),
        rectification=TURNS[side],
        projection=projection,
    )


def stereo_picture(side: str, stamp_ns: int = START) -> Picture:
    return Picture(stamp_ns=stamp_ns, frame_id="camera", image=seen(side))


@cache
def seen(side: str) -> NDArray[np.uint8]:
    """What a raw camera sees of a wall of random colours, by following each pixel's ray."""
    columns, rows = np.meshgrid(*(np.arange(n) for n in STEREO_SIZE))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    bent = (pixels - RAW[:2, 2]) / RAW[[0, 1], [0, 1]]
    rays = np.column_stack([undistort(bent, DISTORTION), np.ones(len(bent))]) @ TURNS[side].T
    places = rays[:, :2] / rays[:, 2:] * WALL_M
    places[:, 0] += BASELINE_M if side == "right" else 0.0
    noise = np.random.default_rng(4).integers(0, 256, (3, 200, 400)).astype(np.float64)
    # Cells of 5 cm, which is two pixels.
    cells = (places.T[::-1] / 0.05) + np.array([[100.0], [200.0]])
    colors = [map_coordinates(channel, cells, order=1, mode="reflect") for channel in noise]
    return np.stack(colors, axis=-1).reshape(STEREO_SIZE[1], STEREO_SIZE[0], 3).astype(np.uint8)


def stereo_drive(seconds: float = 1.0, *, right_frame: str = "camera") -> Iterator[Event]:
    """``drive`` with a stereo pair in place of its camera; TF knows the right camera, too."""
    for event in drive(seconds):
        stamp_ns = event.time_ns
        if event.topic == "/camera/image":
            for side, topic in TOPICS.items():
                yield Event(topic, stamp_ns, stereo_picture(side, stamp_ns))
        elif event.topic == "/camera/camera_info":
            for side, topic in INFOS.items():
                frame = right_frame if side == "right" else "camera"
                yield Event(topic, stamp_ns, info(side, stamp_ns, frame_id=frame))
        elif event.topic == "/tf_static":
            right = static("camera", RIGHT_FRAME, translation(BASELINE_M))
            transforms = (*extrinsics().transforms, right)
            yield Event(event.topic, stamp_ns, FrameTransforms(transforms=transforms))
        else:
            yield event


def rectified_from_points() -> NDArray[np.float64]:
    """Transform from the scanner to the rectified camera, float64 (4, 4)."""
    turn = np.eye(4)
    turn[:3, :3] = TURNS["left"]
    place: NDArray[np.float64] = turn @ np.linalg.inv(OPTICAL) @ translation(-0.1, 0, 0.3)
    return place
