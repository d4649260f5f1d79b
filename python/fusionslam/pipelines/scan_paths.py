# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The LiDAR's path by its scans, so exact that an IMU can be compared with it.

Odometry takes velocity for constant within a scan, which delays its turns; here each scan is
corrected by a smooth path through the scans before and after it, and registered to all of them.
"""

import itertools
import logging
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam._core import SurfaceCloud, deskew, refine_pose, voxel_downsample
from fusionslam.base.arrays import Floats, Points
from fusionslam.base.progress import Progress
from fusionslam.calibration.scan_path import (
    PathPiece,
    PoseSpline,
    ScanPath,
    Turning,
)
from fusionslam.datasets import Dataset
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import inverse
from fusionslam.odometry import LidarOdometry, LidarOdometryConfig
from fusionslam.pipelines.recording import name_frame
from fusionslam.sensors.messages import NANOSECONDS

logger = logging.getLogger(__name__)

PIECE = 100
"""Scans registered to one map: in 10 s odometry hardly drifts."""
_MOST = 6
"""Pieces: more would take long, and tell little more."""
_MAP_POINTS, _SCAN_POINTS = 10_000, 4000
"""Of a scan, in the map and registered to it."""
_COARSE_M = (0.5, 0.3, 0.2)
_FINE_M = (0.1, 0.1, 0.1, 0.1)
"""Cells of the map in each round. Fine ones have normals of patches without corners. As the map
holds a scan's own points, only a part of its error goes in each round."""
_NEAR, _NEAREST_M = 1.5, 0.3
"""Cells, and metres at least, beyond which points of map and scan do not correspond."""
_NEIGHBORS = 20
"""Points whose plane is that of a point."""
_STEPS = 33


class _Piece(NamedTuple):
    """Scans that follow each other: points (N, 3) with times (N,) each; and their poses."""

    sweeps: list[tuple[Points, Floats]]
    path: PathPiece


class ScanFollower:
    """Estimates the path of a LiDAR, in pieces evenly spread over a long recording.

    Args:
        dataset: its scans are read as measured, with times of points.
        progress: called with (scans registered, total).
        refinements: so often ``refine`` will be called.

    Raises:
        DataError: there are no scans (code "no-scans"), fewer than ``PIECE`` follow each other
            (code "few-scans"), or points have no times (code "no-times").
        FusionSlamError: KISS-ICP is missing.
    """

    def __init__(
        self,
        dataset: Dataset,
        progress: Progress = lambda done, total: None,
        refinements: int = 1,
    ) -> None:
        if not dataset.has_points:
            raise DataError(f"{dataset.name} has no scans", code="no-scans")
        dataset = dataset.as_measured()
        count = len(dataset) // PIECE
        if not count:
            raise DataError(
                f"{dataset.name} has {len(dataset)} scans, expected {PIECE} or more",
                code="few-scans",
                fields=(str(len(dataset)),),
            )
        self._begin_ns = int(dataset.stamps_ns[0])
        chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST)).round().astype(int))
        total = (1 + len(_COARSE_M) + refinements * len(_FINE_M)) * PIECE * len(chosen)
        ticks = itertools.count(1)
        self._step: Callable[[], None] = lambda: progress(min(next(ticks), total), total)
        self._pieces, problem = [], None
        for start in (PIECE * chosen).tolist():
            try:
                self._pieces.append(self._follow(dataset, range(start, start + PIECE)))
            except DataError as error:
                if error.code not in ("far-apart", "lost"):
                    raise
                problem = error
                logger.warning("scans %d to %d are not used: %s", start, start + PIECE - 1, error)
        if not self._pieces and problem is not None:
            raise problem

    @property
    def path(self) -> ScanPath:
        """The path found so far."""
        return ScanPath(self._begin_ns, [piece.path for piece in self._pieces])

    def refine(self, turning: Turning | None) -> ScanPath:
        """Register the scans again, in finer maps.

        Args:
            turning: the LiDAR's turns by an IMU. They begin with the scans, but each scan ends
                where it fits best.
        """
        refined = []
        for sweeps, path in self._pieces:
            if turning is not None:
                told, poses = turning(path.seconds), path.poses.copy()
                mean = (Rotation.from_matrix(poses[:, :3, :3]) * told.inv()).mean()
                poses[:, :3, :3] = (mean * told).as_matrix()
                path = PathPiece(path.seconds, poses)
            for cell in _FINE_M:
                path = _register(sweeps, path, turning, cell, self._step)
            refined.append(_Piece(sweeps, path))
        self._pieces = refined
        return self.path

    def _follow(self, dataset: Dataset, rows: range) -> _Piece:
        odometry = LidarOdometry(LidarOdometryConfig(imu="never"))
        sweeps: list[tuple[Points, Floats]] = []
        found = []
        stamps = (dataset.stamps_ns[rows.start : rows.stop] - self._begin_ns) / NANOSECONDS
        for row, stamp in zip(rows, stamps, strict=True):
            frame = dataset[row]
            with name_frame(dataset, row):
                if frame.points is None or frame.point_seconds is None:
                    raise DataError(
                        "points have no times, which calibration needs", code="no-times"
                    )
                found.append(odometry.process(frame.points, frame.stamp_ns, frame.point_seconds))
            kept = np.flatnonzero(np.isfinite(frame.points).all(axis=1))
            kept = np.random.default_rng(row).permutation(kept)[:_MAP_POINTS]
            sweeps.append((frame.points[kept], stamp + frame.point_seconds[kept]))
            self._step()
        middles = np.array([(at.min() + at.max()) / 2 for _, at in sweeps])
        path = PathPiece(middles, PoseSpline(stamps, np.array(found)).at(middles))
        for cell in _COARSE_M:
            path = _register(sweeps, path, None, cell, self._step)
        return _Piece(sweeps, path)


def _register(
    sweeps: list[tuple[Points, Floats]],
    path: PathPiece,
    turning: Turning | None,
    cell_m: float,
    step: Callable[[], None],
) -> PathPiece:
    """Register scans to the map of all, each corrected by the path."""
    spline, scans = PoseSpline(path.seconds, path.poses, turning), []
    for (points, at), middle, start in zip(sweeps, path.seconds, path.poses, strict=True):
        span = float(at.min() - middle), float(at.max() - middle)
        moved = inverse(start) @ spline.at(middle + np.linspace(*span, _STEPS))
        scans.append(deskew(points, at - middle, moved, span))
    placed = [s @ p[:3, :3].T + p[:3, 3] for s, p in zip(scans, path.poses, strict=True)]
    whole = np.concatenate(placed).astype(np.float32)
    target = SurfaceCloud(voxel_downsample(whole, size=cell_m)[0], neighbors=_NEIGHBORS)
    poses = []
    for scan, start in zip(scans, path.poses, strict=True):
        found = refine_pose(
            SurfaceCloud(scan[:_SCAN_POINTS], neighbors=_NEIGHBORS),
            target,
            start,
            distance=max(_NEAR * cell_m, _NEAREST_M),
            step=1e-5,
        )
        poses.append(found.target_from_source)
        step()
    return PathPiece(path.seconds, np.array(poses))
