# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scans and images of a robot that turns among boxes."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusionslam.sensors.frame import Camera, Frame

Floats = NDArray[np.float64]
WIDTH, HEIGHT, FOCAL = 320, 200, 260.0
PERIOD = 0.4
OPTICAL = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])


@dataclass(frozen=True, eq=False)
class Drive:
    """Frames with what a dataset says of them; odometry only if it is wanted."""

    frames: list[Frame]
    name: str = "among boxes"
    body_from_points: Floats | None = None

    @property
    def numbers(self) -> NDArray[np.int64]:
        """As of a recording that begins with frame 100."""
        return np.arange(100, 100 + len(self.frames))

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Frame:
        return self.frames[index]


def make_drive(
    count: int, *, delay: float = 0.0, present: Floats | None = None, odometry: bool = True
) -> Drive:
    """A turning robot; scans and images every 0.4 s.

    Args:
        count: of frames.
        delay: the images show what was there that many seconds before their stamps.
        present: float64 (4, 4), the calibration (rectified_from_points) that the frames claim; None
            for the true one.
        odometry: whether the frames know where the robot was.
    """
    claimed = OPTICAL if present is None else present
    camera = Camera(_projection(), claimed, (WIDTH, HEIGHT))
    frames = []
    for index in range(count):
        time = PERIOD * index
        frames.append(
            Frame(
                index=index,
                stamp_ns=round(time * 1e9),
                points=_scan(time),
                images={"left": _image(time - delay)},
                cameras={"left": camera},
                odometry=pose_at(time) if odometry else None,
                robot_from_points=np.eye(4) if odometry else None,
            )
        )
    return Drive(frames)


def pose_at(time: float) -> Floats:
    """The robot sways to the left and right while it creeps forward."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", 0.4 * np.sin(1.1 * time)).as_matrix()
    pose[:3, 3] = 0.1 * time, 0, 0
    return pose


@cache
def _boxes() -> tuple[Floats, Floats]:
    """Lower and upper corners (N, 2, 3) and colours (N, 3): furniture before far walls."""
    rng = np.random.default_rng(4)
    angles = np.linspace(-1.1, 1.1, 16) + rng.uniform(-0.04, 0.04, 16)
    distance = rng.uniform(4, 9, 16)
    middle = np.column_stack([np.cos(angles), np.sin(angles)]) * distance[:, None]
    middle = np.column_stack([middle, rng.uniform(-0.8, 0.8, 16)])
    half = rng.uniform([0.15, 0.15, 0.3], [0.4, 0.4, 0.8], (16, 3))
    walls = np.array([[[14, -30, -3], [15, 30, 3]], [[-30, 14, -3], [30, 15, 3]]], dtype=float)
    walls = np.concatenate([walls, [[[-30, -15, -3], [30, -14, 3]]]])
    boxes = np.concatenate([np.stack([middle - half, middle + half], axis=1), walls])
    return boxes, rng.uniform(20, 235, (len(boxes), 3))


def _cast(time: float, rays: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Range (inf for none) and number of the box that each ray (N, 3) meets first."""
    (boxes, _), pose = _boxes(), pose_at(time)
    directions = rays @ pose[:3, :3].T
    enter, leave = np.float64(-np.inf), np.float64(np.inf)
    for axis in range(3):
        with np.errstate(divide="ignore"):
            low, high = (boxes[:, :, axis, None] - pose[axis, 3]).transpose(1, 0, 2) / directions[
                :, axis
            ]
        enter = np.maximum(enter, np.minimum(low, high))
        leave = np.minimum(leave, np.maximum(low, high))
    ranges = np.where((enter > 0) & (enter < leave), enter, np.inf)
    first = ranges.argmin(axis=0)
    return ranges.min(axis=0), first


@cache
def _scan(time: float) -> NDArray[np.float32]:
    """24 rings of 400 rays, forward and to the sides."""
    up, around = np.meshgrid(np.linspace(-0.3, 0.3, 24), np.linspace(-0.8, 0.8, 400))
    rays = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
    rays = rays.reshape(-1, 3)
    ranges, _ = _cast(time, rays)
    seen = np.isfinite(ranges)
    return np.ascontiguousarray(rays[seen] * ranges[seen, None], dtype=np.float32)


@cache
def _image(time: float) -> NDArray[np.uint8]:
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    right, down = (columns - WIDTH / 2) / FOCAL, (rows - HEIGHT / 2) / FOCAL
    rays = np.stack([np.ones_like(right), -right, -down], axis=-1).reshape(-1, 3)
    ranges, first = _cast(time, rays)
    image = np.where(np.isfinite(ranges)[:, None], _boxes()[1][first], 128)
    return image.reshape(HEIGHT, WIDTH, 3).astype(np.uint8)


def _projection() -> Floats:
    return np.array([[FOCAL, 0, WIDTH / 2, 0], [0, FOCAL, HEIGHT / 2, 0], [0, 0, 1.0, 0]])
