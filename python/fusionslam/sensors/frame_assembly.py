# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Assembles a scan and its images into a frame."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from fusionslam.sensors.camera_info import camera_from, cameras_from, check_size, rectify
from fusionslam.sensors.frame import Camera, Cloud, Frame
from fusionslam.sensors.messages import CameraInfo, Picture, Scan
from fusionslam.sensors.robot_frames import RobotFrames
from fusionslam.sensors.transforms import TransformError
from fusionslam.storage.arrays import Matrix

_PAIR = ("left", "right")


def frame_from_pair(
    scan: Scan | None,
    pictures: Mapping[str, Picture],
    infos: Mapping[str, CameraInfo],
    frames: RobotFrames,
    *,
    index: int = 0,
    pose: Matrix | None = None,
    still: bool = False,
) -> Frame:
    """Assemble a scan and its images into a frame.

    Rays without return (NaN) are left out. The images are rectified on first access.

    Args:
        scan: None for a stereo pair alone, whose points are in the left camera's optical frame.
        pictures: by camera name; "left" and "right" together are a stereo pair.
        infos: calibration of each of them.
        frames: poses of sensors and robot.
        index: number of the frame.
        pose: float64 (4, 4), ground truth, if known.
        still: do not use odometry.

    Raises:
        TransformError: a transform is not known at the time needed (a DataError).
        DataError: a calibration cannot be used, or an image has another size.
    """
    for name, picture in pictures.items():
        check_size(picture, infos[name], name)
    lead = scan or pictures["left"]
    cloud = _select_returns(scan)
    return Frame(
        index=index,
        stamp_ns=lead.stamp_ns,
        points=None if cloud is None else cloud.points,
        colors=None if cloud is None else cloud.colors,
        intensities=None if cloud is None else cloud.intensities,
        pose=pose,
        images={name: partial(rectify, p, infos[name], name) for name, p in pictures.items()},
        cameras=_place_cameras(scan, pictures, infos, frames, still),
        odometry=None if still else frames.odometry_from_robot(lead.stamp_ns),
        robot_from_points=_robot_from_points(scan, pictures, infos, frames, still),
    )


def _select_returns(scan: Scan | None) -> Cloud | None:
    """Points, colours and intensities of the rays that returned."""
    if scan is None:
        return None
    valid = np.isfinite(scan.points).all(axis=1)
    points = scan.points if valid.all() else scan.points[valid]
    return Cloud(
        points,
        None if scan.colors is None else scan.colors[valid],
        None if scan.intensities is None else scan.intensities[valid],
    )


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
        return frames.robot_from(_optical_frame("left", pictures, infos), pictures["left"].stamp_ns)
    except TransformError:
        # A stereo pair works without transforms, but waits for them while they may still arrive.
        if not still:
            raise
        return None


def _optical_frame(
    name: str, pictures: Mapping[str, Picture], infos: Mapping[str, CameraInfo]
) -> str:
    return infos[name].frame_id or pictures[name].frame_id


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
            optical = _optical_frame(name, pictures, infos)
            place = frames.camera_from_points(
                optical, picture.stamp_ns, scan.frame_id, scan.stamp_ns, still=still
            )
        if name == "left":
            cameras |= cameras_from({k: infos[k] for k in pictures if k in _PAIR}, place)
        else:
            cameras[name] = camera_from(infos[name], place, name)
    return cameras
