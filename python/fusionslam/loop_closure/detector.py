# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Online loop detection: one ``add`` per frame says whether the place was seen before."""

import logging
import math
import operator
import os
import threading
from collections.abc import Collection, Mapping, MutableMapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import load_archive, save_archive
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Matrix
from fusionslam.base.texts import counted
from fusionslam.config import merged
from fusionslam.descriptors import (
    DescriptorConfig,
    find_descriptor,
    for_preset,
    length_of,
    with_preset,
)
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.fusion import FusionConfig
from fusionslam.loop_closure.config import LoopConfig, default_threshold, fitted_threshold
from fusionslam.loop_closure.local_maps import RecentFrames
from fusionslam.loop_closure.loop import Loop, Rejected
from fusionslam.loop_closure.memory import FrameMemory, Kept
from fusionslam.loop_closure.observation import (
    FrameObserver,
    Observation,
    Vectors,
    can_verify,
    name_voter,
)
from fusionslam.loop_closure.verification import (
    PairComparisons,
    SequenceGate,
    StoredFrame,
    verify_candidates,
)
from fusionslam.registration import (
    RegistrationConfig,
    has_lengths,
    without_lengths,
)
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.sensors.scan_motion import ScanMotion

logger = logging.getLogger(__name__)

FORMAT = "fusionslam.loop_detector.4"
FILE = "detector.npz"


