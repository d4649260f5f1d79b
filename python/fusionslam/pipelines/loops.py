# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find the loops of a whole recording as a robot would: frame after frame."""

import csv
import os
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import DescriptorRun
from fusionslam.help_texts import counted
from fusionslam.loop_closure.detector import Loop, LoopConfig, LoopDetector
from fusionslam.storage.files import atomic_path

COLUMNS = ("query", "match", "distance", "query_stamp_ns", "match_stamp_ns")


@dataclass(frozen=True, eq=False)
class LoopReport:
    """Loops of a run at one threshold.

    Attributes:
        run: the descriptors that were compared.
        config: threshold and window.
        loops: accepted loops; query and match are rows of the run.
        without_candidates: number of queries without any candidate to compare with.
        best: smallest distance to a candidate; None if no query had one.
        seconds: float64 (N,), time to search and to store each frame.
    """

    run: DescriptorRun
    config: LoopConfig
    loops: list[Loop]
    without_candidates: int
    best: float | None
    seconds: NDArray[np.float64]

    def __str__(self) -> str:
        rejected = len(self.run) - self.without_candidates - len(self.loops)
        parts = [
            f"{self.without_candidates} without candidates",
            f"{rejected} above threshold {self.config.threshold:.4g}",
        ]
        if self.best is not None:
            parts.append(f"best {self.best:.4g}")
        found = f"{counted(len(self.loops), 'loop')} in {counted(len(self.run), 'query')}"
        return f"{found}: {', '.join(parts)}{self._remedy()}"

    def _remedy(self) -> str:
        """Return advice for a run that is too short for the window, else an empty string."""
        queries, window = len(self.run), self.config.window
        if self.without_candidates < queries or not 0 < queries <= window + 1:
            return ""
        return (
            f"; frames are compared with those {window} and more before them, and there are "
            f"{queries}: --set loop_closure.window={queries // 4}"
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV with one line per loop and the numbers of the frames. Raises DataError."""
        numbers, stamps = self.run.numbers, self.run.stamps_ns
        with atomic_path(path) as temporary, temporary.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            for loop in self.loops:
                pair = [loop.query, loop.match]
                writer.writerow([*numbers[pair], f"{loop.distance:.9g}", *stamps[pair]])


def find_loops(
    run: DescriptorRun,
    config: LoopConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> LoopReport:
    """Pass the descriptors of a run to a loop detector, one after the other.

    ``progress`` is called with (frames done, total frames) from time to time.
    """
    length = run.descriptors.shape[1]
    detector = LoopDetector(run.descriptor, config=config, length=length)
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
    return LoopReport(
        run=run,
        config=detector.config,
        loops=loops,
        without_candidates=len(run) - len(distances),
        best=min(distances, default=None),
        seconds=np.array(seconds),
    )
