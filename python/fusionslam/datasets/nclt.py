# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the LiDAR of NCLT (Carlevaris-Bianco, Ushani, Eustice 2016): a HDL-32E on a Segway.

Its body has y to the right and z down, as the world of its true poses has. Both are turned about x,
so that y is left and z up: points and poses here are those of the files with y and z negated.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.base.files import PathLike
from fusionslam.datasets.base import Z_UP
from fusionslam.datasets.cloud_files import read_records
from fusionslam.datasets.pose_files import read_table
from fusionslam.datasets.stamped_scans import StampedScans
from fusionslam.datasets.streams import find_existing
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Cloud

MICROSECOND_NS = 1000
RECORD = np.dtype([("xyz", "<u2", (3,)), ("intensity", "u1"), ("laser", "u1")])
STEP_M = 0.005
LOWEST_M = -100.0


def read_nclt_scan(path: PathLike) -> Cloud:
    """Read a file of velodyne_sync/: points of the turned body, and their intensities, 0 to 255.

    A point is uint16 x, y, z, in steps of 5 mm from -100 m, uint8 intensity and uint8 laser.

    Raises:
        DataError: the file is missing, or its size is not a multiple of 8 bytes.
    """
    rows = read_records(path, RECORD, "uint16 x y z, uint8 intensity, uint8 laser")
    points = (rows["xyz"] * STEP_M + LOWEST_M) * Z_UP
    return Cloud(points.astype(np.float32), None, rows["intensity"].astype(np.float32))


def _scans(root: Path) -> Path | None:
    folder = root / "velodyne_sync"
    return folder if folder.is_dir() else None


def _truth(root: Path) -> Path | None:
    name = f"groundtruth_{root.name}.csv"
    folders = (root, root / "ground_truth", root.parent, root.parent / "ground_truth")
    return find_existing(*(folder / name for folder in folders))


def _read_truth(path: Path) -> tuple[NDArray[np.int64], Matrix]:
    """Read stamps and poses of a groundtruth_DATE.csv; rows with NaN are not poses."""
    from scipy.spatial.transform import Rotation

    expected = "a stamp in microseconds, x, y, z and roll, pitch, heading in radians, with commas"
    stamps, rows = read_table(path, 6, expected, delimiter=",")
    known = np.isfinite(rows).all(axis=1)
    if not known.any():
        raise DataError(
            f"{path}: no line has a pose, expected {expected}",
            code="no-pose",
            fields=(str(path),),
        )
    stamps, rows = stamps[known] * MICROSECOND_NS, rows[known]
    # Of a matrix whose y and z axes are negated on both sides, pitch and heading change sign.
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, 3] = rows[:, :3] * Z_UP
    poses[:, :3, :3] = Rotation.from_euler("ZYX", (rows[:, 3:] * Z_UP)[:, ::-1]).as_matrix()
    return stamps, poses


NCLT = StampedScans(
    kind="nclt",
    title="NCLT",
    scans=_scans,
    read_scan=read_nclt_scan,
    unit_ns=MICROSECOND_NS,
    truth=_truth,
    read_truth=_read_truth,
    pose_frame="the robot's body, turned so that y is left and z up",
    body_from_points=np.eye(4),
)
