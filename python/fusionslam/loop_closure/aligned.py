# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Loops found by descriptors, with the relative pose from aligning their clouds."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusionslam.errors import DataError
from fusionslam.loop_closure.detector import Loop, LoopDetector
from fusionslam.sensors.frame import Cloud
from fusionslam.storage.archive import load_archive, save_archive
from fusionslam.views.alignment_comparison import align_scenes
from fusionslam.views.scene_set import pack_bytes, unpack_bytes
from fusionslam.views.scenes import Scene, build_scene

FORMAT = "fusionslam.aligned_loops.1"
_SCENES = "scenes.npz"


@dataclass(frozen=True)
class AlignedLoop:
    """A loop, and the robot's pose relative to the earlier visit.

    Attributes:
        loop: numbers of both clouds, and the distance of their descriptors.
        match_stamp_ns: stamp of the older cloud.
        probability: probability that the aligned clouds show the same place, 0 if they lie farther
            apart than the alignment allows; None if they have too little content to be aligned.
        pose: x, y in metres and yaw in radians of the newer cloud in the frame of the older one;
            None with ``probability``.
    """

    loop: Loop
    match_stamp_ns: int
    probability: float | None = None
    pose: tuple[float, float, float] | None = None


class AlignedLoopDetector:
    """A ``LoopDetector`` that also stores each cloud's range image, to align the clouds of a loop.

    Each cloud takes the memory of its descriptor and about 1 kB.

    Args:
        detector: a new or resumed detector.
    """

    def __init__(self, detector: LoopDetector) -> None:
        self.detector = detector
        self._stored: list[bytes] = []
        self._stamps_ns: list[int] = []

    def __len__(self) -> int:
        """Number of clouds added so far."""
        return len(self.detector)

    def add(self, cloud: Cloud, stamp_ns: int) -> AlignedLoop | None:
        """Find the loop that a cloud closes, if any, and store the cloud.

        Args:
            cloud: coloured, in a frame whose z axis points up, such as the robot's.
            stamp_ns: its time stamp.

        Raises:
            DataError: a cloud that cannot be described or has no colours; nothing is stored.
        """
        if cloud.colors is None:
            raise DataError(
                "loops are aligned by coloured clouds and this one has no colours", code="no-colors"
            )
        scene = build_scene(cloud.points, cloud.colors)
        loop = self.detector.add(cloud, stamp_ns=stamp_ns)
        self._stored.append(Scene(scene.objects[:0], scene.image).to_bytes())
        self._stamps_ns.append(stamp_ns)
        return None if loop is None else self._align(loop, scene)

    def _align(self, loop: Loop, scene: Scene) -> AlignedLoop:
        older, stamp_ns = Scene.from_bytes(self._stored[loop.match]), self._stamps_ns[loop.match]
        found = align_scenes(scene, older)
        if not any(found.evidence.values()):  # nothing was aligned
            return AlignedLoop(loop, stamp_ns)
        return AlignedLoop(loop, stamp_ns, found.probability, (found.x, found.y, found.yaw))

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Save to a folder from which ``load`` resumes.

        Raises:
            DataError: nothing was added yet, or the folder cannot be written.
        """
        joined, offsets = pack_bytes(self._stored)
        stamps = np.array(self._stamps_ns, np.int64)
        # Scenes first: an interrupted save may leave more scenes than descriptors, never fewer.
        arrays = {"scenes": joined, "offsets": offsets, "stamps_ns": stamps}
        save_archive(Path(folder) / _SCENES, FORMAT, {}, arrays)
        self.detector.save(folder)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "AlignedLoopDetector":
        """Resume from what ``save`` wrote. Raises DataError naming the file."""
        loops = cls(LoopDetector.load(folder))
        path = Path(folder) / _SCENES
        with load_archive(path, FORMAT, "scenes of stored loops") as (_, stored):
            loops._stored = unpack_bytes(stored["scenes"], stored["offsets"])[: len(loops)]
            loops._stamps_ns = stored["stamps_ns"].tolist()[: len(loops)]
        if not len(loops._stored) == len(loops._stamps_ns) == len(loops):
            raise DataError(f"{path}: {len(loops._stored)} scenes of {len(loops)} clouds")
        return loops
