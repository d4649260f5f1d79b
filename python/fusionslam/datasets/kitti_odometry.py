# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads sequences of the KITTI odometry benchmark (Geiger, Lenz, Urtasun 2012).

Also those of SemanticKITTI (Behley et al. 2019): the same sequences, with labels, which are not
read, and poses by SuMa beside the scans.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.base import Dataset, FileDataset
from fusionslam.datasets.calibration import camera, read_calibration
from fusionslam.datasets.pose_files import match_poses, read_times, stamps_of
from fusionslam.datasets.streams import (
    IMAGE_SUFFIXES,
    Request,
    Stream,
    choose,
    entries,
    find_existing,
    frame_numbers,
    itself,
    named_and_linked,
    one_of,
    scan,
    warn_uncalibrated,
)
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Camera

POSE_FRAME = "camera 0 (left grey)"
ROBOT_FROM_VELODYNE = np.eye(4)
"""KITTI's car: its scanner, x ahead and z up, is 1.73 m above the ground (Geiger et al. 2012)."""
ROBOT_FROM_VELODYNE[2, 3] = 1.73
# Cameras 2 and 3 are the colour pair, 0 and 1 the grey one.
PAIRS = ({"left": 2, "right": 3}, {"left": 0, "right": 1})


def open_kitti_odometry(path: Path, request: Request) -> Dataset:
    """Open a sequence folder, or the requested sequence of a root with ``sequences/``.

    Raises:
        DataError: no such sequence; a file is missing, too short or malformed.
    """
    root = _sequence(path, request.sequence)
    camera_numbers, streams = find_streams(root, "velodyne", "image_{}")
    chosen = choose(streams, request, root)
    numbers, gaps = frame_numbers(chosen, request)
    named = [(one.parent.parent, one.name) for one in named_and_linked(root)]
    times = [root / "times.txt", *(base / "times" / f"times_{name}.txt" for base, name in named)]
    stamps, recorded = stamps_of(numbers, times, read_times)
    camera0_from_points, cameras = _calibrate(root, chosen, camera_numbers)
    poses = request.poses or find_existing(
        root / "poses.txt", *(base / "poses" / f"{name}.txt" for base, name in named)
    )
    return FileDataset(
        kind="kitti-odometry",
        name=_name(root),
        root=root,
        streams=chosen,
        numbers=numbers,
        stamps_ns=stamps,
        pose_frame=POSE_FRAME,
        body_is_camera=True,
        body_from_points=camera0_from_points,
        poses=match_poses(poses, numbers, stamps, recorded=recorded, strict=poses == request.poses)
        if poses
        else None,
        poses_file=poses,
        cameras=cameras,
        gaps=gaps,
        recorded=recorded,
        robot_from_points=ROBOT_FROM_VELODYNE,
    )


def _name(root: Path) -> str:
    """Name the sequence; figures published for KITTI apply only to KITTI's own data and poses."""
    if find_existing(*(one.parent.parent / "sim.json" for one in named_and_linked(root))):
        return "simulated drive"
    is_semantic = (root / "labels").is_dir() and (root / "poses.txt").exists()
    return f"{'SemanticKITTI' if is_semantic else 'KITTI odometry'} {root.name}"


def find_streams(
    root: Path, scans: str, images: str
) -> tuple[dict[str, int], dict[str, Stream | None]]:
    """Find KITTI's streams: the scans, and the colour pair if it has files, else the grey one.

    Args:
        root: folder of the sequence.
        scans: folder of the scans in it.
        images: folder of the images, with a placeholder for the camera's number.

    Returns:
        KITTI's camera number of each sensor that has images, and the streams by sensor.
    """
    points = scan(root / scans, (".bin",))
    for pair in PAIRS:
        found = {name: scan(root / images.format(n), IMAGE_SUFFIXES) for name, n in pair.items()}
        if any(found.values()):
            break
    return {name: n for name, n in pair.items() if found[name]}, {"points": points, **found}


def _sequence(path: Path, name: str | None) -> Path:
    if not (path / "sequences").is_dir():
        return itself(path, name)
    folders = [folder for folder in entries(path / "sequences") if folder.is_dir()]
    available = {folder.name: folder for folder in folders}
    return one_of(path / "sequences", available, name)


def _calibrate(
    root: Path, streams: dict[str, Stream], numbers: dict[str, int]
) -> tuple[NDArray[np.float64] | None, dict[str, Camera]]:
    """Where the scanner is in camera 0, and the cameras; without calib.txt, nothing, logged."""
    path = root / "calib.txt"
    if not path.exists():
        warn_uncalibrated(streams, str(path))
        return None, {}
    calibration, camera0_from_points = read_calibration(path), None
    if "Tr" in calibration.entries:
        camera0_from_points = calibration.transform("Tr")
    elif "points" in streams:  # the calib.txt that comes with images alone may lack it
        raise DataError(
            f"{path} lacks Tr (12 numbers), which maps the scans to camera 0: it has "
            f"{', '.join(calibration.entries) or 'nothing'}; the files of KITTI's download of "
            "calibrations have it, those that come with its images do not",
            code="calibration-key",
            fields=(str(path), "Tr"),
        )
    rectified_from_points = np.eye(4) if camera0_from_points is None else camera0_from_points
    return camera0_from_points, {
        name: camera(path, calibration.matrix(f"P{n}", 3, 4), rectified_from_points)
        for name, n in numbers.items()
        if name in streams
    }


def is_kitti_odometry(path: Path) -> bool:
    """Whether a folder has this layout."""
    folders = ("sequences", "velodyne", "image_0", "image_1", "image_2", "image_3")
    return any((path / folder).is_dir() for folder in folders)
