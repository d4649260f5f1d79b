# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot's camera sees on its way through a world, rendered."""

import hashlib
import threading
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.config import merged
from fusionslam.geometry.trajectory import Trajectory, read_trajectory
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.images import Images
from fusionslam.sim.camera import CameraMount, photograph
from fusionslam.sim.robot import base_from_camera, robot_named
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.worlds import load_world
from fusionslam.storage.arrays import Floats, Image

RATE_HZ = 10.0
"""Images a second that are rendered: those of the original's runs."""
# Part of the cache's key: raise it when the same key gives other bytes.
_FORMAT = 1


def rendered_images(
    world: Path,
    seconds: Floats,
    poses: Floats,
    *,
    bottom: int | None = None,
    robot: str = "turtlebot3_waffle_pi",
    rate_hz: float = RATE_HZ,
) -> Images:
    """What the robot's camera sees on its way through a world: rendered when it is asked for.

    Args:
        world: a file that ``load_world`` reads, with the drive beside it, if there is one.
        seconds: float64 (m), times of the scans, on the clock of that drive.
        poses: float64 (m, 3), true places then: the way, where there is no drive.
        bottom: the row after the last that is needed; what is below it is not rendered.
        robot: whose camera; the first one that it has.
        rate_hz: images a second.

    Raises:
        DataError: the world or its drive cannot be read.
        FusionSlamError: the simulator's extra is not installed.
    """
    beside = world.with_suffix(".trajectory.csv")
    drive = Trajectory(seconds, poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    if beside.is_file():
        drive = read_trajectory(beside)
    start, stop = float(seconds[0]), float(seconds[-1])
    times = start + np.arange(int(np.floor((stop - start) * rate_hz + 1e-6)) + 1) / rate_hz
    times = np.minimum(times, stop)
    camera = next(iter(robot_named(robot).cameras.values()))
    return Images(
        times,
        np.stack(drive.places(times), axis=1),
        _Renderer(world, drive, robot, _upper_part(camera, bottom), times),
        f"rendered in {world.name}",
        _key(world, robot, camera, drive, times),
        Camera(np.pad(camera.matrix(), ((0, 0), (0, 1))), size=(camera.width, camera.height)),
    )


class _Renderer:
    """Renders the i-th image; the world is read when the first one is asked for."""

    def __init__(
        self, world: Path, drive: Trajectory, robot: str, camera: CameraMount, times: Floats
    ) -> None:
        self._world, self._camera = world, camera
        self._poses = drive.at(times) @ base_from_camera(robot_named(robot), camera)
        self._caster: Any = None
        self._loading = threading.Lock()

    def __call__(self, index: int) -> Image:
        noise = np.random.default_rng([0, index])
        pose = self._poses[index]
        return photograph(self._loaded(), self._camera, pose, (1.0, 1.0, 1.0), noise)

    def _loaded(self) -> Any:
        with self._loading:
            if self._caster is None:
                self._caster = RayCaster(load_world(self._world).visual)
            return self._caster


def _upper_part(camera: CameraMount, bottom: int | None) -> CameraMount:
    """The camera with fewer rows: each pixel of those that are left sees what it saw."""
    matrix = camera.matrix()
    rows = camera.height if bottom is None else min(bottom, camera.height)
    changes = {
        "view_rad": None,
        "focal_px": float(matrix[0, 0]),
        "centre_px": (float(matrix[0, 2]), float(matrix[1, 2])),
        "height": rows,
    }
    return merged(camera, changes)


def _key(world: Path, robot: str, camera: CameraMount, drive: Trajectory, times: Floats) -> str:
    hashed = hashlib.sha256(world.read_bytes())
    for values in (times, *drive.places(times)):
        hashed.update(np.ascontiguousarray(values).tobytes())
    hashed.update(f"{_FORMAT} {robot} {camera.model_dump_json()}".encode())
    return hashed.hexdigest()
