# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Online loop detection: one ``add`` per frame says whether the place was seen before."""

import logging
import operator
import os
import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam import help_texts
from fusionslam._core import DescriptorIndex
from fusionslam.config import Section, merged, option
from fusionslam.descriptors import (
    DescriptorConfig,
    describe,
    find_descriptor,
    for_clouds,
    for_preset,
    for_sequence,
    length_of,
    with_preset,
)
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.help_texts import counted
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.storage.archive import load_archive, load_json, save_archive
from fusionslam.storage.growing_array import Rows

logger = logging.getLogger(__name__)

FORMAT = "fusionslam.loop_detector.3"
FILE = "detector.npz"
_THRESHOLDS = Path(__file__).with_name("thresholds.yaml")
_COLUMNS = ("numbers", "stamps_ns", "novelty")
_FORMER_FORMAT, _FORMER_FILE = "fusionslam.loop_detector.2", "detector.json"


class LoopConfig(Section):
    """Conditions under which a nearest neighbour is a loop."""

    threshold: float | None = option(None, help_texts.THRESHOLD, ge=0, allow_inf_nan=False)
    window: int = option(50, help_texts.LOOP_WINDOW, unit="frames", ge=0)
    window_seconds: float = option(
        0.0, "candidates are older than this; 0 is off", unit="s", ge=0, allow_inf_nan=False
    )
    max_frames: int = option(
        100_000,
        "most frames kept for comparison; at this number a quarter is forgotten, of the frames "
        "outside the window those most like an older one; 0 is no limit",
        ge=0,
    )


def default_threshold(
    descriptor: str, describe: DescriptorConfig | None = None, source: str = "lidar"
) -> float:
    """Return the threshold that was fitted to a descriptor, its preset and a source of clouds.

    docs/stages/loop_closure.md says how, and how right the loops are that it accepts.

    Raises:
        ConfigError: unknown descriptor.
    """
    import yaml

    name = with_preset(descriptor, describe or DescriptorConfig())
    fitted = yaml.safe_load(_THRESHOLDS.read_text(encoding="utf-8"))
    return float(fitted[source][name])


@dataclass(frozen=True)
class Loop:
    """A loop: both frame numbers, in the order of adding, and their descriptor distance."""

    query: int
    match: int
    distance: float


