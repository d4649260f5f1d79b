# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Replaces the camera calibration of a bag by that of a calib.yaml."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fusionslam.datasets.bags.topics import INFO_ROLES, info_role
from fusionslam.datasets.calibration import ON_ROBOT, read_calib_yaml, read_place_on_robot
from fusionslam.errors import DataError, naming
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.messages import CameraInfo, FrameTransform, FrameTransforms
from fusionslam.sensors.robot_frames import ROBOT_FRAMES

if TYPE_CHECKING:
    from fusionslam.datasets.bags.indexed_bag import IndexedBag

CALIBRATED = "camera of calib.yaml"
"""The camera's frame: a name that no robot uses, so that it cannot clash with the bag's TF."""


def apply_calibration(source: "IndexedBag", path: Path) -> None:
    """Use the cameras of a file instead of a bag's CameraInfo; its TF still places all else.

    ``robot_from_points`` of the file places the scanner on a robot that TF does not link to it.

    Images are used as they are: the projections are for images without distortion.

    Args:
        source: is modified.
        path: as ``read_calib_yaml`` reads it; every camera needs its ``size``.

    Raises:
        DataError: as ``read_calib_yaml``; no size, or the right camera's ``rectified_from_points``
            differs from the left one's.
    """
    cameras, place = read_calib_yaml(path), read_place_on_robot(path)
    if place is not None and "points" in source.roles:
        link = FrameTransform(
            stamp_ns=0,
            parent=source.frames.robot or ROBOT_FRAMES[0],
            child=source.series("points").frame_id,
            parent_from_child=place,
            static=True,
        )
        with naming(f"{path}: {ON_ROBOT}"):  # TF may link the scanner to something else
            source.frames.add(FrameTransforms(transforms=(link,)))
    if not cameras and place is not None:
        return
    if "left" not in cameras:
        raise DataError(f"{path} lacks camera 'left', which the images of a bag need")
    if "right" in cameras:
        left, right = (cameras[name].rectified_from_points for name in ("left", "right"))
        if not np.allclose(left, right):
            raise DataError(
                f"{path}: rectified_from_points of left and right differ, expected the same: the "
                "right projection has the baseline"
            )
    roles = dict(source.roles)
    for name, camera in cameras.items():
        roles[info_role(name)] = f"{path}, {name}"
        source.infos[f"{path}, {name}"] = [_camera_info(path, name, camera)]
    if "points" in roles:
        scanner = source.series("points").frame_id
        links = [
            FrameTransform(
                stamp_ns=0,
                parent=scanner,
                child=_frame_of(name),
                parent_from_child=camera.points_from_rectified,
                static=True,
            )
            for name, camera in cameras.items()
            if name != "right"
        ]
        source.frames.add(FrameTransforms(transforms=tuple(links)))
    source.roles = roles


def _frame_of(camera: str) -> str:
    return CALIBRATED if camera in INFO_ROLES else f"{camera} {CALIBRATED}"


def _camera_info(path: Path, name: str, camera: Camera) -> CameraInfo:
    if camera.size is None:
        raise DataError(f"{path}: {name} lacks size ([width, height])")
    return CameraInfo(
        stamp_ns=0,
        frame_id=_frame_of(name),
        size=camera.size,
        camera_matrix=camera.projection[:, :3],
        projection=camera.projection,
    )
