# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``ViewRun``: one method's view ids on one drive, with all that a report needs."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import check_types, load_archive, save_archive
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, read_numbers
from fusionslam.errors import ShapeError
from fusionslam.evaluation.views.curve import ViewCurve
from fusionslam.evaluation.views.judge import (
    judge_views,
    validate_ids,
    validate_poses,
    validate_stamps,
)
from fusionslam.evaluation.views.report import ViewReport
from fusionslam.evaluation.views.rules import ViewRule
from fusionslam.sensors.frame import Cloud

FORMAT = "fusionslam.view_run.1"
_PER_SCAN = ("similarities", "build_seconds", "match_seconds", "known", "others")
_ARRAYS = ("ids", "poses", "stamps", "numbers", *_PER_SCAN)
_TEXTS = ("world", "method", "threshold", "bytes_per_view", "config", "held_back")


@checked
@dataclass(frozen=True, eq=False)
class ViewRun:
    """The ids that one method gave to the scans of one drive, and their cost.

    Attributes:
        world: name of the drive; runs over the same drive share a table.
        method: name of the method.
        ids, poses, stamps: int64 (n,), float64 (n, 3), float64 (n,) as ``judge_views`` takes them.
        numbers: int64 (n,), scan numbers in the recording; None for 0 .. n - 1.
        similarities: float64 (n,), to the best stored view; NaN if none was compared.
        threshold: the smallest similarity that matches; None if there is no such number.
        build_seconds: float64 (n,), wall time to make a view of each scan.
        match_seconds: float64 (n,), wall time to compare each scan with all stored views.
        known: float64 (n,), where odometry was used: probability of the most probable place.
        others: float64 (n,), likewise, of all other places; what is left is that of a new one.
        held_back: [row, reason] of each ambiguous scan.
        bytes_per_view: mean size of a stored view.
        curve: the same method at other thresholds.
        config: the configuration, in types that JSON can hold.
        images: scan number -> uint8 (H, W, 3) RGB or (H, W); neither saved nor
            sent to other processes.
        clouds: scan number -> its cloud in the robot's frame (x forward, z up); neither saved
            nor sent.

    Raises:
        ShapeError, DataError: as ``judge_views``; or an array of another length.
    """

    world: str
    method: str
    ids: NDArray[np.int64]
    poses: Floats
    stamps: Floats
    numbers: NDArray[np.int64] = None  # type: ignore[assignment]
    similarities: Floats | None = None
    threshold: float | None = None
    build_seconds: Floats | None = None
    match_seconds: Floats | None = None
    known: Floats | None = None
    others: Floats | None = None
    held_back: list[Any] = field(default_factory=list)
    bytes_per_view: float | None = None
    curve: ViewCurve | None = None
    config: dict[str, Any] = field(default_factory=dict)
    images: Callable[[int], NDArray[np.uint8]] | None = None
    clouds: Callable[[int], Cloud] | None = None

    def __post_init__(self) -> None:
        poses = validate_poses(self.poses)
        count = len(poses)
        numbers = np.arange(count) if self.numbers is None else self.numbers
        changes: dict[str, Any] = {
            "poses": poses,
            "ids": validate_ids(self.ids, count),
            "stamps": validate_stamps(self.stamps, count),
            "numbers": validate_ids(numbers, count),
        }
        for name in _PER_SCAN:
            values = getattr(self, name)
            if values is not None:
                array = changes[name] = read_numbers(name, values, f"({count},)")
                if array.shape != (count,):
                    raise ShapeError(
                        f"{name}: {array.shape}, expected ({count},): one value a scan"
                    )
        for name, value in changes.items():
            object.__setattr__(self, name, value)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "images": None, "clouds": None}

    def __len__(self) -> int:
        return len(self.poses)

    def judge(self, rule: str | ViewRule = "paper") -> ViewReport:
        """Judge the ids."""
        return judge_views(self.ids, self.poses, self.stamps, rule=rule)

    @property
    def pair_seconds(self) -> Floats | None:
        """Float64 (n,): match_seconds per stored view, NaN while none is stored.

        The stored views are the first scenes of each id, as in the thesis.
        """
        if self.match_seconds is None:
            return None
        _, first = np.unique(self.ids, return_index=True)
        starts = np.zeros(len(self), dtype=np.int64)
        starts[first[self.ids[first] >= 0]] = 1
        stored = np.cumsum(starts) - starts
        return np.where(stored > 0, self.match_seconds / np.maximum(stored, 1), np.nan)

    @property
    def build_ms(self) -> float | None:
        """Mean milliseconds to make a view; None if not timed."""
        return _mean_ms(self.build_seconds)

    @property
    def match_ms(self) -> float | None:
        """Mean milliseconds to compare a scan with all stored views; None if not timed."""
        return _mean_ms(self.match_seconds)

    @property
    def pair_ms(self) -> float | None:
        """Mean of ``pair_seconds`` in milliseconds; None if not timed."""
        return _mean_ms(self.pair_seconds)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one .npz, whole or not at all. Raises DataError if that fails."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        about = {name: getattr(self, name) for name in _TEXTS}
        about["curve"] = self.curve.as_json() if self.curve else None
        save_archive(path, FORMAT, about, arrays, compress=True)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "ViewRun":
        """Read what ``save`` wrote.

        Raises:
            DataError: the file is missing, truncated or of another kind; the message names it.
        """
        with load_archive(path, FORMAT, "a stored view run") as (about, arrays):
            curve = about["curve"]
            about["curve"] = ViewCurve.from_json(curve) if curve else None
            kept = {name: array for name, array in arrays.items() if name in _ARRAYS}
            return check_types(cls(**{**about, **kept}))


def _mean_ms(seconds: Floats | None) -> float | None:
    known = np.empty(0) if seconds is None else seconds[np.isfinite(seconds)]
    return float(known.mean() * 1e3) if known.size else None
