# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Keyframes of a map that look like something, or that are near a place."""

from collections.abc import Sequence

from fusionslam.loop_closure.detector import LoopDetector
from fusionslam.loop_closure.memory import Vectors
from fusionslam.loop_closure.verification import StoredFrame
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import MapFile, StoredCloud
from fusionslam.storage.arrays import Floats32, Integers, Matrix


class KeyframeSearch:
    """Searches all keyframes of a map, the newest ones included.

    Args:
        file: of the map.
        content: of the map.
        detector: with vectors and clouds of all keyframes, and without a window.
    """

    def __init__(self, file: MapFile, content: MapContent, detector: LoopDetector) -> None:
        self._file, self._content, self._detector = file, content, detector

    def nearest(self, vectors: Vectors) -> dict[int, float]:
        """Return the nearest keyframes of each descriptor, and their distances."""
        return self._detector.nearest_frames(vectors)

    def stored(self, number: int) -> StoredFrame:
        """Return a keyframe as the verification of loops takes it."""
        return self._detector.stored_frame(number)

    def stored_cloud(self, number: int) -> StoredCloud:
        """Return the packed clouds of a keyframe."""
        return self._file.cloud(number)

    def vectors(self) -> dict[str, tuple[Integers, Floats32]]:
        """Return the numbers of the keyframes, and their vectors, float32 (n, D), by descriptor."""
        return self._file.vectors()

    def map_from_cloud(self, number: int) -> Matrix:
        """Return the pose of a keyframe, float64 (4, 4)."""
        return self._content.pose(number)

    def part(self, number: int) -> int:
        """Return the number of the first keyframe in a keyframe's part of the map."""
        return self._content.part(number)

    def near(self, place: Matrix, radius: float, keyframe: int) -> Sequence[int]:
        """Return the keyframes this near to a pose in a keyframe's part, the nearest first."""
        return self._content.near(place, radius, keyframe)
