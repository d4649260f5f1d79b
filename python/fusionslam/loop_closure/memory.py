# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a loop detector keeps of frames: descriptors, and the clouds that prove loops."""

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import DescriptorIndex
from fusionslam.base.arrays import Matrix
from fusionslam.base.growing_array import Rows
from fusionslam.errors import DataError
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.observation import Observation, Vectors
from fusionslam.loop_closure.verification import StoredFrame
from fusionslam.registration import PreparedCloud, RegistrationConfig, SearchImage
from fusionslam.views.scene_set import pack_bytes, unpack_bytes

logger = logging.getLogger(__name__)

_UNPACKED = 64
"""Clouds that are kept ready; each takes some 2 MB, without its turned images."""
_COLUMNS = ("numbers", "stamps_ns", "novelty")
_UNKNOWN = np.full((4, 4), np.nan)


@dataclass(frozen=True)
class Kept:
    """What is kept of a frame: its packed cloud, images from above and odom_from_cloud."""

    packed: Callable[[], bytes]
    image: SearchImage | None
    odometry: Matrix | None


class FrameClouds:
    """Packed clouds of frames by their numbers; those used last are kept ready.

    Several threads may ask for them.

    Args:
        registration: how clouds were prepared.
        kept: where packed clouds are kept; None is in memory.
    """

    def __init__(
        self, registration: RegistrationConfig, kept: MutableMapping[int, Kept] | None = None
    ) -> None:
        self.registration = registration
        self.kept: MutableMapping[int, Kept] = {} if kept is None else kept
        self._ready: OrderedDict[int, PreparedCloud] = OrderedDict()
        self._lock = threading.Lock()

    def add(self, number: int, cloud: PreparedCloud, odometry: Matrix | None) -> None:
        """Keep the cloud of a frame, and odom_from_cloud, float64 (4, 4), if it is known."""
        packed = cloud.to_bytes()
        image = cloud.search_image if cloud.has_search_image else None
        self.kept[number] = Kept(lambda: packed, image, odometry)
        self._keep_ready(number, cloud)

    def frame(self, number: int, stamp_ns: int) -> StoredFrame:
        """Return a frame as it is verified."""
        kept = self.kept.get(number)
        if kept is None:
            return StoredFrame(stamp_ns, None, None, _no_cloud)
        return StoredFrame(stamp_ns, kept.odometry, kept.image, lambda: self._unpack(number, kept))

    def forget(self, but: set[int]) -> None:
        """Forget all frames but these."""
        for number in self.kept.keys() - but:
            del self.kept[number]
            self._ready.pop(number, None)

    def _unpack(self, number: int, kept: Kept) -> PreparedCloud:
        cloud = self._ready.get(number)
        if cloud is None:
            cloud = PreparedCloud.from_bytes(kept.packed(), self.registration)
        self._keep_ready(number, cloud)
        return cloud

    def _keep_ready(self, number: int, cloud: PreparedCloud) -> None:
        with self._lock:
            self._ready[number] = cloud
            self._ready.move_to_end(number)
            while len(self._ready) > _UNPACKED:
                self._ready.popitem(last=False)


