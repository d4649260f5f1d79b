# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads drives of KITTI-360 (Liao, Xie, Geiger 2022): scans and images of the perspective pair.

The fisheye images are not read. Poses are those of poses.txt, which has them for some frames only.
"""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.datasets.base import Z_UP, Dataset, FileDataset
from fusionslam.datasets.calibration import homogeneous, read_calibration, rectified_camera
from fusionslam.datasets.kitti_odometry import ROBOT_FROM_VELODYNE
from fusionslam.datasets.pose_files import (
    line_of,
    match_poses,
    read_matrices,
    read_poses_kitti,
    read_timestamps,
    stamps_of,
)
from fusionslam.datasets.streams import (
    IMAGE_SUFFIXES,
    Request,
    Stream,
    choose,
    entries,
    files_in,
    find_existing,
    frame_numbers,
    one_of,
    scan,
    warn_uncalibrated,
)
from fusionslam.errors import DataError, naming
from fusionslam.geometry.rigid import check_mounting
from fusionslam.sensors.frame import Camera

logger = logging.getLogger(__name__)

RAW = ("data_3d_raw", "data_2d_raw")
CAMERAS = {"left": 0, "right": 1}
MOUNTING = "calib_cam_to_velo.txt"
FISHEYES = ("image_02", "image_03")
POSE_FRAME = "GPS/IMU, turned so that y is left and z up"
TURN: Matrix = np.diag([*Z_UP, 1.0])
"""The GPS/IMU has y to the right and z down."""


def open_kitti_360(path: Path, request: Request) -> Dataset:
    """Open the requested drive of the data set, or the folder of one in data_3d_raw/.

    Frames whose pose is unknown have one of NaN.

    Raises:
        DataError: no such drive; a file is missing, too short or malformed.
    """
    base, drive = _drive(path, request.sequence)
    scans, images = (base / raw / drive for raw in RAW)
    streams = {"points": scan(scans / "velodyne_points" / "data", (".bin",))} | {
        name: scan(images / f"image_{number:02d}" / "data_rect", IMAGE_SUFFIXES)
        for name, number in CAMERAS.items()
    }
    chosen = choose(streams, request, scans)
    numbers, gaps = frame_numbers(chosen, request)
    first = next(iter(chosen.values())).expected(int(numbers[0]))
    times = first.parent.parent / "timestamps.txt"
    stamps, recorded = stamps_of(numbers, [times], read_timestamps)
    truth = request.poses or find_existing(base / "data_poses" / drive / "poses.txt")
    poses = None
    if request.poses:
        poses = match_poses(request.poses, numbers, stamps, recorded=recorded)
    elif truth:
        expected = "a frame number and 12 numbers (row-major 3x4), with blanks between them"
        poses = _poses_of_numbers(truth, *read_matrices(truth, expected), numbers) @ TURN
    if set(chosen) & set(CAMERAS):
        found = {one: len(files_in(images / one / "data_rgb", IMAGE_SUFFIXES)) for one in FISHEYES}
        words = ", ".join(f"{count} of {name}" for name, count in found.items() if count)
        if words:
            logger.warning("%s: fisheye images are not read: %s", images, words)
    return FileDataset(
        kind="kitti-360",
        name=f"KITTI-360 {drive}",
        root=scans if "points" in chosen else images,
        streams=chosen,
        numbers=numbers,
        stamps_ns=stamps,
        pose_frame=POSE_FRAME,
        body_from_points=_body_from_points(base / "calibration"),
        poses=poses,
        poses_file=truth,
        cameras=_cameras(base / "calibration", chosen),
        gaps=gaps,
        recorded=recorded,
        # The same scanner on the same roof as in KITTI.
        robot_from_points=ROBOT_FROM_VELODYNE,
    )


def is_kitti_360(path: Path) -> bool:
    """Whether a folder has this layout, or is one of it with the scans or images of drives."""
    return _base(path) is not None


def _base(path: Path) -> Path | None:
    """Folder of the data set, which a path may be, or lie in by one or two levels."""
    if any((path / raw).is_dir() for raw in RAW):
        return path
    return next((one.parent for one in (path, path.parent) if one.name in RAW), None)


def _drive(path: Path, name: str | None) -> tuple[Path, str]:
    """Folder of the data set and name of the drive, which may be named by its number ("0003")."""
    base = _base(path)
    if base is None:
        expected = " or ".join(f"{raw}/" for raw in RAW)
        raise DataError(f"{path} has no {expected}", code="no-recording", fields=(str(path),))
    names = {
        folder.name
        for raw in RAW
        for folder in entries(base / raw)
        if folder.name.endswith("_sync") and folder.is_dir()
    }
    if path.parent.name in RAW and path.name in names:
        name = name or path.name
    numbered = name.zfill(4) if name else name
    full = next((drive for drive in sorted(names) if f"_drive_{numbered}_" in drive), name)
    return base, one_of(base, {drive: Path(drive) for drive in sorted(names)}, full).name


def _poses_of_numbers(
    path: Path, keys: NDArray[np.int64], poses: NDArray[np.float64], numbers: NDArray[np.int64]
) -> Matrix:
    """Poses of frames by number, float64 (N, 4, 4), NaN for those that the file lacks.

    Args:
        path: the file that the poses are of, for errors.
        keys: int64 (M), frame numbers of the poses.
        poses: float64 (M, 4, 4).
        numbers: int64 (N), of the frames.

    Raises:
        DataError: two poses are of one frame.
    """
    order = np.argsort(keys, kind="stable")
    if (twice := np.flatnonzero(np.diff(keys[order]) == 0)).size:
        row = order[twice[0] + 1]
        line = line_of(path, row)
        raise DataError(
            f"{path}, line {line}: a second pose of frame {keys[row]}",
            code="two-poses",
            fields=(str(path), str(line)),
        )
    found = np.full((len(numbers), 4, 4), np.nan)
    rows = np.searchsorted(keys[order], numbers).clip(0, len(keys) - 1)
    known = keys[order[rows]] == numbers
    found[known] = poses[order[rows[known]]]
    return found


def _cameras(folder: Path, streams: dict[str, Stream]) -> dict[str, Camera]:
    """The perspective cameras in use, both rectified to camera 0; none if a file is missing."""
    perspective, velodyne_from_camera = folder / "perspective.txt", _velodyne_from_camera(folder)
    if velodyne_from_camera is None or not perspective.exists():
        warn_uncalibrated(streams, f"{perspective} or no {MOUNTING} beside it")
        return {}
    calibration = read_calibration(perspective)
    rectified_from_camera = homogeneous(calibration.matrix("R_rect_00", 3, 3))
    rectified_from_points = rectified_from_camera @ np.linalg.inv(velodyne_from_camera)
    return {
        name: rectified_camera(calibration, number, rectified_from_points)
        for name, number in CAMERAS.items()
        if name in streams
    }


def _velodyne_from_camera(folder: Path) -> Matrix | None:
    """Where camera 0, not rectified, is in the scanner's frame; None if the file is missing."""
    path = folder / MOUNTING
    if not path.exists():
        return None
    matrix: Matrix = read_poses_kitti(path)[0]
    with naming(path):
        check_mounting("the matrix", matrix)
    return matrix


def _body_from_points(folder: Path) -> Matrix | None:
    """Where the scanner is in the frame of the turned GPS/IMU; None if a file is missing."""
    path, velodyne_from_camera = folder / "calib_cam_to_pose.txt", _velodyne_from_camera(folder)
    if velodyne_from_camera is None or not path.exists():
        return None
    imu_from_camera = read_calibration(path).transform("image_00")
    with naming(path):
        check_mounting("image_00", imu_from_camera)
    return np.asarray(TURN @ imu_from_camera @ np.linalg.inv(velodyne_from_camera))
