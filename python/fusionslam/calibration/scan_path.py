# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a LiDAR, with which other sensors are compared."""

from dataclasses import dataclass

import numpy as np

from fusionslam.base.arrays import Floats


@dataclass(frozen=True, eq=False)
class PathPiece:
    """Poses of K scans that follow each other.

    Attributes:
        seconds: float64 (K), the middle of each sweep, since ``begin_ns`` of the path.
        poses: float64 (K, 4, 4), piece_from_scan.
    """

    seconds: Floats
    poses: Floats


@dataclass(frozen=True, eq=False)
class ScanPath:
    """A LiDAR's path in pieces, each in a frame of its own.

    Attributes:
        begin_ns: stamp at which ``seconds`` of the pieces begin.
        pieces: in the order of time.
    """

    begin_ns: int
    pieces: list[PathPiece]


class PoseSpline:
    """A smooth path through poses (K, 4, 4) at times (K,)."""

    def __init__(self, seconds: Floats, poses: Floats) -> None:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        self._places = CubicSpline(seconds, poses[:, :3, 3])
        self._turns = RotationSpline(seconds, Rotation.from_matrix(poses[:, :3, :3]))

    def at(self, seconds: Floats) -> Floats:
        """Poses (M, 4, 4) at times (M,)."""
        poses = np.tile(np.eye(4), (len(seconds), 1, 1))
        poses[:, :3, :3] = self._turns(seconds).as_matrix()
        poses[:, :3, 3] = self._places(seconds)
        return poses
