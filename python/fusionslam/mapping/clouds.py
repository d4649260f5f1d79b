# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of keyframes as a map's file holds them."""

from collections.abc import Iterator, MutableMapping
from typing import Any

from numpy.typing import NDArray

from fusionslam._core import voxel_downsample
from fusionslam.base.arrays import Matrix
from fusionslam.loop_closure.memory import Kept
from fusionslam.mapping.map_file import MapFile, StoredCloud
from fusionslam.registration import SearchImage
from fusionslam.registration.clouds import pack_arrays, pack_points, unpack_points, unpacking
from fusionslam.sensors.frame import Cloud


def pack_cloud(cloud: Cloud, voxel: float) -> bytes:
    """Compress one point, and colour, for each voxel; coordinates to 8 mm."""
    points, colors, _ = voxel_downsample(cloud.points, cloud.colors, size=voxel)
    arrays: dict[str, NDArray[Any]] = {"points": pack_points(points)}
    if cloud.colors is not None:
        arrays["colors"] = colors
    return pack_arrays(arrays)


def unpack_cloud(packed: bytes) -> Cloud:
    """Return the cloud that ``pack_cloud`` packed.

    Raises:
        DataError: the bytes are damaged.
    """
    with unpacking(packed) as arrays:
        return Cloud(unpack_points(arrays["points"]), arrays.get("colors"))


class FileClouds(MutableMapping[int, Kept]):
    """The packed clouds of a map's keyframes, read from its file when they are asked for.

    That of a new frame waits here until ``take`` has it for the file.
    """

    def __init__(self, file: MapFile, odometry: MutableMapping[int, Matrix]) -> None:
        self._file, self._odometry = file, odometry
        self._new: dict[int, Kept] = {}

    def __getitem__(self, number: int) -> Kept:
        if number in self._new:
            return self._new[number]
        if number not in self._odometry:
            raise KeyError(number)
        stored = self._file.cloud(number)
        image = None if stored.image is None else SearchImage(stored.image, stored.ground_level)
        return Kept(lambda: self._file.cloud(number).evidence, image, self._odometry[number])

    def __setitem__(self, number: int, kept: Kept) -> None:
        self._new[number] = kept

    def __delitem__(self, number: int) -> None:
        self._new.pop(number, None)

    def __iter__(self) -> Iterator[int]:
        return iter({**self._odometry, **self._new})

    def __len__(self) -> int:
        return len({**self._odometry, **self._new})

    def take(self, number: int, points: bytes, ground_level: float) -> StoredCloud:
        """Return the clouds of a new frame for the file."""
        kept = self._new[number]
        bits = None if kept.image is None else kept.image.bits
        return StoredCloud(kept.packed(), bits, ground_level, points)

    def written(self) -> None:
        """Forget the new frames' clouds: the file has them."""
        self._new.clear()
