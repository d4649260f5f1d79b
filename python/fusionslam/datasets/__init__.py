# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads recordings as frames: public data sets, plain folders, bags and range recordings.

>>> dataset = open_dataset("kitti/dataset", sequence="06")  # doctest: +SKIP
>>> dataset[0].points.shape, dataset[0].images["left"].shape  # doctest: +SKIP
((123397, 3), (370, 1226, 3))
"""

import logging
import os
import stat
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from fusionslam.base.archive import format_of
from fusionslam.base.argument_types import checked
from fusionslam.base.files import check_regular, is_map_file
from fusionslam.config import explain_choice
from fusionslam.datasets.bags import open_bag, open_writer
from fusionslam.datasets.bags.reader import bag_kind
from fusionslam.datasets.base import Dataset
from fusionslam.datasets.calibration import Calibration, read_calib_yaml, read_calibration
from fusionslam.datasets.cloud_files import (
    read_bin,
    read_cloud,
    read_image,
    read_pcd,
    read_ply,
    write_cloud,
)
from fusionslam.datasets.folder import unread_files
from fusionslam.datasets.kinds import KINDS, Kind
from fusionslam.datasets.pose_files import (
    match_poses,
    read_poses,
    read_poses_kitti,
    read_poses_tum,
    read_times,
    read_timestamps,
    write_poses_kitti,
    write_poses_tum,
)
from fusionslam.datasets.range_recording import is_recording
from fusionslam.datasets.streams import (
    SENSORS,
    Request,
    absolute_path,
    check_self_contained,
    entries,
)
from fusionslam.errors import ConfigError, DataError
from fusionslam.sensors.synchronizer import SyncConfig

__all__ = [
    "KINDS",
    "SENSORS",
    "Calibration",
    "Dataset",
    "match_poses",
    "open_bag",
    "open_dataset",
    "open_writer",
    "read_bin",
    "read_calib_yaml",
    "read_calibration",
    "read_cloud",
    "read_image",
    "read_pcd",
    "read_ply",
    "read_poses",
    "read_poses_kitti",
    "read_poses_tum",
    "read_times",
    "read_timestamps",
    "write_cloud",
    "write_poses_kitti",
    "write_poses_tum",
]

GAPS = ("error", "skip")
WITHOUT_POSE = ("skip", "keep")
logger = logging.getLogger(__name__)


@checked
def open_dataset(
    path: str | os.PathLike[str],
    *,
    kind: str | None = None,
    sequence: str | int | None = None,
    sensors: Sequence[str] | None = None,
    gaps: str = "error",
    poses: str | os.PathLike[str] | None = None,
    topics: Mapping[str, str] | None = None,
    stamps: str = "header",
    sync: SyncConfig | None = None,
    calibration: str | os.PathLike[str] | None = None,
    shapes: str | None = None,
    deskew: bool = True,
    without_pose: str = "skip",
) -> Dataset:
    """Open a recording; scans and images are read only when they are accessed.

    Args:
        path: folder of one sequence or of several; a bag; or a range recording.
        kind: one of ``KINDS``; None detects it from the content.
        sequence: the one to open if the folder holds several: "06" (or 6), a drive, "testing".
        sensors: those that every frame must have, of "points", "left", "right"; None for all
            that have files. Files of other sensors are ignored.
        gaps: "error" if a sensor lacks a file for a frame number between the first and the last;
            "skip" leaves such frames out. Bags are always read as with "skip".
        poses: file in KITTI or TUM format to use instead of the one found beside the data. Frames
            just before or after its times are left out (``match_poses``).
        topics: topics of a bag by role, for those not to be guessed: "points", "left",
            "camera_info", "right", "right_camera_info", "odometry", "truth".
        stamps: time at which the messages of a bag were measured: that of their "header", or
            that of their arrival in the "bag".
        sync: how images of a bag are paired with scans.
        calibration: calib.yaml to use instead of the one of a plain folder, or instead of a
            bag's CameraInfo and TF.
        shapes: shapes that the scanner of a range recording saw, "visual" or "collision"; None
            for visual if the recording has both.
        deskew: whether motion within the scans of a bag is undone by odometry, or an IMU, and the
            times of points (``Frame.deskew``); False for clouds whose driver did so.
        without_pose: "skip" leaves out frames whose pose is unknown while others have one, and
            logs how many; "keep" keeps them, with a pose of NaN.

    Raises:
        DataError: the path does not exist, is not a known recording, is a map (code "is-map") or
            has no frames; or a file is missing, too short or malformed; the message names it and
            what was expected.
        ConfigError: an unknown kind, sensor or value of ``gaps`` or ``without_pose``; topics for
            anything but a bag; or a calibration for a recording that has its own.
    """
    root = _root(path)
    _one_of("gaps", gaps, GAPS)
    _one_of("without_pose", without_pose, WITHOUT_POSE)
    if sensors is not None:
        sensors = [sensors] if isinstance(sensors, str) else list(sensors)
        for name in sensors or [""]:
            _one_of("sensors", name, SENSORS)
    request = Request(
        None if sequence is None else str(sequence),
        sensors,
        gaps,
        Path(poses) if poses else None,
        topics or {},
        stamps,
        sync or SyncConfig(),
        Path(calibration).expanduser().resolve() if calibration else None,
        shapes,
        deskew,
    )
    try:
        found = _kind(root, kind)
        if topics and not found.topics:
            raise ConfigError(
                f"topics (--topic) are of bags, but {root} is of kind {found.name}",
                code="other-kind",
                fields=(str(root), found.name),
            )
        if calibration and not found.calibration:
            raise ConfigError(
                f"a calibration can be given for bags and plain folders, but {root} is of kind "
                f"{found.name}, whose own files are read",
                code="other-kind",
                fields=(str(root), found.name),
            )
        dataset = found.open(root, request)
        return dataset if without_pose == "keep" else _with_poses(dataset)
    except PermissionError as error:
        message = f"{error.filename} cannot be read: {error.strerror}"
        raise DataError(message, code="unreadable", fields=(str(error.filename),)) from error


def _with_poses(dataset: Dataset) -> Dataset:
    """Leave out the frames without a pose; all without poses if none has one. The log says so."""
    if dataset.poses is None:
        return dataset
    known = np.isfinite(dataset.poses).all(axis=(1, 2))
    if known.all():
        return dataset
    if not known.any():
        logger.warning("%s: none of %d frames has a pose", dataset.name, len(dataset))
        return replace(dataset, poses=None)
    count = np.count_nonzero(~known)
    logger.warning(
        "%s: %d of %d frames have no pose and are left out", dataset.name, count, len(dataset)
    )
    return dataset.only(np.flatnonzero(known).tolist())


def _root(path: str | os.PathLike[str]) -> Path:
    root = absolute_path(path)
    try:
        mode = root.stat().st_mode
    except FileNotFoundError as error:
        message = f"{root} does not exist: expected a recording"
        raise DataError(message, code="missing-file", fields=(str(root),)) from error
    except OSError as error:
        message = f"{root} cannot be read: {error.strerror}"
        raise DataError(message, code="unreadable", fields=(str(root),)) from error
    check_regular(root, "a recording")
    if is_map_file(root):
        raise DataError(
            f"{root} is a map, expected a recording: fusionslam map show says what is in it, map "
            "check whether it is damaged",
            code="is-map",
            fields=(str(root),),
        )
    if not stat.S_ISDIR(mode) and bag_kind(root) is None and not is_recording(root):
        message = f"{root} is a file: expected the folder of a recording, or a bag"
        fields = [str(root)]
        if format := format_of(root):
            message = f"{root} holds results ({format}), expected a recording; info describes it"
            fields.append(format)
        elif root.suffix == ".npz":
            message = f"{root} is no scene set and no range recording, or it is cut short"
        raise DataError(message, code="no-recording", fields=fields)
    return root


def _kind(root: Path, name: str | None) -> Kind:
    if name is not None:
        _one_of("kind", name, KINDS)
        if name != "ranges" and is_recording(root):
            check_self_contained(root, "a range recording", {"--kind": name})
        return KINDS[name]
    possible = (kind for kind in KINDS.values() if root.is_dir() or not kind.folder)
    recognised = next((kind for kind in possible if kind.recognises(root)), None)
    if recognised is None:
        looked_for = "; ".join(f"{kind.name}: {kind.layout}" for kind in KINDS.values())
        inner = None
        for path in entries(root):
            with suppress(OSError):  # of a folder that cannot be read
                if path.is_dir() and any(kind.recognises(path) for kind in KINDS.values()):
                    inner = path
                    break
        near = "" if inner is None else f", but {inner} is one"
        unread = [problem for sensor in SENSORS for problem in unread_files(root, sensor)]
        parts = [f"{root} is no recording that is known here{near}", *unread]
        message = "; ".join([*parts, f"looked for {looked_for}"])
        raise DataError(message, code="no-recording", fields=(str(root),))
    return recognised


def _one_of(key: str, value: str, values: Collection[str]) -> None:
    if value not in values:
        problem = explain_choice(value, values)
        raise ConfigError(f"{key} is {value!r}, {problem}", code="choice", fields=(key, value))
