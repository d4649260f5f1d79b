# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where the frames of all drives at a site are in its joint map."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusionslam.base.arrays import Floats, Integers, Matrix
from fusionslam.datasets.pose_files import interpolate_poses
from fusionslam.mapping import PlaceMap
from fusionslam.mapping.map_content import robot_poses


@dataclass(frozen=True)
class JoinedDrive:
    """Keyframes of a drive that the joint map has, in the order in which they were driven.

    Attributes:
        frames: int64 (n), numbers in the recording, ascending.
        poses: float64 (n, 4, 4), map_from_robot; NaN in parts of the map that nothing joins with
            the first one.
        stretches: int64 (n), the same number for keyframes that odometry connects.
    """

    frames: Integers
    poses: Floats
    stretches: Integers

    def pose_at(self, frame: int) -> Matrix | None:
        """Return map_from_robot, float64 (4, 4), at a frame of the recording; None if unknown.

        Between two keyframes of one stretch it is interpolated by the number of the frame. After
        the last one of a stretch it is that of this keyframe: had the robot moved farther than
        keyframes are apart, there would be another one. Before the first it is that of the first.
        """
        row = max(int(np.searchsorted(self.frames, frame, side="right")) - 1, 0)
        pose: Matrix = self.poses[row]
        if not np.isfinite(pose).all():
            return None
        pair = slice(row, row + 2)
        frames, poses = self.frames[pair], self.poses[pair]
        is_between = frames[0] < frame and len(frames) == 2 and np.isfinite(poses).all()
        if not is_between or np.ptp(self.stretches[pair]):
            return pose
        (between,), _ = interpolate_poses(frames, poses, np.array([frame]))
        return np.asarray(between)


@dataclass(frozen=True)
class JointMap:
    """The drives of a site in one frame, whose origin is the first pose of the first drive.

    Attributes:
        drives: by the name of the recording; those alone that have a keyframe in the first part
            of the map.
    """

    drives: Mapping[str, JoinedDrive]

    @classmethod
    def read(cls, path: Path) -> "JointMap":
        """Read the drives of a map, and close it again.

        Raises:
            DataError: it cannot be read, as of ``PlaceMap.open``.
            FusionSlamError: the extra ``map`` is not installed (code "missing-extra").
        """
        with PlaceMap.open(path, read_only=True) as site:
            content = site.content
            keyframes, parts = content.keyframes, np.array(content.parts, np.int64)
            poses = robot_poses(keyframes, content.poses)
        poses[parts != parts[:1]] = np.nan
        sessions = np.array([each.session for each in keyframes], np.int64)
        frames = np.array([each.frame for each in keyframes], np.int64)
        stretches = np.array([content.stretches[each.id] for each in keyframes], np.int64)
        order = np.lexsort((frames, sessions))
        drives = {}
        for name, number in content.sessions.items():
            first, end = np.searchsorted(sessions[order], [number, number + 1])
            rows = order[first:end]
            if np.isfinite(poses[rows, 0, 0]).any():
                drives[name] = JoinedDrive(frames[rows], poses[rows], stretches[rows])
        return cls(drives)

    def pose_at(self, session: str, frame: int) -> Matrix | None:
        """Return map_from_robot, float64 (4, 4), at a frame of a recording; None if unknown."""
        drive = self.drives.get(session)
        return None if drive is None else drive.pose_at(frame)
