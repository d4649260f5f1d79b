# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of keyframes as a map's file holds them."""

from collections.abc import Iterator, Mapping, MutableMapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import voxel_downsample
from fusionslam.base.arrays import Floats, Matrix
from fusionslam.loop_closure.memory import Kept
from fusionslam.mapping.map_file import MapFile, StoredCloud
from fusionslam.registration import SearchImage
from fusionslam.registration.clouds import pack_arrays, pack_points, unpack_points, unpacking
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Span

_LONGEST_S = 1.0
"""Of a scan; times that are farther from the stamp are of another clock."""
_SHORTEST_S = 1e-6
_TICKS = 255


class Sweep(NamedTuple):
    """When a keyframe's points were measured, and what is undone of the motion meanwhile.

    Attributes:
        span: seconds from the stamp to the first and to the last point.
        moved: float64 (2, 6), small motions of the cloud's frame from the stamp to these points,
            which are undone in the cloud; None if the points are as measured.
    """

    span: Span
    moved: Floats | None


def pack_cloud(cloud: Cloud, voxel: float, sweep: Sweep | None = None) -> bytes:
    """Compress one point, and colour, for each voxel; coordinates to 8 mm, times to 1/255 sweep.

    Args:
        cloud: in the frame of the keyframe.
        voxel: metres.
        sweep: of the cloud, if the times of its points are known.
    """
    points, colors, first = voxel_downsample(cloud.points, cloud.colors, size=voxel)
    arrays: dict[str, NDArray[Any]] = {"points": pack_points(points)}
    if cloud.colors is not None:
        arrays["colors"] = colors
    if sweep is not None and cloud.seconds is not None:
        start, end = sweep.span
        shares = ((cloud.seconds[first] - start) / (end - start)).clip(0, 1)
        arrays |= {"ticks": np.rint(_TICKS * shares).astype(np.uint8), "span": np.array(sweep.span)}
        if sweep.moved is not None:
            arrays["undone"] = sweep.moved
    return pack_arrays(arrays)


def unpack_cloud(packed: bytes) -> tuple[Cloud, Sweep | None]:
    """Return what ``pack_cloud`` packed.

    Raises:
        DataError: the bytes are damaged.
    """
    with unpacking(packed) as arrays:
        cloud = Cloud(unpack_points(arrays["points"]), arrays.get("colors"))
        if not arrays.keys() & {"ticks", "span", "undone"}:
            return cloud, None
        ticks, span = _read_ticks(arrays, len(cloud))
        seconds: Floats = span[0] + (span[1] - span[0]) / _TICKS * ticks.astype(np.float64)
        return Cloud(cloud.points, cloud.colors, seconds=seconds), Sweep(span, arrays.get("undone"))


def _read_ticks(arrays: Mapping[str, NDArray[Any]], count: int) -> tuple[NDArray[np.uint8], Span]:
    """Check what is stored of a sweep; ValueError of what ``pack_cloud`` does not write."""
    expected: dict[str, tuple[type, tuple[int, ...]]] = {
        "ticks": (np.uint8, (count,)),
        "span": (np.float64, (2,)),
    }
    if "undone" in arrays:
        expected["undone"] = (np.float64, (2, 6))
    for name, (dtype, shape) in expected.items():
        if name not in arrays:
            raise ValueError(f"times of its points lack {name}")
        array = arrays[name]
        if array.dtype != dtype or array.shape != shape or not np.isfinite(array).all():
            raise ValueError(
                f"{name} is {array.dtype} {array.shape}, expected finite {np.dtype(dtype)} {shape}"
            )
    start, end = arrays["span"].tolist()
    if not is_sweep((start, end)):
        raise ValueError(f"a sweep from {start} to {end} s, expected at most a second")
    return arrays["ticks"], (start, end)


def is_sweep(span: Span) -> bool:
    """Whether points of these times were measured one after another, about their stamp."""
    return span[1] - span[0] >= _SHORTEST_S and max(-span[0], span[1]) <= _LONGEST_S


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
