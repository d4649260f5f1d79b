# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras of a calib.yaml in the place of what a bag says of them, or does not say."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fusionslam.datasets.bags.topics import INFO_ROLES
from fusionslam.datasets.calibration import read_calib_yaml
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.messages import CameraInfo, FrameTransform, FrameTransforms

if TYPE_CHECKING:
    from fusionslam.datasets.bags.indexed_bag import IndexedBag

CALIBRATED = "camera of calib.yaml"
"""The camera's frame: no robot calls one so, so that it cannot meet a frame of the bag's TF."""


def calibrated(source: "IndexedBag", path: Path) -> "IndexedBag":
    """The bag with the cameras of a file; its own CameraInfo is not used, its TF keeps the rest.

    Images are taken as they are: the projections are those of images without distortion.

    Args:
        source: its index is changed.
        path: as ``read_calib_yaml`` reads it; every camera needs its ``size``.

    Raises:
        DataError: as ``read_calib_yaml``; no size, or a right camera elsewhere than the left one.
    """
    cameras = read_calib_yaml(path)
    if "left" not in cameras:
        raise DataError(f"{path} lacks camera 'left', which the images of a bag need")
    _check_right(path, cameras)
    roles = dict(source.roles)
    for name, camera in cameras.items():
        roles[INFO_ROLES[name]] = f"{path}, {name}"
        source.index.infos[f"{path}, {name}"] = [_camera_info(path, name, camera)]
    if "points" in roles:
        scanner = source.series("points").frame_id
        link = FrameTransform(
            stamp_ns=0,
            parent=scanner,
            child=CALIBRATED,
            parent_from_child=cameras["left"].points_from_rectified,
            static=True,
        )
        source.index.frames.add(FrameTransforms(transforms=(link,)))
    return replace(source, roles=roles)


def _check_right(path: Path, cameras: dict[str, Camera]) -> None:
    """A right camera's place is in its projection, counted from the left one's."""
    if "right" not in cameras:
        return
    left, right = (cameras[name].rectified_from_points for name in ("left", "right"))
    if not np.allclose(left, right):
        raise DataError(
            f"{path}: rectified_from_points of left and right differ, expected the same: the "
            "right projection has the baseline"
        )


def _camera_info(path: Path, name: str, camera: Camera) -> CameraInfo:
    if camera.size is None:
        raise DataError(f"{path}: {name} lacks size ([width, height])")
    return CameraInfo(
        stamp_ns=0,
        frame_id=CALIBRATED,
        size=camera.size,
        camera_matrix=camera.projection[:, :3],
        projection=camera.projection,
    )
