# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Camera images rendered along a robot's drive through a world."""

import hashlib
import threading
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.arrays import Floats, Image
from fusionslam.config import merged
from fusionslam.geometry.trajectory import Trajectory, read_trajectory
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.sim.camera import CameraMount, photograph
from fusionslam.sim.robot import base_from_camera, robot_named
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.world import hash_world
from fusionslam.sim.worlds import load_world

RATE_HZ = 10.0
"""Images rendered per second: the rate of the original's runs."""
# Part of the cache key: increment when the same key gives different bytes.
_FORMAT = 1


def rendered_images(
    world: Path,
    seconds: Floats,
    poses: Floats,
    *,
    bottom: int | None = None,
    robot: str = "turtlebot3_waffle_pi",
    rate_hz: float = RATE_HZ,
) -> ImageSeries:
    """Images of the robot's camera along its drive through a world, rendered on demand.

    Args:
        world: a file that ``load_world`` reads; a drive stored beside it is used.
        seconds: float64 (m), times of the scans, on the clock of that drive.
        poses: float64 (m, 3), true poses at these times, used if no drive is stored.
        bottom: the row after the last one needed; rows from here on are not rendered.
        robot: its first camera is used.
        rate_hz: images per second.

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
    return ImageSeries(
        times,
        np.stack(drive.places(times), axis=1),
        _Renderer(world, drive, robot, _upper_part(camera, bottom), times),
        f"rendered in {world.name}",
        _key(world, robot, camera, drive, times),
        Camera(np.pad(camera.matrix(), ((0, 0), (0, 1))), size=(camera.width, camera.height)),
    )


class _Renderer:
    """Renders the i-th image; reads the world when the first image is requested."""

    def __init__(
        self, world: Path, drive: Trajectory, robot: str, camera: CameraMount, times: Floats
    ) -> None:
        self._world, self._camera = world, camera
        self._poses = drive.at(times) @ base_from_camera(robot_named(robot), camera)
        self._caster: Any = None
        self._loading = threading.Lock()

    def __call__(self, index: int) -> Image:
        with self._loading:
            if self._caster is None:
                self._caster = RayCaster(load_world(self._world).visual)
        noise = np.random.default_rng([0, index])
        return photograph(self._caster, self._camera, self._poses[index], 1.0, noise)


def _upper_part(camera: CameraMount, bottom: int | None) -> CameraMount:
    """The camera cropped to its upper rows; the remaining pixels keep their rays."""
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
    if world.suffix != ".glb":  # SDF refers to meshes and textures in other files
        hashed.update(hash_world(load_world(world)).encode())
    for values in (times, *drive.places(times)):
        hashed.update(np.ascontiguousarray(values).tobytes())
    hashed.update(f"{_FORMAT} {robot} {camera.model_dump_json()}".encode())
    return hashed.hexdigest()
