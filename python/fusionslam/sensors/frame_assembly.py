# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Assembles a scan and its images into a frame."""

from collections.abc import Collection, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from fusionslam.base.arrays import Matrix
from fusionslam.errors import DataError
from fusionslam.sensors.camera_info import camera_from, cameras_from, check_size, rectify
from fusionslam.sensors.deskewing import motion_within, points_of
from fusionslam.sensors.frame import Camera, Frame
from fusionslam.sensors.messages import CameraInfo, Picture, Scan
from fusionslam.sensors.robot_frames import RobotFrames
from fusionslam.sensors.transforms import TransformError
from fusionslam.sensors.undone_motion import Deskew

_PAIR = ("left", "right")


def frame_from_pair(
    scan: Scan | None,
    pictures: Mapping[str, Picture],
    infos: Mapping[str, CameraInfo],
    frames: RobotFrames,
    *,
    surround: Mapping[str, Picture] | None = None,
    awaited: Collection[str] = (),
    index: int = 0,
    pose: Matrix | None = None,
    still: bool = False,
    deskews: bool = True,
    late: bool = False,
) -> Frame:
    """Assemble a scan and its images into a frame.

    Rays without return (NaN) are left out. The images are rectified on first access.

    Args:
        scan: None for a stereo pair alone, whose points are in the left camera's optical frame.
        pictures: by camera name; "left" and "right" together are a stereo pair.
        infos: calibration of each of them.
        frames: poses of sensors and robot.
        surround: images of further cameras. One whose calibration or place is not known, or does
            not fit its images, is no camera of the frame.
        awaited: those of them whose transforms may yet come.
        index: number of the frame.
        pose: float64 (4, 4), ground truth, if known.
        still: do not use odometry.
        deskews: whether the motion within the scan is undone, if it is known.
        late: whether nothing is waited for any more that may tell that motion.

    Raises:
        TransformError: a transform is not known at the time needed, or odometry jumps within the
            scan (a DataError).
        DataError: a calibration cannot be used, or an image has another size.
    """
    for name, picture in pictures.items():
        check_size(picture, infos[name], name)
    lead = scan or pictures["left"]
    around = surround or {}
    cameras = _place_cameras(scan, pictures, infos, frames, still)
    cameras |= _place_surround(scan, around, infos, frames, awaited)
    motion = None
    if scan is not None and deskews and not still:
        motion = motion_within(scan, frames, late=late)
    return Frame(
        index=index,
        stamp_ns=lead.stamp_ns,
        **({} if scan is None else _returns_of(scan, motion)),
        pose=pose,
        images={
            name: partial(rectify, picture, infos[name], name) if name in cameras else picture.image
            for name, picture in {**pictures, **around}.items()
        },
        cameras=cameras,
        odometry=None if still else frames.odometry_from_robot(lead.stamp_ns),
        robot_from_points=_robot_from_points(scan, pictures, infos, frames, still),
    )


def _returns_of(scan: Scan, motion: Deskew | None) -> dict[str, Any]:
    """What a frame is told of a scan without the rays that did not return."""
    values = {
        "points": points_of(scan, motion),
        "colors": scan.colors,
        "intensities": scan.intensities,
        "point_seconds": None if motion is not None else scan.point_seconds,
    }
    if not scan.returned.all():
        kept = scan.returned
        values = {name: None if each is None else each[kept] for name, each in values.items()}
    return {**values, "deskew": motion}


def _robot_from_points(
    scan: Scan | None,
    pictures: Mapping[str, Picture],
    infos: Mapping[str, CameraInfo],
    frames: RobotFrames,
    still: bool,
) -> Matrix | None:
    if scan is not None:
        return frames.robot_from(scan.frame_id, scan.stamp_ns)
    try:
        left = pictures["left"]
        return frames.robot_from(infos["left"].frame_id or left.frame_id, left.stamp_ns)
    except TransformError:
        # A stereo pair works without transforms, but waits for them while they may still arrive.
        if not still:
            raise
        return None


def _place_cameras(
    scan: Scan | None,
    pictures: Mapping[str, Picture],
    infos: Mapping[str, CameraInfo],
    frames: RobotFrames,
    still: bool,
) -> dict[str, Camera]:
    """Each camera with its pose when it took its image; the right one of a pair has the left's."""
    cameras: dict[str, Camera] = {}
    for name, picture in pictures.items():
        if name == "right" and "left" in pictures:
            continue
        place = np.eye(4)
        if scan is not None:
            optical = infos[name].frame_id or picture.frame_id
            place = frames.camera_from_points(
                optical, picture.stamp_ns, scan.frame_id, scan.stamp_ns, still=still
            )
        if name == "left":
            cameras |= cameras_from({k: infos[k] for k in pictures if k in _PAIR}, place)
        else:
            cameras[name] = camera_from(infos[name], place, name)
    return cameras


def _place_surround(
    scan: Scan | None,
    pictures: Mapping[str, Picture],
    infos: Mapping[str, CameraInfo],
    frames: RobotFrames,
    awaited: Collection[str],
) -> dict[str, Camera]:
    """The further cameras that can be placed, if need be as if the robot stood still.

    Raises:
        TransformError: the place of an awaited one may yet become known.
    """
    cameras: dict[str, Camera] = {}
    for name, picture in pictures.items():
        if name not in infos:
            continue
        given = scan, {name: picture}, infos, frames
        try:
            check_size(picture, infos[name], name)
            cameras |= _place_cameras(*given, still=False)
        except TransformError as error:
            if error.may_come and name in awaited:
                raise
            with suppress(DataError):
                cameras |= _place_cameras(*given, still=True)
        except DataError:
            continue
    return cameras
