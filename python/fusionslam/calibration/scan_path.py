# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a LiDAR, with which an IMU is compared."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

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


Turning = Callable[[Floats], Rotation]
"""Orientations at times (M,), in a frame of their own: what a gyroscope knows of turns."""


class PoseSpline:
    """A smooth path through poses (K, 4, 4) at times (K,); between them it turns as told."""

    def __init__(self, seconds: Floats, poses: Floats, turning: Turning | None = None) -> None:
        turns = Rotation.from_matrix(poses[:, :3, :3])
        self._places = CubicSpline(seconds, poses[:, :3, 3])
        self._told = turning
        self._turns = RotationSpline(seconds, turns * turning(seconds).inv() if turning else turns)

    def at(self, seconds: Floats) -> Floats:
        """Poses (M, 4, 4) at times (M,)."""
        poses = np.tile(np.eye(4), (len(seconds), 1, 1))
        turns = self._turns(seconds)
        poses[:, :3, :3] = (turns * self._told(seconds) if self._told else turns).as_matrix()
        poses[:, :3, 3] = self._places(seconds)
        return poses
