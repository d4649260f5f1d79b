# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Keyframes of a map that look like something, or that are near a place."""

from collections.abc import Sequence

import numpy as np

from fusionslam.config import merged
from fusionslam.descriptors import find_descriptor
from fusionslam.loop_closure.detector import LoopDetector, Observation
from fusionslam.loop_closure.memory import FrameMemory, Vectors
from fusionslam.loop_closure.verification import StoredFrame
from fusionslam.mapping.clouds import FileClouds
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import MapFile
from fusionslam.storage.arrays import Matrix


class KeyframeSearch:
    """Searches all keyframes of a map, the newest ones included.

    Args:
        file: with the vectors, which are read when they are asked for.
        content: of the map.
        detector: with the configuration.
        kept: clouds of the keyframes.
    """

    def __init__(
        self, file: MapFile, content: MapContent, detector: LoopDetector, kept: FileClouds
    ) -> None:
        self._file, self._content = file, content
        self._detector, self._kept = detector, kept
        self._searched: FrameMemory | None = None

    def nearest(self, vectors: Vectors) -> dict[int, float]:
        """Return the nearest keyframes of each descriptor, and their distances."""
        found: dict[int, float] = {}
        for pairs in self._memory.query(vectors, self._detector.config.candidates, None).values():
            found |= {match: far for match, far in pairs if match not in found}
        return found

    def stored(self, number: int) -> StoredFrame:
        """Return a keyframe as the verification of loops takes it."""
        return self._memory.frame(number)

    def map_from_cloud(self, number: int) -> Matrix:
        """Return the pose of a keyframe, float64 (4, 4)."""
        return self._content.pose(number)

    def part(self, number: int) -> int:
        """Return the number of the first keyframe in a keyframe's part of the map."""
        return self._content.part(number)

    def near(self, place: Matrix, radius: float, keyframe: int) -> Sequence[int]:
        """Return the keyframes this near to a pose in a keyframe's part, the nearest first."""
        return self._content.near(place, radius, keyframe)

    def add(self, number: int, seen: Observation) -> None:
        """Take in a keyframe that the file has by now."""
        if self._searched is not None:
            self._searched.add(number, seen.vectors, seen.stamp_ns, np.inf, None)

    @property
    def _memory(self) -> FrameMemory:
        """Vectors of all keyframes, without a window."""
        if self._searched is None:
            vectors, own = self._file.vectors(), self._detector.descriptor
            names = [own, *(name for name in vectors if name != own)]
            metrics = {name: find_descriptor(name.split(",")[0]).metric for name in names}
            loops = merged(self._detector.config, {"window": 0, "window_seconds": 0.0})
            lengths = self._detector.registration_config
            self._searched = FrameMemory(metrics, loops, lengths, self._kept)
            numbers = self._content.numbers
            rows = {name: vectors[name][1] for name in names}
            self._searched.resume(rows, numbers, np.zeros(len(numbers), np.int64))
        return self._searched
