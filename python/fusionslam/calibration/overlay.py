# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a scan over its image, to check a calibration by eye."""

import os

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import depth_image
from fusionslam.base.files import atomic_path
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Camera

_DPI = 100


def draw_overlay(
    path: str | os.PathLike[str],
    points: NDArray[np.float32],
    image: NDArray[np.uint8],
    camera: Camera,
    *,
    size: float = 1.5,
) -> NDArray[np.float32]:
    """Write a PNG of the image's size with the visible points drawn in, near red, far blue.

    Args:
        path: of the picture.
        points: float32 (N, 3), metres, in the scan's frame.
        image: uint8 (H, W, 3) RGB or (H, W).
        camera: projects the points into the image.
        size: area of a point in square typographic points (a pixel is 0.72 points wide).

    Returns:
        float32 (H, W): the depth of the nearest point in each pixel, metres, 0 for none.

    Raises:
        DataError: matplotlib is missing, or the file cannot be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DataError("pictures need matplotlib: pip install 'fusionslam[report]'") from error
    height, width = image.shape[:2]
    points = points[np.isfinite(points).all(axis=1)]
    depth = depth_image(points, camera.projection_from_points, width=width, height=height)
    rows, columns = np.nonzero(depth)
    figure = Figure((width / _DPI, height / _DPI), dpi=_DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(image, cmap="gray", aspect="auto")
    colors = np.log(depth[rows, columns])
    axes.scatter(columns, rows, c=colors, s=size, cmap="turbo_r", linewidths=0)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_axis_off()
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")
    return depth
