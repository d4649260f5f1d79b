# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Folders and texts of the town's recordings: KITTI odometry, or a plain folder."""

from typing import NamedTuple

import numpy as np
import yaml

from fusionslam.datasets.calibration import ON_ROBOT
from fusionslam.sim.camera import LensConfig, parent_from_camera, projection
from fusionslam.sim.lidar import Vector
from fusionslam.sim.town.car import RING, CarConfig, car_from_lidar, car_from_ring_camera
from fusionslam.sim.town.route import Drive
from fusionslam.storage.arrays import Floats


class Shots(NamedTuple):
    """The images of one camera.

    Attributes:
        folder: where they are.
        lens: of the camera.
        car_from_camera: float64 (4, 4).
        gains: of red, green and blue on each lap; the last one serves later laps.
    """

    folder: str
    lens: LensConfig
    car_from_camera: Floats
    gains: tuple[Vector, ...]


class Layout(NamedTuple):
    """Where a recording has its files; paths are relative to its folder.

    Attributes:
        scans: folder of the scans.
        shots: the images of each camera.
        texts: path and text of calibration, times and poses.
    """

    scans: str
    shots: tuple[Shots, ...]
    texts: dict[str, str]


def layout_of(car: CarConfig, drive: Drive) -> Layout:
    """The layout that fits the car's cameras."""
    return (_folder if car.cameras == "four" else _kitti)(car, drive)


def _kitti(car: CarConfig, drive: Drive) -> Layout:
    """Sequence 00 of KITTI odometry, whose poses are those of the left camera."""
    cameras = drive.poses @ parent_from_camera(car.camera)
    shots = tuple(
        Shots(
            f"sequences/00/image_{number}",
            car.camera,
            parent_from_camera(car.camera, right=number == 3),
            car.camera.exposure,
        )
        for number in (2, 3)
    )
    texts = {
        "sequences/00/times.txt": _times(drive),
        "sequences/00/calib.txt": _lines(_kitti_calibration(car)),
        "poses/00.txt": _lines([_row(pose[:3]) for pose in np.linalg.inv(cameras[0]) @ cameras]),
    }
    return Layout("sequences/00/velodyne", shots, texts)


def _kitti_calibration(car: CarConfig) -> list[str]:
    left, right = (projection(car.camera, right=right) for right in (False, True))
    lidar = np.linalg.inv(parent_from_camera(car.camera)) @ car_from_lidar(car)
    rows = {"P0": left, "P1": right, "P2": left, "P3": right, "Tr": lidar[:3]}
    return [f"{name}: {_row(matrix)}" for name, matrix in rows.items()]


def _folder(car: CarConfig, drive: Drive) -> Layout:
    """A plain folder with the images of the four cameras, whose poses are those of the LiDAR."""
    ring, lidar = car.ring, car_from_lidar(car)
    places = {name: car_from_ring_camera(ring, name) for name in RING}
    shots = tuple(
        Shots(name, ring, place, tuple(_product(gain, lap) for lap in ring.exposure))
        for (name, place), gain in zip(places.items(), ring.gains, strict=True)
    )
    calibration = {ON_ROBOT: lidar.ravel().tolist()} | {
        name: {
            "projection": projection(ring).ravel().tolist(),
            "rectified_from_points": (np.linalg.inv(place) @ lidar).ravel().tolist(),
            "size": [ring.width, ring.height],
        }
        for name, place in places.items()
    }
    texts = {
        "times.txt": _times(drive),
        "calib.yaml": yaml.safe_dump(calibration, default_flow_style=None, sort_keys=False),
        "poses.txt": _lines([_row(pose[:3]) for pose in drive.poses @ lidar]),
    }
    return Layout("clouds", shots, texts)


def _product(first: Vector, second: Vector) -> Vector:
    red, green, blue = (a * b for a, b in zip(first, second, strict=True))
    return red, green, blue


def _times(drive: Drive) -> str:
    return _lines([f"{second:.6e}" for second in drive.seconds])


def _row(matrix: Floats) -> str:
    return " ".join(f"{value:.12e}" for value in matrix.ravel())


def _lines(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"