class FrameMemory:
    """Descriptors of frames, searched exactly, and their clouds.

    Args:
        metrics: by descriptor; the first is the detector's own.
        config: which frames are candidates, and how many are kept.
        registration: how clouds were prepared.
        kept: where packed clouds are kept, by number of the frame; None is in memory.

    Attributes:
        config: of which the number of frames may change later.
    """

    def __init__(
        self,
        metrics: Mapping[str, str],
        config: LoopConfig,
        registration: RegistrationConfig,
        kept: MutableMapping[int, Kept] | None = None,
    ) -> None:
        self._metrics, self.config = metrics, config
        self._indexes: dict[str, DescriptorIndex] = {}
        self._numbers, self._stamps_ns = Rows(np.int64), Rows(np.int64)
        self._novelty = Rows(np.float32)
        self.clouds = FrameClouds(registration, kept)

    def __len__(self) -> int:
        return len(self._numbers)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """int64 (M,), ascending: numbers of the frames that are kept."""
        return self._numbers.all

    def query(
        self, vectors: Vectors, k: int, stamp_ns: int | None, excluded: Collection[int] = ()
    ) -> dict[str, list[tuple[int, float]]]:
        """Return the k nearest candidates of a new frame by descriptor: (number, distance).

        Numbers in ``excluded`` are none, besides those of the window. A descriptor of zeros, which
        describes nothing, has none, but is checked like any other.
        """
        found: dict[str, list[tuple[int, float]]] = {}
        for name, vector in vectors.items():
            index = self._indexes.get(name) or self._new_index(name, len(vector))
            is_blank = not np.any(vector)
            # Metrics of sets do not take zeros, a set of length zero.
            asked = np.ones_like(vector) if is_blank else vector
            rows, distances = index.query(asked, k=k + len(excluded), stamp_ns=stamp_ns)
            if is_blank:
                found[name] = []
                continue
            pairs = zip(self._numbers.all[rows].tolist(), distances.tolist(), strict=True)
            found[name] = [pair for pair in pairs if pair[0] not in excluded][:k]
        return found

    def candidates(self, k: int) -> list[tuple[int, float]]:
        """Return the k nearest candidates of the newest frame by the detector's own descriptor."""
        last = len(self) - 1
        index = self._indexes[next(iter(self._metrics))]
        # The index takes a query for the next frame, which has one candidate more.
        rows, distances = index.query(
            index.descriptor(last), k=min(k, last) + 1, stamp_ns=int(self._stamps_ns.all[last])
        )
        own = rows < last - self.config.window
        numbers = self._numbers.all[rows[own]].tolist()
        return [*zip(numbers, distances[own].tolist(), strict=True)][:k]

    def add(self, number: int, seen: Observation, novelty: float = np.inf) -> None:
        """Keep a frame; at the limit, forget a quarter."""
        for name, vector in seen.vectors.items():
            if name not in self._indexes:
                self._indexes[name] = self._new_index(name, len(vector))
            self._indexes[name].add(vector, stamp_ns=seen.stamp_ns)
        self._numbers.append(number)
        self._stamps_ns.append(seen.stamp_ns or 0)
        self._novelty.append(novelty)
        if seen.cloud is not None:
            self.clouds.add(number, seen.cloud, seen.odometry)
        config = self.config
        if config.max_frames and len(self) >= max(config.max_frames, 2 * config.window, 4):
            self._forget()

    def frame(self, number: int) -> StoredFrame:
        """Return a frame that is kept."""
        stamp_ns = int(self._stamps_ns.all[np.searchsorted(self._numbers.all, number)])
        return self.clouds.frame(number, stamp_ns)

    def _new_index(self, name: str, length: int) -> DescriptorIndex:
        config = self.config
        return DescriptorIndex(
            length,
            window=config.window,
            window_seconds=config.window_seconds,
            metric=self._metrics[name],
        )

    def _forget(self) -> None:
        """Forget a quarter of the frames: those outside the window that are most like older ones.

        The rebuilt index takes time in proportion to its size, but only once in as many frames as
        are forgotten.
        """
        count = len(self)
        # The index counts its window in rows, so none of the newest may be forgotten; nor the last
        # frame, whose candidates may be asked for.
        old = count - max(self.config.window, 1)
        # Of equally novel frames the newest goes first.
        order = np.lexsort((-np.arange(old), self._novelty.all[:old]))
        rows = np.sort(np.append(order[count // 4 :], np.arange(old, count)))
        columns = [column[rows] for column in self._columns()]
        self.resume({name: self._vectors(name, rows) for name in self._indexes}, *columns)
        self.clouds.forget(but=set(self.numbers.tolist()))
        logger.info("%d of %d stored frames are forgotten", count // 4, count)

    def _columns(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        return self._numbers.all, self._stamps_ns.all, self._novelty.all

    def _vectors(self, name: str, rows: Iterable[int]) -> NDArray[np.float32]:
        index = self._indexes[name]
        return np.array([index.descriptor(int(row)) for row in rows], np.float32)

    def resume(
        self,
        vectors: Vectors,
        numbers: NDArray[np.int64],
        stamps_ns: NDArray[np.int64],
        novelty: NDArray[np.float32] | None = None,
    ) -> None:
        """Go on from frames whose clouds are kept already.

        Args:
            vectors: float32 (n, D) by descriptor, of all frames.
            numbers: int64 (n,), ascending.
            stamps_ns: int64 (n,); 0 where unknown.
            novelty: float32 (n,), distance of each frame's nearest candidate; None for infinity.
        """
        self._indexes = {}
        for name, rows in vectors.items():
            if not len(rows):
                continue
            index = self._indexes[name] = self._new_index(name, rows.shape[1])
            for vector, stamp in zip(rows, stamps_ns.tolist(), strict=True):
                index.add(vector, stamp_ns=stamp)
        self._numbers, self._stamps_ns = Rows.of(numbers), Rows.of(stamps_ns)
        unknown = np.full(len(numbers), np.inf, np.float32)
        self._novelty = Rows.of(unknown if novelty is None else novelty)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything as arrays by name, for ``restore``."""
        arrays: dict[str, NDArray[Any]] = {
            name: column.copy() for name, column in zip(_COLUMNS, self._columns(), strict=True)
        }
        for name in self._indexes:
            arrays[_array_of(name, self._metrics)] = self._vectors(name, range(len(self)))
        if self.clouds.kept:
            kept = [self.clouds.kept[number] for number in self.numbers.tolist()]
            arrays["clouds"], arrays["offsets"] = pack_bytes([each.packed() for each in kept])
            arrays["odometry"] = np.array(
                [_UNKNOWN if each.odometry is None else each.odometry for each in kept]
            )
            images = [each.image for each in kept if each.image is not None]
            if images:
                arrays["images"] = np.array([np.frombuffer(each.bits, np.uint8) for each in images])
                arrays["levels"] = np.array([each.ground_level for each in images])
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]], count: int) -> None:
        """Replace what is kept by what ``to_arrays`` returned, of ``count`` added frames.

        Raises:
            DataError, ShapeError: arrays that contradict each other.
            KeyError: one is missing.
        """
        vectors = {
            name: arrays[_array_of(name, self._metrics)]
            for name in self._metrics
            if _array_of(name, self._metrics) in arrays
        }
        columns = [arrays[name] for name in _COLUMNS]
        numbers = columns[0]
        counts = [len(rows) for rows in (*vectors.values(), *columns)]
        if len(set(counts)) > 1:
            raise DataError(f"{', '.join([*vectors, *_COLUMNS])} of {counts} frames")
        if (np.diff(numbers, prepend=-1, append=count) <= 0).any():
            raise DataError(f"the numbers of the frames do not ascend from 0 to {count - 1}")
        self.resume(vectors, *columns)
        self.clouds.kept = _kept_of(arrays, numbers) if "clouds" in arrays else {}


def _no_cloud() -> PreparedCloud:
    raise DataError("a frame without a cloud cannot be registered", code="no-cloud")


def _array_of(name: str, metrics: Mapping[str, str]) -> str:
    """Name of the array of a descriptor's vectors; the detector's own has none of its own."""
    return "descriptors" if name == next(iter(metrics)) else f"descriptors.{name}"


def _kept_of(arrays: Mapping[str, NDArray[Any]], numbers: NDArray[np.int64]) -> dict[int, Kept]:
    clouds = unpack_bytes(arrays["clouds"], arrays["offsets"])
    images: Sequence[SearchImage | None] = [None] * len(clouds)
    if "images" in arrays:
        levels = arrays["levels"].tolist()
        rows = zip(arrays["images"], levels, strict=True)
        images = [SearchImage(bits.tobytes(), level) for bits, level in rows]
    poses = [None if np.isnan(pose).any() else pose for pose in arrays["odometry"]]
    if not len(clouds) == len(images) == len(poses) == len(numbers):
        raise DataError(
            f"clouds, images and odometry of {len(clouds)}, {len(images)} and {len(poses)} frames "
            f"of {len(numbers)}"
        )
    every = zip(numbers.tolist(), clouds, images, poses, strict=True)
    return {
        number: Kept(partial(bytes, cloud), image, pose) for number, cloud, image, pose in every
    }
