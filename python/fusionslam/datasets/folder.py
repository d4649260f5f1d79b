# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads plain folders with point clouds, images, calib.yaml, poses, odometry and times."""

import logging
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.base import Dataset, FileDataset
from fusionslam.datasets.calibration import read_calib_yaml, read_place_on_robot
from fusionslam.datasets.cloud_files import CLOUD_SUFFIXES
from fusionslam.datasets.pose_files import match_poses, pick, read_poses, read_times
from fusionslam.datasets.streams import (
    IMAGE_SUFFIXES,
    Request,
    Stream,
    choose,
    files_in,
    find_existing,
    frame_numbers,
    itself,
    regular_stamps,
    unique,
    unread_types,
    warn_uncalibrated,
)
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Camera

logger = logging.getLogger(__name__)

# Folders that may hold each sensor's files, and their suffixes; the first one with files is used.
# Further cameras have folders of their names in calib.yaml.
LAYOUT: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "points": (("clouds", "points", "."), CLOUD_SUFFIXES),
    "left": (("left", "images"), IMAGE_SUFFIXES),
    "right": (("right",), IMAGE_SUFFIXES),
}
# File names that end in this many digits or more are stamps in nanoseconds.
STAMP_DIGITS = 16
_BELONG = (
    "; a folder has scans in clouds/ or points/, images in left/ or images/, those of the right "
    "camera of a pair in right/ and of further cameras in folders of their names in calib.yaml, "
    "under the same names"
)
MAX_STAMP_NS = np.iinfo(np.int64).max


def open_folder(path: Path, request: Request) -> Dataset:
    """Open a folder of clouds and images that are matched by file name.

    Raises:
        DataError: a file is missing, too short or malformed.
    """
    root = itself(path, request.sequence)
    calibration = request.calibration or find_existing(root / "calib.yaml")
    calibrated = read_calib_yaml(calibration) if calibration else {}
    # Files of sensors that were not requested do not count as frames.
    wanted = request.sensors or tuple(LAYOUT)
    files = {sensor: paths for sensor, paths in _files(root).items() if sensor in wanted}
    around = _surround_files(root, calibrated) if "left" in wanted else {}
    if around and not files["left"]:
        main = next(iter(around))
        files["left"], calibrated["left"] = around.pop(main), calibrated.pop(main)
    for sensor in (sensor for sensor, paths in files.items() if not paths):
        for problem in unread_files(root, sensor):
            logger.warning("%s", problem)
    streams, name_stamps = _number(files | around)
    surround = {name: stream for name in around if (stream := streams.pop(name)) is not None}
    chosen = choose(streams, request, root)
    numbers, gaps = frame_numbers(chosen, request)
    poses = request.poses or find_existing(root / "poses.txt")
    odometry = find_existing(root / "odometry.txt")
    stamps, recorded = _stamps(root, numbers, name_stamps, poses)
    # A calibration must have every camera in use.
    names = [name for name in chosen if name != "points"] if calibrated else []
    if lacking := [name for name in names if name not in calibrated]:
        raise DataError(f"{calibration} lacks camera '{lacking[0]}', of which there are images")
    cameras = {name: calibrated[name] for name in [*names, *surround]}
    if not cameras:
        warn_uncalibrated(chosen, f"cameras in {calibration or root / 'calib.yaml'}")
    return FileDataset(
        kind="folder",
        name=root.name,
        root=root,
        streams=chosen,
        surround=surround,
        numbers=numbers,
        stamps_ns=stamps,
        pose_frame="points",
        body_from_points=np.eye(4),
        poses=match_poses(poses, numbers, stamps, recorded=recorded, strict=poses == request.poses)
        if poses
        else None,
        poses_file=poses,
        cameras=cameras,
        gaps=gaps,
        recorded=recorded,
        robot_from_points=read_place_on_robot(calibration) if calibration else None,
        odometry=odometry,
        odometry_topic=None if odometry is None else odometry.name,
    )


def _files(root: Path) -> dict[str, list[Path]]:
    """The files of each sensor; an empty list if it has no folder."""
    return {
        sensor: next(filter(None, (files_in(root / folder, suffixes) for folder in folders)), [])
        for sensor, (folders, suffixes) in LAYOUT.items()
    }


def _number(
    files: dict[str, list[Path]],
) -> tuple[dict[str, Stream | None], NDArray[np.int64] | None]:
    """Numbered streams, and the stamps of frames 0, 1, ... if the file names contain them."""
    stems = sorted({path.stem for paths in files.values() for path in paths})
    ends = [re.search(r"\d+$", stem) for stem in stems]
    digits = [end[0] for end in ends if end]
    if len(digits) < len(stems):
        return _streams(files, {stem: n for n, stem in enumerate(stems)}, ranked=True), None
    values = dict(zip(stems, map(int, digits), strict=True))
    if min(map(len, digits), default=0) < STAMP_DIGITS:
        return _streams(files, values, ranked=False), None
    stamps = sorted(set(values.values()))
    if stamps[-1] > MAX_STAMP_NS:
        raise DataError(f"file names end in {stamps[-1]}, which is no time in nanoseconds")
    ranks = {stamp: n for n, stamp in enumerate(stamps)}
    numbers = {stem: ranks[stamp] for stem, stamp in values.items()}
    return _streams(files, numbers, ranked=True), np.array(stamps, dtype=np.int64)


def _streams(
    files: dict[str, list[Path]], numbers: dict[str, int], *, ranked: bool
) -> dict[str, Stream | None]:
    """The files by number; ``ranked`` numbers are ranks of the names, not part of them."""
    stems = {number: stem for stem, number in numbers.items()} if ranked else {}
    return {
        sensor: Stream(unique(paths, lambda path: numbers[path.stem], _BELONG), stems)
        if paths
        else None
        for sensor, paths in files.items()
    }


def _stamps(
    root: Path,
    numbers: NDArray[np.int64],
    name_stamps: NDArray[np.int64] | None,
    poses: Path | None,
) -> tuple[NDArray[np.int64], int | None]:
    """Stamps from the file names, else times.txt, else TUM poses, else at 10 Hz; their number.

    The number is that of the whole recording; None if nothing tells it.
    """
    times = root / "times.txt"
    if name_stamps is not None:
        return name_stamps[numbers], len(name_stamps)
    if times.exists():
        stamps = read_times(times)
        return pick(stamps, numbers, times), len(stamps)
    pose_stamps = read_poses(poses)[0] if poses else None
    if poses is None or pose_stamps is None:
        return regular_stamps(numbers, str(times)), None
    return pick(pose_stamps, numbers, poses), len(pose_stamps)


def _surround_files(root: Path, calibrated: Mapping[str, Camera]) -> dict[str, list[Path]]:
    """The images of the cameras in calib.yaml beside "left" and "right"."""
    found = {}
    for name in (name for name in calibrated if name not in LAYOUT):
        if paths := files_in(root / name, IMAGE_SUFFIXES):
            found[name] = paths
        else:
            logger.warning(
                "%s: no images of camera '%s' of the calibration in it", root / name, name
            )
    return found


def unread_files(root: Path, sensor: str) -> list[str]:
    """Say which files in the folders of a sensor without files are of a type that is not read."""
    folders, suffixes = LAYOUT[sensor]
    named = [root / name for name in folders if name != "."]
    return [problem for folder in named if (problem := unread_types(folder, suffixes))]


def is_folder(path: Path) -> bool:
    """Whether a folder has this layout."""
    return any(_files(path).values())