class LoopDetector:
    """Describes each frame, compares it with all older ones outside the window, and stores it.

    At ``max_frames`` stored frames it forgets a quarter: of those older than the window the ones
    whose nearest candidate, when they were added, was nearest. These show places that older frames
    show as well, so the first visit to a place is kept.

    Threads may share a detector: frames are described side by side and added one after the other.

    Args:
        descriptor: "m2dp", "cm2dp", "shot", "cshot" or "scan_context", or with a preset:
            "cm2dp:author".
        threshold, window, window_seconds, max_frames: override the values of ``LoopConfig``.
        config: when a neighbour is a loop.
        describe: how clouds are described.
        fusion: how frames are fused into clouds.
        length: length of descriptors computed elsewhere; None for that of ``descriptor``.

    Attributes:
        threshold: the configured threshold, else ``default_threshold``.
        nearest: the nearest candidate of the last frame, accepted or not; None without candidates.

    Raises:
        ConfigError: unknown descriptor, a value out of range, or clouds in a frame that the
            descriptor is not for.
    """

    def __init__(
        self,
        descriptor: str = "cm2dp",
        *,
        threshold: float | None = None,
        window: int | None = None,
        window_seconds: float | None = None,
        max_frames: int | None = None,
        config: LoopConfig | None = None,
        describe: DescriptorConfig | None = None,
        fusion: FusionConfig | None = None,
        length: int | None = None,
    ) -> None:
        given = {
            "threshold": threshold,
            "window": window,
            "window_seconds": window_seconds,
            "max_frames": max_frames,
        }
        changes = {key: value for key, value in given.items() if value is not None}
        self.descriptor = find_descriptor(descriptor).name
        self.config = merged(config or LoopConfig(), changes, "loop_closure.")
        self.describe_config = for_preset(describe or DescriptorConfig(), descriptor)
        self.fusion_config = fusion or FusionConfig()
        for_clouds(self.describe_config, self.descriptor, self.fusion_config)  # else it fails later
        fixed, source = self.config.threshold, self.fusion_config.source
        self.threshold = (
            default_threshold(self.descriptor, self.describe_config, source)
            if fixed is None
            else fixed
        )
        self.nearest: Loop | None = None
        self._index: DescriptorIndex | None = None
        self._length = length
        self._added = 0
        self._numbers, self._stamps_ns = Rows(np.int64), Rows(np.int64)
        self._novelty = Rows(np.float32)
        self._lock = threading.RLock()

    def __repr__(self) -> str:
        name = with_preset(self.descriptor, self.describe_config)
        return (
            f"LoopDetector({name} of {self.fusion_config.source} clouds, "
            f"threshold {self.threshold:.4g}, window {self.config.window}, "
            f"{counted(len(self), 'frame')} added, {len(self._numbers)} stored)"
        )

    def __len__(self) -> int:
        """Number of frames added so far, forgotten ones included."""
        return self._added

    @property
    def frames(self) -> NDArray[np.int64]:
        """int64 (M,), ascending: the numbers of the frames that are stored."""
        with self._lock:
            return self._numbers.all.copy()

    def add(self, frame_or_cloud: Frame | Cloud, *, stamp_ns: int | None = None) -> Loop | None:
        """Find the loop that this frame closes, if any, and store the frame.

        Raises:
            DataError: a cloud that cannot be described; nothing is stored.
            ShapeError: neither a frame nor a cloud.
        """
        if isinstance(frame_or_cloud, Frame):
            stamp_ns = frame_or_cloud.stamp_ns if stamp_ns is None else stamp_ns
            cloud = fuse(frame_or_cloud, self.fusion_config)
        elif isinstance(frame_or_cloud, Cloud):
            cloud = frame_or_cloud
        else:
            raise ShapeError(f"expected a Frame or a Cloud, got {type(frame_or_cloud).__name__}")
        if find_descriptor(self.descriptor).needs_normals:
            with self._lock:
                if not len(self):
                    return self._add_first(cloud, stamp_ns)
        frame = frame_or_cloud if isinstance(frame_or_cloud, Frame) else None
        config = for_clouds(self.describe_config, self.descriptor, self.fusion_config, frame)
        vector = describe(cloud, self.descriptor, config)
        return self.add_descriptor(vector, stamp_ns=stamp_ns)

    def _add_first(self, cloud: Cloud, stamp_ns: int | None) -> Loop | None:
        """Add the cloud that fixes the radius for normals."""
        config = for_sequence(self.describe_config, cloud)
        vector = describe(cloud, self.descriptor, config)
        loop = self.add_descriptor(vector, stamp_ns=stamp_ns)
        self.describe_config = config  # only now: a failed cloud must not fix the radius
        return loop

    def add_descriptor(
        self, descriptor: NDArray[np.float32], *, stamp_ns: int | None = None
    ) -> Loop | None:
        """``add`` for a descriptor, float32 (D,), computed elsewhere.

        A descriptor of zeros, which describes nothing, takes a number, but it is not stored and
        matches nothing.

        Raises:
            ShapeError: another length than the descriptor's.
        """
        with self._lock:
            index = self._index
            if index is None:
                self._check_length(descriptor)
                index = self._new_index(len(descriptor))
            rows, distances = index.query(descriptor, stamp_ns=stamp_ns)
            self._index = index  # only now: a failed first descriptor must not fix the length
            if not np.any(descriptor):
                self._added, self.nearest = self._added + 1, None
                return None
            index.add(descriptor, stamp_ns=stamp_ns)
            found = None
            if len(rows):
                match = int(self._numbers.all[rows[0]])
                found = Loop(self._added, match, float(distances[0]))
            self._note(self._added, stamp_ns, np.inf if found is None else found.distance)
            self.nearest = found
            if 0 < self._limit <= len(index):
                self._forget()
        return found if found and found.distance <= self.threshold else None

    def candidates(self, k: int = 10) -> list[tuple[int, float]]:
        """Return the k nearest candidates of the last frame among those stored, nearest first.

        Returns:
            (number of the frame, descriptor distance) of each, whatever the threshold; none if the
            last descriptor was one of zeros.

        Raises:
            ConfigError: k < 1.
        """
        if operator.index(k) < 1:
            raise ConfigError(f"k is {k}, expected at least 1", code="choice", fields=("k", str(k)))
        with self._lock:
            last = len(self._numbers) - 1
            if self._index is None or last < 0 or self._numbers.all[last] != self._added - 1:
                return []
            # The index takes a query for the next frame, which has one candidate more.
            rows, distances = self._index.query(
                self._index.descriptor(last),
                k=min(k, last) + 1,
                stamp_ns=int(self._stamps_ns.all[last]),
            )
            own = rows < last - self.config.window
            numbers = self._numbers.all[rows[own]]
        return [*zip(numbers.tolist(), distances[own].tolist(), strict=True)][:k]

    @property
    def _limit(self) -> int:
        """The number of stored frames at which a quarter is forgotten; 0 is no limit."""
        config = self.config
        return max(config.max_frames, 2 * config.window, 4) if config.max_frames else 0

    def _new_index(self, length: int) -> DescriptorIndex:
        config = self.config
        return DescriptorIndex(
            length,
            window=config.window,
            window_seconds=config.window_seconds,
            metric=find_descriptor(self.descriptor).metric,
        )

    def _note(self, number: int, stamp_ns: int | None, novelty: float) -> None:
        self._numbers.append(number)
        self._stamps_ns.append(stamp_ns or 0)
        self._novelty.append(novelty)
        self._added = number + 1

    def _forget(self) -> None:
        """Forget a quarter of the frames: those outside the window that are most like older ones.

        The rebuilt index takes time in proportion to its size, but only once in as many frames as
        are forgotten.
        """
        count = len(self._numbers)
        # The index counts its window in rows, so none of the newest may be forgotten; nor the last
        # frame, whose candidates may be asked for.
        old = count - max(self.config.window, 1)
        # Of equally novel frames the newest goes first.
        order = np.lexsort((-np.arange(old), self._novelty.all[:old]))
        rows = np.sort(np.append(order[count // 4 :], np.arange(old, count)))
        self._restore(self._descriptors(rows), *(each[rows] for each in self._columns()))
        logger.info("%d of %d stored frames are forgotten", count // 4, count)

    def _columns(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        return self._numbers.all, self._stamps_ns.all, self._novelty.all

    def _descriptors(self, rows: Iterable[int]) -> Iterator[NDArray[np.float32]]:
        for row in rows:
            assert self._index is not None  # else there are no rows
            yield self._index.descriptor(int(row))

    def _restore(
        self,
        descriptors: Iterable[NDArray[np.float32]],
        numbers: NDArray[np.int64],
        stamps_ns: NDArray[np.int64],
        novelty: NDArray[np.float32],
    ) -> None:
        """Replace what is stored."""
        index = None
        for descriptor, stamp in zip(descriptors, stamps_ns.tolist(), strict=True):
            index = self._new_index(len(descriptor)) if index is None else index
            index.add(descriptor, stamp_ns=stamp)
        self._index = index
        self._restore_columns(numbers, stamps_ns, novelty)

    def _restore_columns(
        self,
        numbers: NDArray[np.int64],
        stamps_ns: NDArray[np.int64],
        novelty: NDArray[np.float32],
    ) -> None:
        self._numbers, self._stamps_ns = Rows.of(numbers), Rows.of(stamps_ns)
        self._novelty = Rows.of(novelty)

    def _check_length(self, descriptor: Any) -> None:
        """Raise ShapeError for a wrong length; the index would accept any length first."""
        length = self._length or length_of(self.descriptor, self.describe_config)
        shape = np.shape(descriptor)
        if shape != (length,):
            found = "None" if descriptor is None else f"shape {shape}"
            raise ShapeError(
                f"descriptor: {found}, expected float32 ({length},) of {self.descriptor}"
            )

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Save the configuration and all descriptors to a folder, as one file.

        Raises:
            DataError: nothing was added yet, or the folder cannot be written.
        """
        self.save_with(folder, {})

    def save_with(self, folder: str | os.PathLike[str], more: Mapping[str, NDArray[Any]]) -> None:
        """``save``, with more arrays in the same file; their names must differ from its own."""
        about, arrays = self._state()
        if not len(self):
            raise DataError("the loop detector is empty: there is nothing to save", code="empty")
        save_archive(Path(folder) / FILE, FORMAT, about, {**arrays, **more})
        for pattern in (_FORMER_FILE, "descriptors-*.index*", ".descriptors-*.index*"):
            for old in Path(folder).glob(pattern):  # of former versions
                old.unlink(missing_ok=True)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "LoopDetector":
        """Resume from what ``save`` wrote, in this version or an earlier one.

        Raises:
            DataError: the file is missing or damaged; the message names it.
        """
        return cls.load_with(folder)[0]

    @classmethod
    def load_with(
        cls, folder: str | os.PathLike[str]
    ) -> "tuple[LoopDetector, dict[str, NDArray[Any]]]":
        """``load``, and all arrays in the same file. Raises as ``load``."""
        source = Path(folder)
        if source.name == FILE and source.is_file():
            source = source.parent
        if (source / _FORMER_FILE).exists() and not (source / FILE).exists():
            return cls._load_former(source), {}
        with load_archive(source / FILE, FORMAT, "a stored loop detector") as (about, arrays):
            return cls._restored(about, arrays), arrays

    @classmethod
    def _load_former(cls, source: Path) -> "LoopDetector":
        """Read the two files of earlier versions: JSON, and an index whose name it holds."""
        with load_json(source / _FORMER_FILE, _FORMER_FORMAT, "a stored loop detector") as about:
            detector = cls._configured(about)
        path = source / Path(str(about.get("index"))).name
        index = DescriptorIndex.load(path)
        count = len(index)
        if count != about.get("frames"):
            raise DataError(
                f"{source}: {count} descriptors, {_FORMER_FILE} says {about.get('frames')}"
            )
        stamps_ns = np.fromfile(path, np.int64, count, offset=48)  # which an index does not return
        novelty = np.full(count, np.inf, np.float32)  # was not stored
        detector._index, detector._added = index, count
        detector._restore_columns(np.arange(count), stamps_ns, novelty)
        return detector

    @classmethod
    def _configured(cls, about: Mapping[str, Any]) -> "LoopDetector":
        return cls(
            about["descriptor"],
            config=merged(LoopConfig(), about["loop_closure"]),
            describe=merged(DescriptorConfig(), about["descriptors"]),
            fusion=merged(FusionConfig(), about["fusion"]),
            length=about.get("length"),
        )

    def _state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the configuration and counts, ready for JSON, and the arrays by name."""
        with self._lock:
            about = {
                "descriptor": self.descriptor,
                "length": self._length,
                "frames": self._added,
                # A later version may fit another threshold.
                "loop_closure": self.config.model_dump() | {"threshold": self.threshold},
                "descriptors": self.describe_config.model_dump(),
                "fusion": self.fusion_config.model_dump(),
            }
            vectors = [*self._descriptors(range(len(self._numbers)))]
            columns = (each.copy() for each in self._columns())
            arrays = dict(zip(_COLUMNS, columns, strict=True))
        return about, {"descriptors": np.array(vectors, np.float32), **arrays}

    @classmethod
    def _restored(
        cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> "LoopDetector":
        """Make a detector of what ``_state`` returned.

        Raises:
            ConfigError, DataError, ShapeError: values or arrays that contradict each other.
        """
        detector = cls._configured(about)
        columns = [arrays[name] for name in _COLUMNS]
        vectors, numbers, count = arrays["descriptors"], columns[0], about["frames"]
        counts = [len(vectors), *(len(column) for column in columns)]
        if len(set(counts)) > 1:
            raise DataError(f"descriptors, {', '.join(_COLUMNS)} of {counts} frames")
        if (np.diff(numbers, prepend=-1, append=count) <= 0).any():
            raise DataError(f"the numbers of the frames do not ascend from 0 to {count - 1}")
        detector._added = count
        detector._restore(vectors, *columns)
        return detector

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the state: locks and indexes cannot be pickled."""
        return _unpickle, (type(self), *self._state(), self.nearest)


def _unpickle(
    kind: type[LoopDetector],
    about: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    nearest: Loop | None,
) -> LoopDetector:
    detector = kind._restored(about, arrays)
    detector.nearest = nearest
    return detector
