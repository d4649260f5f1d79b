# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads tables of poses that begin with a stamp or a frame number, and gives frames theirs.

Frames without a pose have one of NaN: ``open_dataset`` leaves them out, or keeps it unknown.
"""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.pose_files import (
    POSE_GAP_NS,
    check_rotations,
    check_same_time,
    interpolate_poses,
    line_of,
)
from fusionslam.errors import DataError
from fusionslam.storage.arrays import Matrix
from fusionslam.storage.files import PathLike, reading


def read_table(
    path: PathLike, columns: int, expected: str, *, delimiter: str | None = None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read lines of an integer and numbers; # begins a comment.

    Args:
        path: of the file.
        columns: how many numbers follow the integer.
        expected: description of a line, for errors.
        delimiter: between numbers; None for blanks.

    Returns:
        int64 (N) and float64 (N, columns), N > 0; numbers may be NaN.

    Raises:
        DataError: the file is missing or empty, or a line is something else; the message names it.
    """
    path, row = Path(path), np.dtype([("key", "<i8"), ("values", "<f8", (columns,))])
    with reading(path, expected), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "loadtxt: input contained no data", UserWarning)
        # An integer with decimals would lose digits.
        warnings.simplefilter("error", DeprecationWarning)
        try:
            rows = np.loadtxt(path, dtype=row, delimiter=delimiter, ndmin=1, encoding="utf-8")
        except (ValueError, DeprecationWarning) as error:
            line = _find_bad_line(path, columns, delimiter)
            raise DataError(
                f"line {line}: expected {expected}",
                code="damaged-file",
                fields=(str(path), str(line)),
            ) from error
    if not rows.size:
        raise DataError(
            f"{path} is empty: expected {expected}", code="too-short", fields=(str(path), "1")
        )
    return rows["key"].astype(np.int64), rows["values"].astype(np.float64)


def _find_bad_line(path: Path, columns: int, delimiter: str | None) -> int:
    """Number (from 1) of the first line that is no row; 1 if none is found."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        key, *values = line.partition("#")[0].split(delimiter) or [""]
        if (key or values) and not (len(values) == columns and _are_numbers(key, values)):
            return number
    return 1


def _are_numbers(key: str, values: list[str]) -> bool:
    try:
        for value in values:
            float(value)
        return abs(int(key)) <= np.iinfo(np.int64).max
    except ValueError:
        return False


def read_matrices(
    path: PathLike, expected: str, *, delimiter: str | None = None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read lines of an integer and the 12 numbers of a row-major 3x4 matrix [R t].

    Returns:
        int64 (N) and float64 (N, 4, 4).

    Raises:
        DataError: as ``read_table``; a number is not finite, or R is no rotation.
    """
    path = Path(path)
    keys, rows = read_table(path, 12, expected, delimiter=delimiter)
    if (bad := np.flatnonzero(~np.isfinite(rows).all(axis=1))).size:
        line = line_of(path, bad[0])
        raise DataError(
            f"{path}, line {line}: NaN or infinity, expected {expected}",
            code="not-finite",
            fields=(str(path), str(line)),
        )
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    check_rotations(path, poses[:, :3, :3])
    return keys, poses


def poses_of_numbers(
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


def poses_at(
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
