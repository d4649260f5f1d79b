# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of keyframes as a map's file holds them."""

from collections.abc import Iterator, Mapping, MutableMapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import voxel_downsample
from fusionslam.base.arrays import Floats, Matrix
from fusionslam.loop_closure.memory import Kept
from fusionslam.mapping.map_file import MapFile, StoredCloud
from fusionslam.registration import SearchImage
from fusionslam.registration.clouds import pack_arrays, pack_points, unpack_points, unpacking
from fusionslam.sensors.frame import Cloud

_LONGEST_S, _SHORTEST_S = 1.0, 1e-6
"""Of a scan. Times farther from the stamp are of another clock."""
_TICKS = 255


def pack_cloud(cloud: Cloud, voxel: float) -> bytes:
    """Compress one point, and colour, for each voxel; coordinates to 8 mm.

    Times of points, where they are known, are kept to 1/255 of the scan.

    Args:
        cloud: in the frame of the keyframe.
        voxel: metres.
    """
    points, colors, _ = voxel_downsample(cloud.points, cloud.colors, size=voxel)
    arrays: dict[str, NDArray[Any]] = {"points": pack_points(points)}
    if cloud.colors is not None:
        arrays["colors"] = colors
    if cloud.seconds is not None and len(points):
        seconds = cloud.seconds
        start, end = float(seconds.min()), float(seconds.max())  # NaN fails the comparison
        if end - start >= _SHORTEST_S and max(-start, end) <= _LONGEST_S:
            ticks = np.rint(_TICKS * (seconds - start) / (end - start)).astype(np.uint8)
            # A point is the mean of its voxel, and so is its time, as if it were a colour.
            _, mean, _ = voxel_downsample(cloud.points, ticks[:, None].repeat(3, 1), size=voxel)
            arrays |= {"ticks": mean[:, 0].copy(), "span": np.array([start, end])}
    return pack_arrays(arrays)


def unpack_cloud(packed: bytes) -> Cloud:
    """Return the cloud that ``pack_cloud`` packed.

    Raises:
        DataError: the bytes are damaged.
    """
    with unpacking(packed) as arrays:
        points = unpack_points(arrays["points"])
        return Cloud(points, arrays.get("colors"), seconds=_unpack_seconds(arrays, len(points)))


def _unpack_seconds(arrays: Mapping[str, NDArray[Any]], count: int) -> Floats | None:
    """Return float64 (N,), times of points; None without; ValueError of what is not stored so."""
    ticks, span = arrays.get("ticks"), arrays.get("span")
    if ticks is None and span is None:
        return None
    if ticks is None or ticks.dtype != np.uint8 or ticks.shape != (count,):
        raise ValueError(f"ticks of {count} points: expected uint8 ({count},)")
    if span is None or span.dtype != np.float64 or span.shape != (2,):
        raise ValueError("the span of its ticks is missing: expected float64 (2,)")
    start, end = span.tolist()
    if not (end - start >= _SHORTEST_S and max(-start, end) <= _LONGEST_S):
        raise ValueError(f"a scan from {start} to {end} s, expected a second at most")
    seconds: Floats = start + (end - start) / _TICKS * ticks.astype(np.float64)
    return seconds


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
