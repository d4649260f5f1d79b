# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find the loops of a whole recording as a robot would: frame after frame."""

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.csv_files import write_csv
from fusionslam.base.texts import counted, listed
from fusionslam.config import merged
from fusionslam.descriptors import PRESETS, DescriptorConfig, in_file_names
from fusionslam.evaluation import DescriptorRun
from fusionslam.fusion import FusionConfig
from fusionslam.loop_closure import Loop, LoopConfig, LoopDetector
from fusionslam.loop_closure.config import fitted_threshold

_FEWEST = 20
"""Fewer frames show one place: with a shorter window each would be its neighbour's loop."""
_FAR = 2.0
"""No threshold is advised beyond this multiple of the fitted one: its loops would be wrong."""
COLUMNS = ("query", "match", "distance", "query_stamp_ns", "match_stamp_ns")


@dataclass(frozen=True, eq=False)
class LoopReport:
    """Loops of a run at one threshold.

    Attributes:
        run: the descriptors that were compared.
        config: of the detector.
        threshold: largest distance that was accepted.
        loops: accepted loops; query and match are rows of the run.
        without_candidates: number of queries without any candidate to compare with.
        blank: int64 (M,), numbers of the frames whose descriptor is zero, which match nothing.
        best: smallest distance to a candidate; None if no query had one.
        seconds: float64 (N,), time to search and to store each frame.
    """

    run: DescriptorRun
    config: LoopConfig
    threshold: float
    loops: list[Loop]
    without_candidates: int
    blank: NDArray[np.int64]
    best: float | None
    seconds: NDArray[np.float64]

    @property
    def threshold_of_nearest(self) -> float | None:
        """A threshold that accepts the nearest candidate of all, to two digits; None without one.

        It is above 0 even if the nearest is at 0.
        """
        if self.best is None:
            return None
        step = 10.0 ** (math.floor(math.log10(max(self.best, 1e-9))) - 1)
        return float(f"{math.ceil(self.best / step + 1e-6) * step:.2g}")

    def __repr__(self) -> str:
        return f"<LoopReport of {self.run!r}: {self}>"

    def __str__(self) -> str:
        compared = len(self.run) - self.without_candidates - len(self.blank)
        rejected = compared - len(self.loops)
        parts = [
            f"{self.without_candidates} without candidates",
            f"{rejected} above threshold {self.threshold:.4g}",
        ]
        if self.best is not None:
            parts.append(f"best {self.best:.4g}")
        if len(self.blank):
            parts.append(f"{len(self.blank)} with a descriptor of zeros: {listed(self.blank)}")
        found = f"{counted(len(self.loops), 'loop')} in {counted(len(self.run), 'query')}"
        return f"{found}: {', '.join(parts)}{self._remedy()}"

    def _remedy(self) -> str:
        """Return advice for a run in which nothing is found, else an empty string."""
        queries, window = len(self.run), self.config.window
        if (nearest := self.threshold_of_nearest) is not None and not self.loops:
            known = fitted_threshold(self.run.descriptor, _preset_of(self.run), self.run.source)
            if nearest > _FAR * max(known or 0, self.threshold):
                return explain_nothing(window, self.run.descriptor)
            return (
                f"; --threshold {nearest:.2g} accepts the nearest, --threshold FOLDER takes the "
                "one that was right in a stored bench"
            )
        compared = queries - self.without_candidates - len(self.blank)
        return explain_shortness(queries, compared, window)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV with one line per loop and the numbers of the frames. Raises DataError."""
        numbers, stamps = self.run.numbers, self.run.stamps_ns
        rows = (
            [*numbers[pair], f"{loop.distance:.9g}", *stamps[pair]]
            for loop in self.loops
            for pair in [[loop.query, loop.match]]
        )
        write_csv(Path(path), COLUMNS, rows)


def explain_shortness(frames: int, compared: int, window: int) -> str:
    """Say, as the end of a line, that there are too few frames for the window, if they are.

    Args:
        frames, compared: number of frames, and of those that have candidates.
        window: of the loop detector, frames.
    """
    if 0 < frames < _FEWEST:
        return f"; too few frames for loops, {frames}"
    if compared or not 0 < frames <= window + 1:
        return ""
    return (
        f"; frames are compared with those {window} and more before them, and there are "
        f"{frames}: --set loop_closure.window={frames // 4}"
    )


def explain_nothing(window: int, descriptor: str) -> str:
    """Say, as the end of a line, why no loop of a whole recording may be found."""
    return (
        f"; no frame looks like one {window} or more before it: nothing comes back, or "
        f"{descriptor} cannot tell (bench compares descriptors)"
    )


def _preset_of(run: DescriptorRun) -> DescriptorConfig:
    return merged(DescriptorConfig(), {"preset": run.preset or PRESETS[0]})


def loops_path(folder: Path, descriptor: str | None = None) -> Path:
    """Return the file of a folder's loops; with the descriptor's name if there are several."""
    return folder / (
        "loops.csv" if descriptor is None else f"loops-{in_file_names(descriptor)}.csv"
    )


def find_loops(
    run: DescriptorRun,
    config: LoopConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> LoopReport:
    """Pass the descriptors of a run to a loop detector, one after the other.

    ``progress`` is called with (frames done, total frames) from time to time.
    """
    detector = LoopDetector(
        run.descriptor,
        config=config,
        describe=_preset_of(run),
        fusion=merged(FusionConfig(), {"source": run.source}),
        length=run.descriptors.shape[1],
    )
    loops, distances, seconds = [], [], []
    for vector, stamp in zip(run.descriptors, run.stamps_ns.tolist(), strict=True):
        start = time.perf_counter()
        loop = detector.add_descriptor(vector, stamp_ns=stamp)
        seconds.append(time.perf_counter() - start)
        if detector.nearest is not None:
            distances.append(detector.nearest.distance)
        if loop is not None:
            loops.append(loop)
        if progress is not None and (len(seconds) % 100 == 0 or len(seconds) == len(run)):
            progress(len(seconds), len(run))
    blank = run.numbers[~run.descriptors.any(axis=1)]
    return LoopReport(
        run=run,
        config=detector.config,
        threshold=detector.threshold,
        loops=loops,
        without_candidates=len(run) - len(distances) - len(blank),
        blank=blank,
        best=min(distances, default=None),
        seconds=np.array(seconds),
    )
