# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write a simulated recording as a plain folder; a frame is a scan and the last image before it."""

import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from fusionslam.base.arrays import Floats
from fusionslam.base.files import atomic_path, write_file
from fusionslam.datasets import write_cloud, write_poses_tum
from fusionslam.datasets.calibration import ON_ROBOT
from fusionslam.datasets.pose_files import write_times
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Event, Odometry, Picture, Scan
from fusionslam.sim.camera import CameraMount, LensConfig, projection
from fusionslam.sim.lidar import LidarMount
from fusionslam.sim.robot import TRUTH_TOPIC, RobotConfig, base_from
from fusionslam.sim.simulator import Task

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
        self._sides = {camera.picture_topic(): side for side, camera in self._cameras.items()}
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
        pictures: dict[str, Task] = {}
        for task in tasks:
            if task.topic in self._sides:
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
            if event.topic in self._sides:
                self._pictures[self._sides[event.topic]] = message
        elif isinstance(message, Odometry) and event.topic == TRUTH_TOPIC:
            self._truth.append(message)
        elif (
            isinstance(message, Scan)
            and event.topic == self._lidar.topic
            and len(self._pictures) == len(self._cameras)
        ):
            self._write_frame(message)

    def _write_frame(self, scan: Scan) -> None:
        name = f"{self.count:06d}"
        cloud = self._root / "clouds" / f"{name}.bin"
        images = {self._root / side / f"{name}.png": shot for side, shot in self._pictures.items()}
        try:
            write_cloud(cloud, Cloud(scan.points, None, scan.fields.get("intensity")))
            for path, picture in images.items():
                write_png(path, picture.image)
        except BaseException:
            # An incomplete frame would make the folder unreadable.
            for path in (cloud, *images):
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
        stamps = np.array(self._stamps, dtype=np.int64)
        write_times(self._root / "times.txt", stamps)
        write_poses_tum(self._root / "poses.txt", stamps, self._poses(stamps))
        # P of a right camera refers to the left camera's frame.
        cameras = {
            side: (
                camera,
                projection(camera, right=side == "right"),
                base_from(self._robot, camera.frame_id),
            )
            for side, camera in self._cameras.items()
        }
        text = calibration_text(base_from(self._robot, self._lidar.frame_id), cameras)
        write_file(self._root / "calib.yaml", text, durable=False)

    def _poses(self, stamps: NDArray[np.int64]) -> Floats:
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


def calibration_text(
    robot_from_lidar: Floats, cameras: Mapping[str, tuple[LensConfig, Floats, Floats]]
) -> str:
    """The calib.yaml of a plain folder.

    Args:
        robot_from_lidar: float64 (4, 4).
        cameras: lens, P float64 (3, 4), and robot_from_camera float64 (4, 4), by folder.
    """
    values: dict[str, Any] = {ON_ROBOT: robot_from_lidar.ravel().tolist()}
    for name, (lens, matrix, robot_from_camera) in cameras.items():
        from_points = np.linalg.inv(robot_from_camera) @ robot_from_lidar
        values[name] = {
            "projection": matrix.ravel().tolist(),
            "rectified_from_points": from_points.ravel().tolist(),
            "size": [lens.width, lens.height],
        }
    return yaml.safe_dump(values, default_flow_style=None, sort_keys=False)


def write_png(path: Path, image: NDArray[np.uint8]) -> None:
    """Write an image, uint8 (H, W, 3). Raises DataError if the file cannot be written."""
    with atomic_path(path, durable=False) as temporary:
        Image.fromarray(image).save(temporary, format="PNG", compress_level=1)
