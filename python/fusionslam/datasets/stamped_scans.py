# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Opens data sets of one scan file a frame, named by its stamp, beside a table of true poses."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.datasets.base import Dataset, FileDataset
from fusionslam.datasets.pose_files import (
    POSE_GAP_NS,
    check_same_time,
    interpolate_poses,
    match_poses,
)
from fusionslam.datasets.streams import (
    Request,
    Stream,
    choose,
    entries,
    frame_numbers,
    itself,
    one_of,
    scan,
)
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Cloud

_LATEST_NS = np.iinfo(np.int64).max


@dataclass(frozen=True, kw_only=True)
class StampedScans:
    """A layout of files of scans that are named by their stamps.

    Attributes:
        kind: name of the kind.
        title: of the data set, for display.
        scans: finds the folder of a sequence's scans; None if it is no sequence.
        read_scan: reads one of them.
        unit_ns: unit of the stamps in nanoseconds.
        truth: finds the table of a sequence's true poses; None if it is not there.
        read_truth: reads it: int64 (M) nanoseconds and float64 (M, 4, 4) world_from_body.
        pose_frame: the body that the poses describe.
        body_from_points: float64 (4, 4), maps points of a scan to that body.
        robot_from_points: float64 (4, 4), where the scanner is on the robot; None if unknown.
    """

    kind: str
    title: str
    scans: Callable[[Path], Path | None]
    read_scan: Callable[[Path], Cloud]
    unit_ns: int
    truth: Callable[[Path], Path | None]
    read_truth: Callable[[Path], tuple[NDArray[np.int64], Matrix]]
    pose_frame: str
    body_from_points: Matrix
    robot_from_points: Matrix | None = None

    def recognises(self, path: Path) -> bool:
        """Whether a folder is a sequence of this layout, or holds some."""
        return self.scans(path) is not None or any(map(self.scans, _folders(path)))

    def open(self, path: Path, request: Request) -> Dataset:
        """Open a sequence, or the requested one in a folder of several.

        Frame n is the n-th scan. Frames whose pose is unknown have one of NaN.

        Raises:
            DataError: no such sequence; the poses cannot be read, or are of another time.
        """
        root, folder = self._sequence(path, request.sequence)
        stream, name_stamps = _rank(scan(folder, (".bin",)), self.unit_ns)
        chosen = choose({"points": stream}, request, folder)
        numbers, gaps = frame_numbers(chosen, request)
        stamps_ns, recorded = name_stamps[numbers], len(name_stamps)
        truth, poses = request.poses or self.truth(root), None
        if request.poses:
            poses = match_poses(request.poses, numbers, stamps_ns, recorded=recorded)
        elif truth:
            poses = _poses_at(truth, *self.read_truth(truth), stamps_ns)
        return FileDataset(
            kind=self.kind,
            name=f"{self.title} {root.name}",
            root=root,
            streams=chosen,
            numbers=numbers,
            stamps_ns=stamps_ns,
            pose_frame=self.pose_frame,
            body_from_points=self.body_from_points,
            poses=poses,
            poses_file=truth,
            gaps=gaps,
            recorded=recorded,
            robot_from_points=self.robot_from_points,
            read_scan=self.read_scan,
        )

    def _sequence(self, path: Path, name: str | None) -> tuple[Path, Path]:
        """Folder of the sequence, and that of its scans."""
        if (scans := self.scans(path)) is not None:
            return itself(path, name), scans
        found = {
            folder.name: (folder, scans)
            for folder in _folders(path)
            if (scans := self.scans(folder)) is not None
        }
        root = one_of(path, {key: folder for key, (folder, _) in found.items()}, name)
        return found[root.name]


def _poses_at(
    path: Path,
    pose_stamps: NDArray[np.int64],
    poses: NDArray[np.float64],
    stamps_ns: NDArray[np.int64],
) -> Matrix:
    """Poses at the stamps of frames, float64 (N, 4, 4), interpolated between the two around each.

    They are NaN before the first pose, after the last, and between two that are more than 0.5 s
    apart (``POSE_GAP_NS``).

    Args:
        path: the file that the poses are of, for errors.
        pose_stamps: int64 (M), nanoseconds.
        poses: float64 (M, 4, 4).
        stamps_ns: int64 (N), of the frames.

    Raises:
        DataError: there are fewer than two poses, or all are before or after the frames.
    """
    if len(poses) < 2:
        raise DataError(
            f"{path} has {len(poses)} poses, expected two or more",
            code="too-short",
            fields=(str(path), "2"),
        )
    check_same_time(path, pose_stamps, stamps_ns)
    found, gaps_ns = interpolate_poses(pose_stamps, poses, stamps_ns)
    found[gaps_ns > POSE_GAP_NS] = np.nan
    return found


def _folders(path: Path) -> list[Path]:
    return [folder for folder in entries(path) if folder.is_dir()]


def _rank(stream: Stream | None, unit_ns: int) -> tuple[Stream | None, NDArray[np.int64]]:
    """Files that are numbered by their stamps: the same by rank, and the stamps, nanoseconds."""
    if stream is None:
        return None, np.empty(0, np.int64)
    stamps = sorted(stream.files)
    if (latest := stamps[-1] * unit_ns) > _LATEST_NS:
        path = stream.files[stamps[-1]]
        raise DataError(
            f"{path} is of {latest} ns by its name, which does not fit 64 bits",
            code="not-a-stamp",
            fields=(str(path),),
        )
    files = {rank: stream.files[stamp] for rank, stamp in enumerate(stamps)}
    ranked = Stream(files, {rank: path.stem for rank, path in files.items()})
    return ranked, np.array(stamps, dtype=np.int64) * unit_ns
