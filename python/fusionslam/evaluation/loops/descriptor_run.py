# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``DescriptorRun``: what ``describe`` stores for one descriptor, cloud source and sequence."""

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import check_types, join_parts, load_archive, part_of, save_archive
from fusionslam.base.argument_types import checked
from fusionslam.base.texts import counted
from fusionslam.errors import ShapeError
from fusionslam.evaluation.loops.nearest_matches import validate_descriptors

FORMAT = "fusionslam.descriptor_run.2"
_TEXTS = ("source", "descriptor", "dataset", "peak_memory_bytes", "config", "skipped", "recorded")


@checked
@dataclass(frozen=True, eq=False)
class DescriptorRun:
    """One descriptor on one cloud source over one sequence.

    Attributes:
        source: "lidar" (LiDAR-camera fusion), "stereo" or "cloud" (clouds that come with colours).
        descriptor: "m2dp", "cm2dp", "shot", "cshot", ...
        dataset: name of the dataset.
        descriptors: float32 (N, D), one row per frame, in order of time.
        frames: int64 (N,), indices into the dataset.
        stamps_ns: int64 (N,), nanoseconds.
        poses: float64 (N, 4, 4), world_from_body, or None without ground truth.
        seconds: wall time by stage ("load", "fuse", "describe", "match"), float64 (N,) each.
        peak_memory_bytes: memory needed to describe the largest cloud, beyond what was in use.
        points: int64 (N,), number of points described.
        config: the effective configuration, in types that JSON can hold.
        numbers: int64 (N,), frame numbers of the file names; None takes those of ``frames``.
        skipped: number -> reason, for frames left out because they cannot be described.
        recorded: number of frames of the whole recording; None if unknown.

    Raises:
        ShapeError: an array whose shape does not fit the descriptors'.
        DataError: descriptors that are not finite.
    """

    source: str
    descriptor: str
    dataset: str
    descriptors: NDArray[np.float32]
    frames: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64] | None
    seconds: dict[str, NDArray[np.float64]]
    peak_memory_bytes: int
    points: NDArray[np.int64]
    config: dict[str, Any] = field(default_factory=dict)
    numbers: NDArray[np.int64] = None  # type: ignore[assignment]
    skipped: dict[int, str] = field(default_factory=dict)
    recorded: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "descriptors", validate_descriptors(self.descriptors))
        count = len(self)
        if self.numbers is None:
            object.__setattr__(self, "numbers", self.frames)
        for name in ("frames", "stamps_ns", "points", "numbers"):
            _check_shape(name, getattr(self, name), (count,))
        for stage, seconds in self.seconds.items():
            _check_shape(f"seconds[{stage!r}]", seconds, (count,))
        if self.poses is not None:
            _check_shape("poses", self.poses, (count, 4, 4))

    def __repr__(self) -> str:
        poses = "without" if self.poses is None else "with"
        return (
            f"<DescriptorRun of {self.dataset}: {self.name}, {self.source} clouds, "
            f"{counted(len(self), 'frame')}, {poses} poses>"
        )

    def __len__(self) -> int:
        return len(self.descriptors)

    @property
    def preset(self) -> str | None:
        """The descriptor's preset; None if it has none."""
        from fusionslam.descriptors import DESCRIPTORS

        kind = DESCRIPTORS.get(self.descriptor)
        return self.config.get("descriptors", {}).get("preset") if kind and kind.presets else None

    @property
    def metric(self) -> str:
        """How two of the descriptors are compared: "l2", or their kind's metric.

        Raises:
            ConfigError: a user's own descriptor that this program was not told of.
        """
        from fusionslam.descriptors import DESCRIPTORS, find_descriptor, find_own, is_own

        name = self.descriptor
        known = name in DESCRIPTORS or is_own(name) or find_own(name) is not None
        return find_descriptor(name).metric if known else "l2"

    @property
    def name(self) -> str:
        """The descriptor with its preset, if it is not the default one: "cm2dp:author"."""
        from fusionslam.descriptors import PRESETS

        known = self.preset in (None, PRESETS[0])
        return self.descriptor if known else f"{self.descriptor}:{self.preset}"

    @property
    def positions(self) -> NDArray[np.float64] | None:
        """float64 (N, 3), metres, in the world frame; None without ground truth."""
        return None if self.poses is None else self.poses[:, :3, 3]

    def only(self, rows: NDArray[np.int64]) -> "DescriptorRun":
        """The run of the frames in some rows, int64 (M,)."""
        changes: dict[str, Any] = {name: getattr(self, name)[rows] for name in _ARRAYS}
        seconds = {stage: values[rows] for stage, values in self.seconds.items()}
        poses = None if self.poses is None else self.poses[rows]
        return replace(self, **changes, seconds=seconds, poses=poses)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one .npz, whole or not at all. Raises DataError if that fails."""
        arrays = {name: getattr(self, name) for name in (*_ARRAYS, "poses")}
        arrays |= join_parts({"seconds": self.seconds})
        save_archive(path, FORMAT, {name: getattr(self, name) for name in _TEXTS}, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "DescriptorRun":
        """Read what ``save`` wrote.

        Raises:
            DataError: the file is missing, truncated or of another kind; the message names it.
        """
        with load_archive(path, FORMAT, "a stored descriptor run") as (about, stored):
            about["skipped"] = {int(number): why for number, why in about["skipped"].items()}
            arrays: dict[str, Any] = {
                name: stored[name].astype(kind, copy=False) for name, kind in _ARRAYS.items()
            }
            seconds, poses = part_of(stored, "seconds"), stored.get("poses")
            return check_types(cls(**about, **arrays, seconds=seconds, poses=poses))


_ARRAYS: dict[str, type[np.generic]] = {
    "descriptors": np.float32,
    "frames": np.int64,
    "stamps_ns": np.int64,
    "points": np.int64,
    "numbers": np.int64,
}


def _check_shape(name: str, array: NDArray[Any], expected: tuple[int, ...]) -> None:
    if np.shape(array) != expected:
        raise ShapeError(f"{name}: shape {np.shape(array)}, expected {expected}")
