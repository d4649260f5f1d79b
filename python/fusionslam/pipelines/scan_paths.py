# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The LiDAR's path by its scans alone, so exact that other sensors can be compared with it.

Odometry takes velocity for constant within a scan, which delays its turns; here each scan is
corrected by a smooth path through the scans before and after it, and registered to all of them.
"""

import logging
from collections.abc import Callable

import numpy as np

from fusionslam._core import deskew
from fusionslam.base.arrays import Floats, Points
from fusionslam.base.progress import Progress
from fusionslam.calibration.scan_path import PathPiece, PoseSpline, ScanPath
from fusionslam.datasets import Dataset
from fusionslam.errors import DataError, needing
from fusionslam.geometry.se3 import inverse
from fusionslam.odometry import LidarOdometry, LidarOdometryConfig
from fusionslam.pipelines.recording import name_frame
from fusionslam.sensors.messages import NANOSECONDS

logger = logging.getLogger(__name__)

PIECE = 100
"""Scans registered to one map: in 10 s odometry hardly drifts."""
_MOST = 10
_SCAN_POINTS = 4000
_CELLS_M = (0.5, 0.3, 0.2, 0.15, 0.1, 0.1, 0.1, 0.1)
"""Of the map in each round. In the last ones normals are of patches without corners; and as the map
holds a scan's own points, only a part of its error goes in each."""
_NEAR, _NEAREST_M = 1.5, 0.3
"""Cells, and metres at least, beyond which points of map and scan do not correspond."""
_STEPS = 33


def follow_scans(dataset: Dataset, progress: Progress = lambda done, total: None) -> ScanPath:
    """Estimate the path of a LiDAR, in pieces evenly spread over a long recording.

    Args:
        dataset: its scans are read as measured, with times of points.
        progress: called with (scans registered, total).

    Raises:
        DataError: there are no scans (code "no-scans"), fewer than ``PIECE`` follow each other
            (code "few-scans"), or points have no times (code "no-times").
        FusionSlamError: KISS-ICP or small_gicp is missing.
    """
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
    with needing("map", "calibration registers scans by small_gicp"):
        import small_gicp  # noqa: F401
    begin_ns = int(dataset.stamps_ns[0])
    starts = PIECE * np.unique(np.linspace(0, count - 1, min(count, _MOST)).round().astype(int))
    total = (1 + len(_CELLS_M)) * PIECE * len(starts)
    ticks = iter(range(1, total + 1))

    def step() -> None:
        progress(next(ticks), total)

    pieces, problem = [], None
    for start in starts.tolist():
        try:
            pieces.append(_follow_piece(dataset, range(start, start + PIECE), begin_ns, step))
        except DataError as error:
            if error.code not in ("far-apart", "lost"):
                raise
            problem = error
            logger.warning("scans %d to %d are not used: %s", start, start + PIECE - 1, error)
    if not pieces and problem is not None:
        raise problem
    return ScanPath(begin_ns, pieces)


def _follow_piece(
    dataset: Dataset, rows: range, begin_ns: int, step: Callable[[], None]
) -> PathPiece:
    odometry = LidarOdometry(LidarOdometryConfig(imu="never"))
    sweeps: list[tuple[Points, Floats]] = []
    found, stamps = [], (dataset.stamps_ns[rows.start : rows.stop] - begin_ns) / NANOSECONDS
    for row, stamp in zip(rows, stamps, strict=True):
        frame = dataset[row]
        with name_frame(dataset, row):
            if frame.points is None or frame.point_seconds is None:
                raise DataError("points have no times, which calibration needs", code="no-times")
            found.append(odometry.process(frame.points, frame.stamp_ns, frame.point_seconds))
        kept = np.flatnonzero(np.isfinite(frame.points).all(axis=1))
        kept = np.random.default_rng(row).permutation(kept)
        sweeps.append((frame.points[kept], stamp + frame.point_seconds[kept]))
        step()
    spline = PoseSpline(stamps, np.array(found))
    middles = np.array([(at.min() + at.max()) / 2 for _, at in sweeps])
    for cell in _CELLS_M:
        poses = _register(sweeps, middles, spline, cell, step)
        spline = PoseSpline(middles, poses)
    return PathPiece(middles, poses)


def _register(
    sweeps: list[tuple[Points, Floats]],
    middles: Floats,
    path: PoseSpline,
    cell_m: float,
    step: Callable[[], None],
) -> Floats:
    """Poses (K, 4, 4) of scans in the map of all, each scan corrected by a path, point to plane."""
    import small_gicp

    starts = path.at(middles)
    scans = []
    for (points, at), middle, start in zip(sweeps, middles, starts, strict=True):
        span = float(at.min() - middle), float(at.max() - middle)
        moved = inverse(start) @ path.at(middle + np.linspace(*span, _STEPS))
        scans.append(deskew(points, at - middle, moved, span).astype(np.float64))
    placed = [s @ p[:3, :3].T + p[:3, 3] for s, p in zip(scans, starts, strict=True)]
    target, tree = small_gicp.preprocess_points(np.concatenate(placed), cell_m, 20, 1)
    poses = []
    for scan, start in zip(scans, starts, strict=True):
        result = small_gicp.align(
            target,
            small_gicp.PointCloud(scan[:_SCAN_POINTS]),
            tree,
            start,
            registration_type="PLANE_ICP",
            max_correspondence_distance=max(_NEAR * cell_m, _NEAREST_M),
            num_threads=1,
            rotation_epsilon=1e-5,
            translation_epsilon=1e-5,
        )
        poses.append(np.array(result.T_target_source))
        step()
    return np.array(poses)
