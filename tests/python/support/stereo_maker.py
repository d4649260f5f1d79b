# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A stereo pair before a wall of known distance, as messages: raw images that need rectifying."""

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from bag_maker import OPTICAL, START, drive, extrinsics, static, translation
from fusionslam.sensors.messages import CameraInfo, Event, FrameTransforms, Picture
from fusionslam.sim.camera import undistorted

SIZE = (320, 96)
WALL_M, BASELINE_M, FOCAL = 5.0, 0.4, 200.0
RECTIFIED = np.array([[FOCAL, 0, 160], [0, FOCAL, 48], [0, 0, 1.0]])
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
        projection[0, 3] = -FOCAL * BASELINE_M
    return CameraInfo(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        size=SIZE,
        camera_matrix=RAW,
        distortion=np.array(DISTORTION),
        rectification=TURNS[side],
        projection=projection,
    )


def picture(side: str, stamp_ns: int = START) -> Picture:
    return Picture(stamp_ns=stamp_ns, frame_id="camera", image=seen(side))


@cache
def seen(side: str) -> NDArray[np.uint8]:
    """What a raw camera sees of a wall of random colours, by following each pixel's ray."""
    columns, rows = np.meshgrid(*(np.arange(n) for n in SIZE))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    bent = (pixels - RAW[:2, 2]) / RAW[[0, 1], [0, 1]]
    rays = np.column_stack([undistorted(bent, DISTORTION), np.ones(len(bent))]) @ TURNS[side].T
    places = rays[:, :2] / rays[:, 2:] * WALL_M
    places[:, 0] += BASELINE_M if side == "right" else 0.0
    noise = np.random.default_rng(4).integers(0, 256, (3, 200, 400)).astype(np.float64)
    # Cells of 5 cm, which is two pixels.
    cells = (places.T[::-1] / 0.05) + np.array([[100.0], [200.0]])
    colors = [map_coordinates(channel, cells, order=1, mode="reflect") for channel in noise]
    return np.stack(colors, axis=-1).reshape(SIZE[1], SIZE[0], 3).astype(np.uint8)


def stereo_drive(seconds: float = 1.0, *, right_frame: str = "camera") -> Iterator[Event]:
    """``drive`` with a stereo pair in place of its camera; TF knows the right camera, too."""
    for event in drive(seconds):
        stamp_ns = event.time_ns
        if event.topic == "/camera/image":
            for side, topic in TOPICS.items():
                yield Event(topic, stamp_ns, picture(side, stamp_ns))
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
    """Of the scanner of ``bag_maker``, (4, 4)."""
    turn = np.eye(4)
    turn[:3, :3] = TURNS["left"]
    place: NDArray[np.float64] = turn @ np.linalg.inv(OPTICAL) @ translation(-0.1, 0, 0.3)
    return place
