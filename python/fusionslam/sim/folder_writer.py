# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write a simulated recording as a plain folder; a frame is a scan and the last image before it."""

import io
import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from fusionslam.datasets import write_poses_tum
from fusionslam.datasets.calibration import ON_ROBOT
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.messages import Event, Odometry, Picture, Scan
from fusionslam.sim.camera import CameraMount, projection
from fusionslam.sim.lidar import LidarMount
from fusionslam.sim.robot import TRUTH_TOPIC, RobotConfig, base_from
from fusionslam.sim.simulator import Task
from fusionslam.storage.files import atomic_path

logger = logging.getLogger(__name__)

# Folders that are not of a further camera of that name.
_TAKEN = ("left", "right", "clouds", "points", "images")


@contextmanager
def folder_writer(path: str | os.PathLike[str], robot: RobotConfig) -> Iterator["FolderWriter"]:
    """Write what ``simulate`` yields as a folder that ``open_dataset`` reads.

    The folder holds ``clouds/NNNNNN.bin`` (float32 x y z intensity) of the robot's first LiDAR,
    ``left/`` with PNG images of the first camera, ``right/`` for a stereo pair, folders of their
    names for further cameras, ``calib.yaml``, ``times.txt``, and ``poses.txt`` with the true poses
    of the LiDAR. If the block ends with an error, the frames written so far are kept.

    Args:
        path: the folder, new or empty.
        robot: the robot whose events are written.

    Raises:
        DataError: the folder is not empty, or cannot be written.
        ConfigError: the robot has no LiDAR, or a camera with distortion: a folder's images are
            rectified.
    """
    root = Path(path).expanduser()
    writer = FolderWriter(root, robot)
    check_folder(root)
    try:
        yield writer
    except BaseException:
        # This may fail too, for example on a full disk: report the first error.
        with suppress(DataError):
            writer.finish()
            logger.warning("%s is not complete; its first %d frames are kept", root, writer.count)
        raise
    writer.finish()


def check_folder(root: Path) -> None:
    """Raise DataError unless a folder is new or empty."""
    if (root / "clouds").is_dir():
        raise DataError(
            f"{root} holds a recording, perhaps one that was interrupted: remove it, or choose "
            "another folder"
        )
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise DataError(
            f"{root} exists and is not an empty folder: choose another one",
            code="not-empty",
            fields=(str(root),),
        )


