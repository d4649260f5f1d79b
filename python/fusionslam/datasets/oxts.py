# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses from the GPS/IMU records of KITTI raw, ``oxts/data/*.txt``, as its devkit makes them."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.streams import Stream
from fusionslam.errors import DataError
from fusionslam.storage.arrays import Floats, Matrix
from fusionslam.storage.files import reading

EARTH_RADIUS_M = 6378137.0
FIELDS = (
    *("lat", "lon", "alt", "roll", "pitch", "yaw", "vn", "ve", "vf", "vl", "vu"),
    *("ax", "ay", "az", "af", "al", "au", "wx", "wy", "wz", "wf", "wl", "wu"),
    *("pos_accuracy", "vel_accuracy", "navstat", "numsats", "posmode", "velmode", "orimode"),
)
"""Numbers of a record, as in oxts/dataformat.txt of the data: degrees, metres, radians first."""
_POSE = len(("lat", "lon", "alt", "roll", "pitch", "yaw"))
_LARGEST = {"lat": 90.0, "lon": 180.0}


def read_oxts(records: Stream, numbers: NDArray[np.int64]) -> Matrix:
    """Poses of the IMU at frames, float64 (N, 4, 4), NaN for those without a record.

    They are relative to the first record of the drive: its x axis ahead, y to the left, z up.

    Args:
        records: the files by frame number.
        numbers: int64 (N), of the frames.

    Raises:
        DataError: a record is cut or garbled; the message names the file and the field.
    """
    first = min(records.files)
    known = np.array([number in records.files for number in numbers.tolist()], dtype=bool)
    wanted = [first, *numbers[known].tolist()]
    poses = oxts_poses(np.array([_read_record(records.files[number]) for number in wanted]))
    found = np.full((len(numbers), 4, 4), np.nan)
    found[known] = poses[1:]
    return found


def oxts_poses(records: Floats) -> Matrix:
    """Poses relative to the first, first_from_imu, of latitude, longitude, altitude and angles.

    Positions are in Mercator's projection of a sphere, scaled by the cosine of the first latitude
    (devkit of Geiger, Lenz, Stiller, Urtasun 2013). The earth being flattened, distances at KITTI's
    latitude come out 0.2 % too short from west to east and 0.1 % too long from south to north.

    Args:
        records: float64 (N, 6), N > 0: degrees, degrees, metres, and roll, pitch, yaw in radians.

    Returns:
        float64 (N, 4, 4).
    """
    from scipy.spatial.transform import Rotation

    latitude, longitude = np.radians(records[:, :2]).T
    scale = EARTH_RADIUS_M * np.cos(latitude[0])
    east, north = scale * longitude, scale * np.log(np.tan(np.pi / 4 + latitude / 2))
    poses = np.tile(np.eye(4), (len(records), 1, 1))
    poses[:, :3, 3] = np.stack([east, north, records[:, 2]], axis=1)
    poses[:, :3, :3] = Rotation.from_euler("ZYX", records[:, 5:2:-1]).as_matrix()
    return np.asarray(np.linalg.inv(poses[0]) @ poses)


def _read_record(path: Path) -> Floats:
    """Read the first six numbers of a record: float64 (6,)."""
    with reading(path, f"{len(FIELDS)} numbers of a GPS/IMU record"):
        texts = path.read_text(encoding="ascii").split()
    if len(texts) != len(FIELDS):
        raise DataError(
            f"{path} has {len(texts)} numbers, expected {len(FIELDS)} of a GPS/IMU record",
            code="truncated",
            fields=(str(path), str(len(texts))),
        )
    return np.array(
        [_value(path, name, text) for name, text in zip(FIELDS[:_POSE], texts, strict=False)]
    )


def _value(path: Path, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    largest = _LARGEST.get(name, np.inf)
    # At a pole Mercator's projection is infinite.
    if not np.isfinite(value) or abs(value) > largest or (name == "lat" and abs(value) == largest):
        limit = "a number" if np.isinf(largest) else f"degrees from -{largest:g} to {largest:g}"
        raise DataError(
            f"{path}: {name} is {text!r}, expected {limit}",
            code="damaged-file",
            fields=(str(path), name),
        )
    return value
