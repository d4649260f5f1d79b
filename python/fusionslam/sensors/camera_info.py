# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Makes rectified cameras and images from CameraInfo, for one camera or a stereo pair."""

from collections.abc import Mapping

import numpy as np

from fusionslam._core import rectify_image
from fusionslam.base.arrays import Image, Matrix
from fusionslam.errors import DataError, naming
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.messages import CameraInfo, Picture

# Relative tolerance: calibrations are printed with at least this precision.
_SAME = 1e-6


def camera_from(info: CameraInfo, camera_from_points: Matrix, name: str = "camera") -> Camera:
    """Make the rectified camera of a CameraInfo.

    Args:
        info: a projection of zeros, as sent by drivers without rectification, stands for K.
        camera_from_points: float64 (4, 4), maps points of the scan to the camera's optical frame.
        name: its name in errors: its topic.

    Raises:
        DataError: the camera matrix is all zeros, as of uncalibrated cameras, or is impossible.
    """
    rectified_from_camera = np.eye(4)
    rectified_from_camera[:3, :3] = info.rectification
    return _camera(info, rectified_from_camera @ np.asarray(camera_from_points), name)


def cameras_from(
    infos: Mapping[str, CameraInfo],
    left_from_points: Matrix,
    names: Mapping[str, str] | None = None,
) -> dict[str, Camera]:
    """Make the rectified cameras "left" and, of a stereo pair, "right".

    The right camera's projection is relative to the left one's rectified frame and contains the
    baseline (REP 104: P[0, 3] = -f * b). So both have the left one's pose, whichever frame the
    right CameraInfo names and wherever TF places that.

    Args:
        infos: by camera: "left" alone, or both.
        left_from_points: float64 (4, 4), maps points to the left camera's optical frame.
        names: their names in errors: their topics.

    Raises:
        DataError: as ``camera_from``; or the two are not a rectified pair, such as without a
            baseline or with different sizes.
    """
    called = names or {name: name for name in infos}
    left = camera_from(infos["left"], left_from_points, called["left"])
    if "right" not in infos:
        return {"left": left}
    check_pair(infos["left"], infos["right"], called)
    right = _camera(infos["right"], left.rectified_from_points, called["right"])
    return {"left": left, "right": right}


def check_pair(left: CameraInfo, right: CameraInfo, names: Mapping[str, str]) -> None:
    """Raise DataError unless two calibrations are those of a rectified stereo pair."""
    if left.size != right.size:
        raise DataError(
            f"CameraInfo of {names['right']} is for {right.size[0]}x{right.size[1]}, that of "
            f"{names['left']} for {left.size[0]}x{left.size[1]}: expected one size in a pair"
        )
    first, second = _projection(left, names["left"]), _projection(right, names["right"])
    # fx, fy and cy: equal rows of both images must see the same.
    rows = [(0, 0), (1, 1), (1, 2)]
    if not np.allclose([first[k] for k in rows], [second[k] for k in rows], rtol=_SAME, atol=_SAME):
        raise DataError(
            f"the projections P of {names['left']} and {names['right']} differ in focal length or "
            "rows: expected those of a rectified stereo pair"
        )
    if not first[0, 3] - second[0, 3] > 0:
        raise DataError(
            f"CameraInfo of {names['right']} has P[0, 3] = {second[0, 3]:g}, that of "
            f"{names['left']} {first[0, 3]:g}: a right camera's is -f * baseline from the left "
            "one's; calibrate them as a stereo pair"
        )


def rectify(picture: Picture, info: CameraInfo, name: str = "camera") -> Image:
    """Rectify and undistort an image for the projection of its CameraInfo.

    Raises:
        DataError: the image has another size than its CameraInfo says, or the calibration
            cannot be used.
    """
    check_size(picture, info, name)
    projection = _projection(info, name)
    same = np.array_equal(projection[:, :3], info.camera_matrix)
    if same and not info.distortion.any() and np.array_equal(info.rectification, np.eye(3)):
        return picture.image
    with naming(f"CameraInfo of {name}"):
        return rectify_image(
            picture.image,
            camera_matrix=info.camera_matrix,
            distortion=info.distortion,
            model=info.distortion_model,
            rectification=info.rectification,
            projection=projection,
            size=info.size,
        )


def check_size(picture: Picture, info: CameraInfo, name: str) -> None:
    """Raise DataError unless an image has the size that its CameraInfo says."""
    size = picture.image.shape[1], picture.image.shape[0]
    if size != tuple(info.size):
        raise DataError(
            f"the image of {name} is {size[0]}x{size[1]}, its CameraInfo says "
            f"{info.size[0]}x{info.size[1]}",
            code="image-size",
            fields=(name,),
        )


def _camera(info: CameraInfo, rectified_from_points: Matrix, name: str) -> Camera:
    projection = _projection(info, name)
    with naming(f"CameraInfo of {name}"):
        return Camera(projection, rectified_from_points, info.size)


def _projection(info: CameraInfo, name: str) -> Matrix:
    if not np.any(info.camera_matrix):
        raise DataError(
            f"CameraInfo of {name} has a camera matrix K of zeros: calibrate the camera"
        )
    if np.any(info.projection):
        return info.projection
    return np.hstack([info.camera_matrix, np.zeros((3, 1))])
