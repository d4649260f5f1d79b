# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads frames of the KITTI object benchmark: unordered in time, each with its calibration."""

import functools
from collections.abc import Mapping
from pathlib import Path

from fusionslam.datasets.base import Dataset, FileDataset
from fusionslam.datasets.calibration import camera, homogeneous, read_calibration
from fusionslam.datasets.kitti_odometry import POSE_FRAME, ROBOT_FROM_VELODYNE, find_streams
from fusionslam.datasets.streams import Request, Stream, choose, frame_numbers, itself, one_of, scan
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.messages import NANOSECONDS


def open_kitti_object(path: Path, request: Request) -> Dataset:
    """Open ``training/``, ``testing/`` or their parent folder (training by default).

    Numbers need not be consecutive: any subset of the frames is a dataset.

    Raises:
        DataError: a file is missing or malformed; or poses are given, which this data cannot have.
    """
    root = _split(path, request.sequence)
    if request.poses:
        raise DataError(f"{root} has frames without order in time: poses are not expected")
    camera_numbers, streams = find_streams(root, "velodyne", "image_{}")
    chosen = choose(streams, request, root)
    used = {name: n for name, n in camera_numbers.items() if name in chosen}
    calib: dict[str, Stream] = {}
    if used:
        if (stream := scan(root / "calib", (".txt",))) is None:
            raise DataError(f"{root / 'calib'} has no file: expected NNNNNN.txt for each frame")
        calib["calib"] = stream
    numbers, gaps = frame_numbers(chosen | calib, request, consecutive=False)
    cameras = functools.partial(_cameras, calib.get("calib"), used)
    return FileDataset(
        kind="kitti-object",
        name=f"KITTI object {root.name}",
        root=root,
        streams=chosen,
        numbers=numbers,
        stamps_ns=numbers * NANOSECONDS,
        pose_frame=POSE_FRAME,
        body_is_camera=True,
        cameras=cameras(int(numbers[0])),
        gaps=gaps,
        robot_from_points=ROBOT_FROM_VELODYNE,
        frame_cameras=cameras,
    )


def _split(path: Path, name: str | None) -> Path:
    splits = [path / split for split in ("training", "testing")]
    available = {split.name: split for split in splits if _is_split(split)}
    if not available:
        return itself(path, name)
    return one_of(path, available, name or next(iter(available)))


def _is_split(path: Path) -> bool:
    return (path / "calib").is_dir() and any(
        (path / folder).is_dir() for folder in ("velodyne", "image_2", "image_3")
    )


def _cameras(calib: Stream | None, used: Mapping[str, int], number: int) -> dict[str, Camera]:
    """Cameras of a frame; ``used`` maps their names to KITTI's numbers."""
    if calib is None:
        return {}
    calibration = read_calibration(calib.files[number])
    rectified_from_camera = homogeneous(calibration.matrix("R0_rect", 3, 3))
    rectified_from_points = rectified_from_camera @ calibration.transform("Tr_velo_to_cam")
    return {
        name: camera(calibration.path, calibration.matrix(f"P{n}", 3, 4), rectified_from_points)
        for name, n in used.items()
    }


def is_kitti_object(path: Path) -> bool:
    """Whether a folder has this layout."""
    return any(map(_is_split, (path, path / "training", path / "testing")))
