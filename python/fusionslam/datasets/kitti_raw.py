# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads synchronised, rectified KITTI raw drives (Geiger, Lenz, Stiller, Urtasun 2013).

The GPS/IMU records in ``oxts/`` are not read: frames have poses only if a pose file is given.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.base import Dataset, FileDataset
from fusionslam.datasets.calibration import Calibration, camera, homogeneous, read_calibration
from fusionslam.datasets.kitti_odometry import POSE_FRAME, ROBOT_FROM_VELODYNE, find_streams
from fusionslam.datasets.pose_files import match_poses, pick, read_timestamps
from fusionslam.datasets.streams import (
    Request,
    Stream,
    choose,
    entries,
    find_existing,
    frame_numbers,
    itself,
    named_and_linked,
    one_of,
    regular_stamps,
    warn_uncalibrated,
)
from fusionslam.sensors.frame import Camera

STREAM_FOLDERS = ("velodyne_points", "image_00", "image_01", "image_02", "image_03")


def open_kitti_raw(path: Path, request: Request) -> Dataset:
    """Open a drive folder, or the requested drive in the folder of a date.

    Raises:
        DataError: no such drive; a file is missing, too short or malformed.
    """
    root = _drive(path, request.sequence)
    camera_numbers, streams = find_streams(root, "velodyne_points/data", "image_{:02d}/data")
    chosen = choose(streams, request, root)
    numbers, gaps = frame_numbers(chosen, request)
    stamps, recorded = _stamps(root, numbers, chosen)
    rectified_from_points, cameras = _calibration(root, chosen, camera_numbers)
    return FileDataset(
        kind="kitti-raw",
        name=f"KITTI raw {root.name}",
        root=root,
        streams=chosen,
        numbers=numbers,
        stamps_ns=stamps,
        pose_frame=POSE_FRAME,
        body_is_camera=True,
        body_from_points=rectified_from_points,
        poses=match_poses(request.poses, numbers, stamps, recorded=recorded)
        if request.poses
        else None,
        cameras=cameras,
        gaps=gaps,
        recorded=recorded,
        robot_from_points=ROBOT_FROM_VELODYNE,
    )


def _drive(path: Path, name: str | None) -> Path:
    """Find the drive folder; a drive may be named by its number alone ("0001")."""
    if _is_drive(path):
        return itself(path, name)
    available = {folder.name: folder for folder in entries(path) if _is_drive(folder)}
    numbered = name.zfill(4) if name else name
    full = next((drive for drive in available if f"_drive_{numbered}_" in drive), name)
    return one_of(path, available, full)


def _is_drive(path: Path) -> bool:
    return any((path / folder).is_dir() for folder in STREAM_FOLDERS)


def _stamps(
    root: Path, numbers: NDArray[np.int64], streams: dict[str, Stream]
) -> tuple[NDArray[np.int64], int | None]:
    """Stamps of the scans or, if they have none, of the first sensor that has some; their number.

    The number is that of the whole drive; None without a file of stamps.
    """
    folders = [stream.expected(int(numbers[0])).parent.parent for stream in streams.values()]
    paths = [folder / "timestamps.txt" for folder in folders]
    path = find_existing(*paths)
    if path is None:
        return regular_stamps(numbers, str(paths[0])), None
    times = read_timestamps(path)
    return pick(times, numbers, path), len(times)


def _camera(
    cam_to_cam: Calibration, number: int, rectified_from_points: NDArray[np.float64]
) -> Camera:
    width, height = cam_to_cam.numbers(f"S_rect_{number:02d}", 2)
    return camera(
        cam_to_cam.path,
        cam_to_cam.matrix(f"P_rect_{number:02d}", 3, 4),
        rectified_from_points,
        (int(width), int(height)),
    )


def _calibration(
    root: Path, streams: dict[str, Stream], numbers: dict[str, int]
) -> tuple[NDArray[np.float64] | None, dict[str, Camera]]:
    """Where the scanner is in camera 0, and the cameras; nothing if a file is missing, logged."""
    found = []
    for name in ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt"):
        # Of the drive or of its date's folder, as in the published data.
        path = find_existing(root / name, *(one.parent / name for one in named_and_linked(root)))
        if path is None:
            warn_uncalibrated(streams, f"{root / name} and no {root.parent / name}")
            return None, {}
        found.append(read_calibration(path))
    cam_to_cam, velo_to_cam = found
    rectified_from_camera = homogeneous(cam_to_cam.matrix("R_rect_00", 3, 3))
    rectified_from_points = rectified_from_camera @ velo_to_cam.transform("R", "T")
    used = {name: number for name, number in numbers.items() if name in streams}
    return rectified_from_points, {
        name: _camera(cam_to_cam, number, rectified_from_points) for name, number in used.items()
    }


def is_kitti_raw(path: Path) -> bool:
    """Whether a folder has this layout."""
    return _is_drive(path) or any(_is_drive(folder) for folder in entries(path))