class FolderWriter:
    """A folder that is being written; created by ``folder_writer``."""

    def __init__(self, root: Path, robot: RobotConfig) -> None:
        self._root = root
        self._lidar = first_lidar(robot)
        self._cameras = _chosen(robot)
        self._robot = robot
        self._pictures: dict[str, Picture] = {}
        self._truth: list[Odometry] = []
        self._stamps: list[int] = []

    @property
    def count(self) -> int:
        """Number of frames written."""
        return len(self._stamps)

    def select_tasks(self, tasks: Iterable[Task]) -> Iterator[Task]:
        """The tasks whose messages the folder keeps: most images need not be rendered."""
        sides = {camera.picture_topic() for camera in self._cameras.values()}
        pictures: dict[str, Task] = {}
        for task in tasks:
            if task.topic in sides:
                pictures[task.topic] = task
            elif task.topic == TRUTH_TOPIC:
                yield task
            elif task.topic == self._lidar.topic:
                yield from pictures.values()
                yield task
                pictures.clear()

    def write(self, event: Event) -> None:
        """Take the next message in time order; scans before the first image are left out.

        Raises:
            DataError: the folder cannot be written.
        """
        message = event.message
        if isinstance(message, Picture):
            sides = {camera.picture_topic(): side for side, camera in self._cameras.items()}
            if event.topic in sides:
                self._pictures[sides[event.topic]] = message
        elif isinstance(message, Odometry) and event.topic == TRUTH_TOPIC:
            self._truth.append(message)
        elif isinstance(message, Scan) and event.topic == self._lidar.topic and self._ready():
            self._write_frame(message)

    def _ready(self) -> bool:
        return len(self._pictures) == len(self._cameras)

    def _write_frame(self, scan: Scan) -> None:
        name = f"{self.count:06d}"
        intensity = scan.fields.get("intensity", np.zeros(len(scan.points), np.float32))
        cloud = np.column_stack([scan.points, intensity]).astype("<f4")
        files = {self._root / "clouds" / f"{name}.bin": cloud.tobytes()}
        for side, picture in self._pictures.items():
            files[self._root / side / f"{name}.png"] = _png(picture.image)
        try:
            for path, data in files.items():
                _write(path, data)
        except BaseException:
            # An incomplete frame would make the folder unreadable.
            for path in files:
                path.unlink(missing_ok=True)
            raise
        self._stamps.append(scan.stamp_ns)

    def finish(self) -> None:
        """Write calibration, times and poses of the frames.

        Raises:
            DataError: there are no frames, or the folder cannot be written.
        """
        if not self._stamps:
            raise DataError(f"{self._root}: no frame was recorded: no scan follows an image")
        seconds = [f"{Decimal(stamp).scaleb(-9):f}\n" for stamp in self._stamps]
        _write(self._root / "times.txt", "".join(seconds).encode())
        stamps = np.array(self._stamps, dtype=np.int64)
        write_poses_tum(self._root / "poses.txt", stamps, self._poses(stamps))
        text = yaml.safe_dump(self._calibration(), default_flow_style=None, sort_keys=False)
        _write(self._root / "calib.yaml", text.encode())

    def _poses(self, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
        """world_from_lidar at time stamps, interpolated between the received true poses."""
        known = np.array([truth.stamp_ns for truth in self._truth], dtype=np.int64)
        poses = np.array([truth.pose for truth in self._truth])
        yaw = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
        # A float64 cannot hold nanoseconds since 1970 exactly.
        places = (
            np.interp(stamps - known[0], known - known[0], values)
            for values in (poses[:, 0, 3], poses[:, 1, 3], yaw)
        )
        return ground_poses(*places) @ base_from(self._robot, self._lidar.frame_id)

    def _calibration(self) -> dict[str, Any]:
        base_from_lidar = base_from(self._robot, self._lidar.frame_id)
        cameras = {
            side: {
                "projection": projection(camera, right=side == "right").ravel().tolist(),
                # P of the right camera refers to the left camera's frame.
                "rectified_from_points": (
                    np.linalg.inv(base_from(self._robot, camera.frame_id)) @ base_from_lidar
                )
                .ravel()
                .tolist(),
                "size": [camera.width, camera.height],
            }
            for side, camera in self._cameras.items()
        }
        return {ON_ROBOT: base_from_lidar.ravel().tolist()} | cameras


def first_lidar(robot: RobotConfig) -> LidarMount:
    """The LiDAR whose scans define the frames. Raises ConfigError if there is none."""
    if not robot.lidars:
        raise ConfigError(
            "lidars is empty: a folder of frames needs a LiDAR",
            code="missing-sensor",
            fields=("lidars",),
        )
    return next(iter(robot.lidars.values()))


def _chosen(robot: RobotConfig) -> Mapping[str, CameraMount]:
    """The robot's cameras by folder: the first is "left", the other one of its pair "right".

    Of further pairs only the left camera is written.
    """
    left = next((c for c in robot.cameras.values() if c.side == "left"), None)
    if left is None:
        return {}
    chosen: dict[str, CameraMount] = {}
    for name, camera in robot.cameras.items():
        if camera.frame_id == left.frame_id:
            chosen[camera.side] = camera
        elif camera.side == "left":
            chosen[f"{name}_camera" if name in _TAKEN else name] = camera
    for side, camera in chosen.items():
        if camera.coefficients():
            raise ConfigError(
                f"the {side} camera has distortion {camera.distortion}, but a folder's images "
                "are rectified: set it to [], or record a bag",
                code="distorted",
                fields=(side,),
            )
    return chosen


def _png(image: NDArray[np.uint8]) -> bytes:
    data = io.BytesIO()
    Image.fromarray(image).save(data, format="PNG", compress_level=1)
    return data.getvalue()


def _write(path: Path, data: bytes) -> None:
    with atomic_path(path, durable=False) as temporary:
        temporary.write_bytes(data)
