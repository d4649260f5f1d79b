# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads calibration files: KITTI's ``key: numbers`` texts and calib.yaml of plain folders."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.files import PathLike, read_yaml, reading
from fusionslam.errors import DataError, naming
from fusionslam.geometry.rigid import check_mounting
from fusionslam.sensors.frame import Camera

CAMERA_KEYS = ("projection", "rectified_from_points", "size")
ON_ROBOT = "robot_from_points"
"""Key of calib.yaml that says where the scanner is on the robot."""


@checked
@dataclass(frozen=True)
class Calibration:
    """A KITTI calibration file: the text after each key, parsed as numbers on access."""

    path: Path
    entries: Mapping[str, str]

    def numbers(self, key: str, count: int) -> NDArray[np.float64]:
        """float64 (count): the numbers of a key.

        Raises:
            DataError: the key is missing, or its text is not that many numbers.
        """
        if key not in self.entries:
            present = ", ".join(self.entries) or "nothing"
            raise DataError(
                f"{self.path} lacks {key} ({count} numbers): it has {present}",
                code="calibration-key",
                fields=(str(self.path), key),
            )
        with reading(self.path, f"{count} numbers behind {key}"):
            values = np.array(self.entries[key].split(), dtype=np.float64)
        if len(values) != count:
            raise DataError(f"{self.path}: {key} has {len(values)} numbers, expected {count}")
        return values

    def matrix(self, key: str, rows: int, columns: int) -> NDArray[np.float64]:
        """float64 (rows, columns): the numbers of a key, row by row; raises as ``numbers``."""
        return self.numbers(key, rows * columns).reshape(rows, columns)

    def transform(self, *keys: str) -> NDArray[np.float64]:
        """float64 (4, 4) of [R t] in one key, or of R and t in two; raises as ``numbers``."""
        if len(keys) == 1:
            return homogeneous(self.matrix(keys[0], 3, 4))
        rotation, translation = keys
        return homogeneous(np.hstack([self.matrix(rotation, 3, 3), self.matrix(translation, 3, 1)]))


@checked
def read_calibration(path: PathLike) -> Calibration:
    """Read KITTI's calib.txt, calib_cam_to_cam.txt or calib_velo_to_cam.txt.

    Raises:
        DataError: the file is missing or is not text.
    """
    path = Path(path)
    with reading(path, "KITTI calibration, lines of 'key: numbers'"):
        lines = path.read_text(encoding="utf-8").splitlines()
    pairs = (line.partition(":") for line in lines)
    return Calibration(path, {key.strip(): text for key, colon, text in pairs if colon})


def homogeneous(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """float64 (4, 4): homogeneous form of a (3, 3) rotation or a (3, 4) matrix [R t]."""
    result = np.eye(4)
    result[: matrix.shape[0], : matrix.shape[1]] = matrix
    return result


def camera(
    path: Path,
    projection: Any,
    rectified_from_points: Any,
    size: tuple[int, int] | None = None,
) -> Camera:
    """Make a ``Camera``; errors name the file.

    Raises:
        DataError: a matrix has the wrong shape, is not finite or is singular.
    """
    with naming(path):
        return Camera(projection, rectified_from_points, size)


def rectified_camera(
    calibration: Calibration, number: int, rectified_from_points: NDArray[np.float64]
) -> Camera:
    """The camera of a number of KITTI raw or KITTI-360, with its size. Raises as ``numbers``."""
    width, height = calibration.numbers(f"S_rect_{number:02d}", 2)
    projection = calibration.matrix(f"P_rect_{number:02d}", 3, 4)
    return camera(calibration.path, projection, rectified_from_points, (int(width), int(height)))


@checked
def read_calib_yaml(path: PathLike) -> dict[str, Camera]:
    """Read a calib.yaml; returns its cameras by name, in the order of the file.

    Each camera (``left``, ``right``, or any other name) has ``projection`` (12 numbers or three
    rows of four) and, optionally, ``rectified_from_points`` (16 numbers or four rows of four;
    default: identity) and ``size`` ([width, height]).

    Raises:
        DataError: the file is missing or not YAML, a key is unknown or missing, or a value has
            the wrong shape; or a camera's name cannot be that of a folder.
    """
    path, cameras = Path(path), {}
    for name, value in _calib_yaml(path).items():
        if name == ON_ROBOT:
            continue
        entry = {"rectified_from_points": np.eye(4), **_mapping(path, name, value, CAMERA_KEYS)}
        if "projection" not in entry:
            raise DataError(f"{path}: {name} lacks projection (12 numbers)")
        size = None
        if "size" in entry:
            width, height = _array(path, f"{name}.size", entry["size"], (2,))
            size = (int(width), int(height))
        projection, transform = (
            _array(path, f"{name}.{key}", entry[key], shape)
            for key, shape in (("projection", (3, 4)), ("rectified_from_points", (4, 4)))
        )
        cameras[name] = camera(path, projection, transform, size)
    return cameras


def read_place_on_robot(path: PathLike) -> NDArray[np.float64] | None:
    """Read ``robot_from_points`` of a calib.yaml: float64 (4, 4), or None if it is not there.

    The robot's frame has x ahead, y to the left, z up, and its origin on the ground.

    Raises:
        DataError: as ``read_calib_yaml``, or the matrix is no rotation and translation.
    """
    path, entries = Path(path), _calib_yaml(Path(path))
    if ON_ROBOT not in entries:
        return None
    matrix = _array(path, ON_ROBOT, entries[ON_ROBOT], (4, 4))
    with naming(path):
        check_mounting(ON_ROBOT, matrix)
    return matrix


def _calib_yaml(path: Path) -> dict[str, Any]:
    with reading(path, f"YAML with cameras by name, such as left and right, or {ON_ROBOT}"):
        content = read_yaml(path)
    entries = _mapping(path, "the file", content, None)
    for name in entries:
        if not re.fullmatch(r"(?!points$)\w[\w.-]*", name):
            raise DataError(
                f"{path}: camera '{name}' cannot be called so: expected letters, digits, _ - and .",
                code="camera-name",
                fields=(str(path), name),
            )
    return entries


def _mapping(path: Path, name: str, value: Any, keys: tuple[str, ...] | None) -> dict[str, Any]:
    """The value if it is a mapping with no other keys than these; None allows any."""
    if not isinstance(value, dict):
        expected = ", ".join(keys) if keys else f"left, right or other cameras, {ON_ROBOT}"
        raise DataError(f"{path}: {name} is no mapping, expected keys {expected}")
    if keys and (unknown := [str(key) for key in value if key not in keys]):
        raise DataError(
            f"{path}: {name} has unknown key {', '.join(unknown)}, expected {', '.join(keys)}"
        )
    return {str(key): entry for key, entry in value.items()}


def _array(path: Path, key: str, value: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    expected = f"{key} to be {' x '.join(map(str, shape))} numbers"
    with reading(path, expected):
        return np.asarray(value, dtype=np.float64).reshape(shape)
