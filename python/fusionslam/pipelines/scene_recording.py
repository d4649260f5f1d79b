# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Open a stored scene set as a recording."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusionslam.datasets.base import CloudDataset
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import SceneSet


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneRecording(CloudDataset):
    """The clouds of a scene set, in the frame of the set; none if the set holds only scenes.

    Attributes:
        scenes: the set.
    """

    scenes: SceneSet

    @classmethod
    def open(cls, path: Path) -> "SceneRecording":
        """Read a scene set. Raises DataError as ``SceneSet.load``, or if it has no scans."""
        scenes = SceneSet.load(path)
        if not len(scenes):
            raise DataError(f"{path} is a scene set without scans")
        return cls(
            kind="scenes",
            name=scenes.name,
            root=path,
            numbers=scenes.numbers,
            stamps_ns=scenes.stamps_ns,
            pose_frame="the robot",
            body_from_points=np.eye(4) if scenes.frame == "robot" else None,
            poses=None if scenes.poses is None else ground_poses(*scenes.poses.T),
            scenes=scenes,
        )

    @property
    def counts(self) -> dict[str, int]:
        """The number of clouds; empty if the set has none."""
        return {} if self.scenes.clouds is None else {"points": len(self)}

    def content(self, sensor: str) -> str:
        """Describe the number of clouds and their frame."""
        empty = int(self.scenes.empty.sum())
        return f"{len(self)} coloured clouds in the {self.scenes.frame} frame, {empty} empty"

    def whole_cloud(self, index: int) -> Cloud:
        """Return a stored cloud. Raises DataError if the set holds only scenes."""
        if self.scenes.clouds is None:
            raise DataError(f"{self.name} holds no clouds: record it without --only-scenes")
        return self.scenes.clouds[index]

    def rows(self) -> list[tuple[str, str]]:
        """Return (label, value) pairs about the content of the set other than clouds."""
        built = "built when needed" if self.scenes.scenes is None else f"{len(self)} stored"
        return [("scenes", built), ("features", ", ".join(self.scenes.features) or "none")]