@checked
class LoopDetector:
    """Describes each frame, compares it with all older ones outside the window, and stores it.

    A loop is **verified** where the extra ``map`` is installed: clouds of the nearest frames, of
    several descriptors, are registered with the frame's, and the pose that fits makes the loop.
    Otherwise the nearest frame is a loop if its descriptor is nearer than ``threshold``.

    At ``max_frames`` stored frames it forgets a quarter: of those older than the window the ones
    whose nearest candidate, when they were added, was nearest. These show places that older frames
    show as well, so the first visit to a place is kept.

    Clouds that are verified are levelled by the ground they show or odometry, and narrow or sparse
    ones are joined with those of the frames before, by odometry (``RegistrationConfig.local_map``).
    The log says so. Frames that a local map is joined of are no candidates.

    Scans are taken as of one moment. Where points still have times (``Frame.point_seconds``: the
    motion meanwhile was not undone) and odometry is known, covariances of
    loops grow with the motion within both scans, and a warning says how far the robot turned.

    Threads may share a detector: frames are described side by side and added one after the other.

    Args:
        descriptor: name of one (``fusionslam.descriptors.NAMES``), or with a preset:
            "cm2dp:author".
        threshold, window, window_seconds, max_frames, verify, candidates: override the values of
            ``LoopConfig``.
        config: which frames are compared, and what makes a loop.
        describe: how clouds are described.
        fusion: how frames are fused into clouds.
        registration: how clouds are registered; method "planar" for a robot on a floor. Lengths
            that it does not give are fitted to how far the first cloud reaches (``fit_lengths``).
        length: length of descriptors computed elsewhere; None for that of ``descriptor``.

    Attributes:
        threshold: the configured threshold, else ``default_threshold``; of loops not verified.
            Infinity if loops are verified and none was fitted to the descriptor.
        nearest: the best candidate of the last frame, accepted or not; None without candidates.
        rejected: the candidates of the last frame that are no loop, and why not.
        unverified: number of submitted frames that were not verified, as others waited.

    Raises:
        ConfigError: unknown descriptor, a value out of range, or clouds in a frame that the
            descriptor is not for.
        FusionSlamError: ``verify`` is true and the extra ``map`` is not installed.
    """

    def __init__(
        self,
        descriptor: str = "cm2dp",
        *,
        threshold: float | None = None,
        window: int | None = None,
        window_seconds: float | None = None,
        max_frames: int | None = None,
        verify: bool | None = None,
        candidates: int | None = None,
        config: LoopConfig | None = None,
        describe: DescriptorConfig | None = None,
        fusion: FusionConfig | None = None,
        registration: RegistrationConfig | None = None,
        length: int | None = None,
    ) -> None:
        given = {
            "threshold": threshold,
            "window": window,
            "window_seconds": window_seconds,
            "max_frames": max_frames,
            "verify": verify,
            "candidates": candidates,
        }
        changes = {key: value for key, value in given.items() if value is not None}
        self.descriptor = find_descriptor(descriptor).name
        self.config = merged(config or LoopConfig(), changes, "loop_closure.")
        registration = registration or RegistrationConfig()
        self._observer = FrameObserver(
            {self.descriptor: descriptor},
            for_preset(describe or DescriptorConfig(), descriptor),
            fusion or FusionConfig(),
            registration,
            fits_lengths=not has_lengths(registration),
        )
        if can_verify(self.config, self.registration_config):
            self._observer = self._observer.verifying(self.config.voters)
        self.threshold = self._find_threshold()
        self.nearest: Loop | None = None
        self.rejected: list[Rejected] = []
        self._length = length
        self._added = 0
        self._kept: MutableMapping[int, Kept] | None = None
        self._memory = self._new_memory()
        self._gate = SequenceGate(self.config)
        self._recent = RecentFrames()
        self._motion = ScanMotion()
        self._lock = threading.RLock()
        self._pool: ThreadPoolExecutor | None = None
        self._submitted = self.unverified = 0

    def __repr__(self) -> str:
        name = with_preset(self.descriptor, self.describe_config)
        how = "verified" if self.verifies else f"threshold {self.threshold:.4g}"
        return (
            f"LoopDetector({name} of {self.fusion_config.source} clouds, {how}, "
            f"window {self.config.window}, "
            f"{counted(len(self), 'frame')} added, {len(self._memory)} stored)"
        )

    def __len__(self) -> int:
        """Number of frames added so far, forgotten ones included."""
        return self._added

    @property
    def describe_config(self) -> DescriptorConfig:
        """How clouds are described; the first one fixes lengths that are not given."""
        return self._observer.describe

    @property
    def fusion_config(self) -> FusionConfig:
        """How frames are fused into clouds."""
        return self._observer.fusion

    @property
    def registration_config(self) -> RegistrationConfig:
        """How clouds are registered; the first one fixes lengths that are not given."""
        return self._observer.registration

    @property
    def verifies(self) -> bool:
        """Whether loops are verified."""
        return self._observer.verifies

    @property
    def voters(self) -> tuple[str, ...]:
        """Descriptors whose nearest frames are candidates beside those of its own."""
        return self._observer.voters

    @property
    def frames(self) -> NDArray[np.int64]:
        """int64 (M,), ascending: the numbers of the frames that are stored."""
        with self._lock:
            return self._memory.numbers.copy()

    def add(
        self,
        frame_or_cloud: Frame | Cloud,
        *,
        stamp_ns: int | None = None,
        odometry: Matrix | None = None,
    ) -> Loop | None:
        """Find the loop that this frame closes, if any, and store the frame.

        Args:
            frame_or_cloud: a frame, or a cloud, metres, the sensor at the origin if loops are
                verified. It is levelled (``RegistrationConfig.gravity``).
            stamp_ns: of the frame if None.
            odometry: float64 (4, 4), odom_from_cloud; None for that of the frame, if it has any.
                One with NaN is unknown.

        Raises:
            DataError: a cloud that cannot be described, or odometry that is no rotation and
                translation (code "not-a-rotation"); nothing is stored.
            ShapeError: neither a frame nor a cloud.
        """
        return self._add(frame_or_cloud, stamp_ns, odometry)

    def _add(
        self,
        frame_or_cloud: Frame | Cloud,
        stamp_ns: int | None,
        odometry: Matrix | None,
        submitted: int | None = None,
    ) -> Loop | None:
        """Describe, store and verify a frame; not the last if too many were submitted after it."""
        # The first frame fixes lengths and the radius of all: others wait for it.
        with nullcontext() if len(self._memory) else self._lock:
            seen = self.observe(frame_or_cloud, stamp_ns=stamp_ns, odometry=odometry)
            pending = self._store(seen)
        if len(self._motion.turned) >= _SCANS_UNTIL_WARNING:
            self._motion.warn("the recording")
        if submitted is None or self._submitted - submitted <= _MOST_WAITING:
            return self._verify(pending)
        with self._lock:
            self.unverified += 1
            self.nearest, self.rejected = None, []
        return None

    def submit(
        self,
        frame_or_cloud: Frame | Cloud,
        *,
        stamp_ns: int | None = None,
        odometry: Matrix | None = None,
    ) -> "Future[Loop | None]":
        """``add`` in the background: it returns at once.

        Frames are taken in the order of submission. Each is described and stored; one that more
        than two others wait behind is not verified, so that answers stay recent (``unverified``
        counts them). Arguments as of ``add``, whose errors the future raises.

        Returns:
            The loop as soon as it is known.
        """
        with self._lock:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(1, thread_name_prefix="fusionslam-loops")
            self._submitted += 1
            number = self._submitted
            return self._pool.submit(self._add, frame_or_cloud, stamp_ns, odometry, number)

    def observe(
        self,
        frame_or_cloud: Frame | Cloud,
        *,
        stamp_ns: int | None = None,
        odometry: Matrix | None = None,
        before: RecentFrames | None = None,
    ) -> Observation:
        """Describe a frame for ``add_observation``; other threads and processes may do so.

        Arguments and errors as of ``add``.

        Args:
            frame_or_cloud, stamp_ns, odometry: of the frame.
            before: what the frames before tell; None for those that were added last.
        """
        return self._observer.observe(
            frame_or_cloud,
            stamp_ns=stamp_ns,
            odometry=odometry,
            is_first=not len(self._memory),
            before=self._recent if before is None else before,
        )

    def break_odometry(self) -> None:
        """Forget what the last frames told: odometry of the next says nothing of them."""
        with self._lock:
            self._recent.clear()

    @checked
    def add_observation(
        self,
        observation: Observation,
        *,
        excluded: Collection[int] = (),
        stretches: Mapping[int, int] | None = None,
    ) -> Loop | None:
        """``add`` for what ``observe`` returned, in the order of the frames.

        Args:
            observation: of the frame.
            excluded: numbers of stored frames that are no candidates, besides those of the window.
            stretches: number of the stretch of odometry by frame, this one included; loops confirm
                each other by odometry within one stretch. None: there is one.
        """
        return self._verify(self._store(observation, excluded), stretches)

    def add_descriptor(
        self, descriptor: NDArray[np.float32], *, stamp_ns: int | None = None
    ) -> Loop | None:
        """``add`` for a descriptor, float32 (D,), computed elsewhere: its loop is not verified.

        A descriptor of zeros, which describes nothing, takes a number, but it is not stored and
        matches nothing.

        Raises:
            ShapeError: another length than the descriptor's.
            ConfigError: the detector has verified loops, for which it needs clouds.
        """
        with self._lock:
            if self.verifies and len(self._memory):
                raise ConfigError(
                    "this detector verifies loops: it needs frames or clouds, or verify=False",
                    code="choice",
                    fields=("verify",),
                )
            if self.verifies:
                self._observer = replace(self._observer, verifies=False, voters=())
                self._memory = self._new_memory()
        return self._verify(self._store(Observation({self.descriptor: descriptor}, stamp_ns)))

    def _store(self, seen: Observation, excluded: Collection[int] = ()) -> "_Pending":
        """Store a frame; return what is left to be proven of it."""
        own = seen.vectors[self.descriptor]
        with self._lock:
            if not len(self._memory):  # the index would accept any length first
                length = self._length or length_of(self.descriptor, self.describe_config)
                if np.shape(own) != (length,):
                    given = "None" if own is None else f"shape {np.shape(own)}"
                    raise ShapeError(
                        f"descriptor: {given}, expected float32 ({length},) of {self.descriptor}"
                    )
            number = self._added
            if seen.piece is not None:
                # What both local maps show is not seen again.
                excluded = {*excluded, *self._recent.numbers_since(seen.joined, number)}
            seen.add_to(self._recent, number)
            k = self.config.candidates if self.verifies else 1
            found = self._memory.query(seen.vectors, k, seen.stamp_ns, excluded)
            if not np.any(own):
                self._added += 1
                return _Pending(number)
            if seen.cloud is not None and self._observer.fits_lengths:
                is_first = not len(self._memory)
                fixed = seen.cloud.config if is_first else self.registration_config
                self._observer = replace(self._observer, registration=fixed, fits_lengths=False)
                if is_first:
                    self._memory = self._new_memory()
            candidates = _flatten(found)
            # Before any of them is forgotten.
            stored = {match: self._memory.frame(match) for match in candidates}
            if seen.cloud is not None and seen.span is not None:
                self._motion.follow(seen.stamp_ns, seen.odometry)
                seen.cloud.moved = self._motion.within(seen.span)
            nearest = found[self.descriptor]
            self._memory.add(number, seen, nearest[0][1] if nearest else np.inf)
            self._added += 1
            if seen.fitted is not None:  # only now: a failed cloud must not fix anything
                self._observer = replace(self._observer, describe=seen.fitted)
            return _Pending(number, candidates, seen, stored)

    def _verify(
        self, pending: "_Pending", stretches: Mapping[int, int] | None = None
    ) -> Loop | None:
        """Prove the loop of a stored frame, or take the nearest one."""
        number, candidates, seen, stored = pending
        if seen is None or seen.cloud is None:
            best = None
            if candidates:
                match, distance = next(iter(candidates.items()))
                best = Loop(number, match, distance, match_stamp_ns=stored[match].stamp_ns)
            self.nearest, self.rejected = best, []
            return best if best is not None and best.distance <= self.threshold else None
        pairs = PairComparisons(seen.cloud, stored.__getitem__)
        found = verify_candidates(number, candidates, pairs, self.config)
        with self._lock:
            found = self._gate.decide(found, seen.odometry, stored.__getitem__, stretches)
            self.nearest, self.rejected = found
        return found.best if found.best is not None and found.best.reason is None else None

    def candidates(self, k: int = 10) -> list[tuple[int, float]]:
        """Return the k nearest candidates of the last frame among those stored, nearest first.

        Returns:
            (number of the frame, distance of the detector's descriptor) of each, whatever the
            threshold; none if the last descriptor was one of zeros.

        Raises:
            ConfigError: k < 1.
        """
        if operator.index(k) < 1:
            raise ConfigError(f"k is {k}, expected at least 1", code="choice", fields=("k", str(k)))
        with self._lock:
            numbers = self._memory.numbers
            if not len(numbers) or numbers[-1] != self._added - 1:
                return []
            return self._memory.candidates(k)

    @checked
    def resume(
        self,
        kept: MutableMapping[int, Kept],
        vectors: Vectors,
        numbers: NDArray[np.int64],
        stamps_ns: NDArray[np.int64],
    ) -> None:
        """Keep clouds elsewhere, as in a map's file, and go on from the frames that are there.

        Args:
            kept: clouds by number of the frame.
            vectors: float32 (n, D) by descriptor, as ``Observation.vectors`` names them.
            numbers: int64 (n,), ascending.
            stamps_ns: int64 (n,); 0 where unknown.
        """
        with self._lock:
            self._kept = kept
            self._memory = self._new_memory()
            if len(numbers):
                self._memory.resume(vectors, numbers, stamps_ns)
                self._added = int(numbers[-1]) + 1
                self._observer = replace(self._observer, fits_lengths=False)

    @checked
    def nearest_frames(self, vectors: Vectors) -> dict[int, float]:
        """Return the candidates of a frame that is not added, and their distances.

        Args:
            vectors: descriptors by name, as ``Observation.vectors``.
        """
        with self._lock:
            return _flatten(self._memory.query(vectors, self.config.candidates, None))

    def stored_frame(self, number: int) -> StoredFrame:
        """Return a frame that is stored, with its cloud."""
        with self._lock:
            return self._memory.frame(number)

    def limit_frames(self, max_frames: int) -> None:
        """Keep at most this many frames from now on, as ``LoopConfig.max_frames``."""
        with self._lock:
            self.config = merged(self.config, {"max_frames": max_frames}, "loop_closure.")
            self._memory.config = self.config

    def _find_threshold(self) -> float:
        if self.config.threshold is not None:
            return self.config.threshold
        kind = (self.descriptor, self.describe_config, self.fusion_config.source)
        if self.verifies and fitted_threshold(*kind) is None:
            return math.inf
        return default_threshold(*kind)

    def _new_memory(self) -> FrameMemory:
        metrics: dict[str, str] = {self.descriptor: find_descriptor(self.descriptor).metric}
        metrics |= {name_voter(name): find_descriptor(name).metric for name in self.voters}
        return FrameMemory(metrics, self.config, self.registration_config, self._kept)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Save the configuration and all that is stored to a folder, as one file.

        Raises:
            DataError: nothing was added yet, or the folder cannot be written.
        """
        about, arrays = self._state()
        if not len(self):
            raise DataError("the loop detector is empty: there is nothing to save", code="empty")
        save_archive(Path(folder) / FILE, FORMAT, about, arrays)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "LoopDetector":
        """Resume from what ``save`` wrote.

        Raises:
            DataError: the file is missing or damaged; the message names it.
            FusionSlamError: its loops are verified and the extra ``map`` is not installed.
        """
        path = Path(folder)
        if path.name != FILE or path.is_dir():
            path /= FILE
        with load_archive(path, FORMAT, "a stored loop detector") as (about, arrays):
            return cls._restored(about, arrays)

    def _state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the configuration and counts, ready for JSON, and the arrays by name."""
        with self._lock:
            about = {
                "descriptor": self.descriptor,
                "length": self._length,
                "frames": self._added,
                # A later version may fit another threshold.
                "loop_closure": self.config.model_dump()
                | {"threshold": self.threshold if math.isfinite(self.threshold) else None},
                "verifies": self.verifies,
                "descriptors": self.describe_config.model_dump(),
                "fusion": self.fusion_config.model_dump(),
                "registration": (
                    without_lengths(self.registration_config)
                    if self._observer.fits_lengths
                    else self.registration_config.model_dump()
                ),
            }
            return about, self._memory.to_arrays()

    @classmethod
    def _restored(
        cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> "LoopDetector":
        """Make a detector of what ``_state`` returned.

        Raises:
            ConfigError, DataError, ShapeError: values or arrays that contradict each other.
        """
        config = merged(LoopConfig(), about["loop_closure"])
        detector = cls(
            about["descriptor"],
            verify=about["verifies"],
            config=config,
            describe=merged(DescriptorConfig(), about["descriptors"]),
            fusion=merged(FusionConfig(), about["fusion"]),
            registration=merged(RegistrationConfig(), about["registration"]),
            length=about["length"],
        )
        detector.config = config
        detector._added = about["frames"]
        detector._memory.restore(arrays, detector._added)
        return detector

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the state: locks and indexes cannot be pickled."""
        return _unpickle, (type(self), *self._state(), self.nearest, self.rejected)


class _Pending(NamedTuple):
    """A stored frame whose loop is not yet known; what was seen of it is None if that is blank."""

    number: int
    candidates: Mapping[int, float] = {}
    seen: Observation | None = None
    stored: Mapping[int, StoredFrame] = {}


_SCANS_UNTIL_WARNING = 50
"""With times of points, after which is said how far the robot turned within them."""
_MOST_WAITING = 2
"""Submitted frames that may wait behind the one that is verified."""


def _flatten(found: Mapping[str, Sequence[tuple[int, float]]]) -> dict[int, float]:
    """Distances by candidate; of one that several descriptors propose, the first one's."""
    candidates: dict[int, float] = {}
    for pairs in found.values():  # those of the detector's own descriptor come first
        candidates |= {match: far for match, far in pairs if match not in candidates}
    return candidates


def _unpickle(
    kind: type[LoopDetector],
    about: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    nearest: Loop | None,
    rejected: list[Rejected],
) -> LoopDetector:
    detector = kind._restored(about, arrays)
    detector.nearest, detector.rejected = nearest, rejected
    return detector
