# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Loops found by descriptors, with the relative pose from aligning their clouds."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.loop_closure.detector import FILE, Loop, LoopDetector
from fusionslam.sensors.frame import Cloud, require_cloud
from fusionslam.storage.archive import load_archive
from fusionslam.storage.files import reading
from fusionslam.views.alignment_comparison import align_scenes
from fusionslam.views.scene_set import pack_bytes, unpack_bytes
from fusionslam.views.scenes import Scene, build_scene

_FORMER_FORMAT, _FORMER_FILE = "fusionslam.aligned_loops.1", "scenes.npz"


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


@dataclass(frozen=True)
class _Stored:
    """What is kept of a cloud: its range image as a scene without objects, and its stamp."""

    scene: bytes
    stamp_ns: int


class AlignedLoopDetector:
    """A ``LoopDetector`` that also stores each cloud's range image, to align the clouds of a loop.

    Each cloud takes the memory of its descriptor and about 1 kB. What the detector forgets is
    forgotten here, too. To be used by one thread at a time.

    Args:
        detector: a new or resumed detector.
    """

    def __init__(self, detector: LoopDetector) -> None:
        self.detector = detector
        self._stored: dict[int, _Stored] = {}

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
            ShapeError: not a cloud.
        """
        require_cloud(cloud)
        if cloud.colors is None:
            raise DataError(
                "loops are aligned by coloured clouds and this one has no colours", code="no-colors"
            )
        scene = build_scene(cloud.points, cloud.colors)
        number = len(self)
        loop = self.detector.add(cloud, stamp_ns=stamp_ns)
        self._stored[number] = _Stored(Scene(scene.objects[:0], scene.image).to_bytes(), stamp_ns)
        found = None if loop is None else self._align(loop, scene)
        frames = self.detector.frames
        if len(frames) < len(self._stored):
            self._stored = {number: self._stored[number] for number in frames.tolist()}
        return found

    def _align(self, loop: Loop, scene: Scene) -> AlignedLoop:
        older = self._stored[loop.match]
        found = align_scenes(scene, Scene.from_bytes(older.scene))
        if not any(found.evidence.values()):  # nothing was aligned
            return AlignedLoop(loop, older.stamp_ns)
        pose = (found.x, found.y, found.yaw)
        return AlignedLoop(loop, older.stamp_ns, found.probability, pose)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Save to a folder from which ``load`` resumes, and ``LoopDetector.load`` as well.

        Raises:
            DataError: nothing was added yet, or the folder cannot be written.
        """
        joined, offsets = pack_bytes([each.scene for each in self._stored.values()])
        stamps = np.array([each.stamp_ns for each in self._stored.values()], np.int64)
        scenes: dict[str, NDArray[Any]] = {
            "scenes": joined,
            "offsets": offsets,
            "scene_stamps_ns": stamps,
        }
        self.detector.save_with(folder, scenes)
        (Path(folder) / _FORMER_FILE).unlink(missing_ok=True)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "AlignedLoopDetector":
        """Resume from what ``save`` wrote, in this version or an earlier one.

        Raises:
            DataError: the file is missing or damaged; the message names it.
        """
        detector, arrays = LoopDetector.load_with(folder)
        path, former = Path(folder) / FILE, Path(folder) / _FORMER_FILE
        if not arrays:
            path = former
            with load_archive(path, _FORMER_FORMAT, "scenes of stored loops") as (_, stored):
                arrays = {**stored, "scene_stamps_ns": stored["stamps_ns"]}
        frames = detector.frames.tolist()
        with reading(path, "scenes of stored loops"):
            scenes = unpack_bytes(arrays["scenes"], arrays["offsets"])
            stamps = arrays["scene_stamps_ns"].tolist()
            kept = [_Stored(scene, at) for scene, at in zip(scenes, stamps, strict=True)]
            # A save that was interrupted in an earlier version left more scenes than descriptors.
            if len(kept) < len(frames):
                raise DataError(f"{len(kept)} scenes of {len(frames)} clouds")
        loops = cls(detector)
        loops._stored = dict(zip(frames, kept[: len(frames)], strict=True))
        return loops
