# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Picture of a scan mistaken for another place, written while the robot drives."""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from fusionslam.base.argument_types import checked
from fusionslam.errors import DataError, ShapeError
from fusionslam.evaluation import JudgedView
from fusionslam.report.page.images import write_photo
from fusionslam.report.views.thumbnails import image_preview, missing_preview, side_by_side

_LINE = 15  # pixels
_MARGIN = 4


@checked
def write_false_positive(
    path: str | os.PathLike[str],
    judged: JudgedView,
    image: NDArray[np.uint8] | bytes | None,
    matched_image: NDArray[np.uint8] | bytes | None,
) -> None:
    """Write one JPEG of a scan and the one it was mistaken for, whole or not at all.

    The left half shows the current scan, the right half the scan that stored the view. The text
    below gives both scans, their distance and their times.

    Args:
        path: ends in .jpg or .jpeg; an older file is replaced.
        judged: result of ``RunningViews.add`` for the scan.
        image: uint8 (H, W, 3) RGB or (H, W), or its ``image_preview``; None without an image, which
            the picture says.
        matched_image: the same for scan ``judged.matched``.

    Raises:
        DataError: a scan that was not matched, another file type, or a file that cannot be written.
        ShapeError: an array that is not an image.
    """
    if Path(path).suffix.lower() not in (".jpg", ".jpeg"):
        raise DataError(f"cannot write {path}: expected a name that ends in .jpg")
    if judged.matched is None or judged.matched_stamp_ns is None:
        raise DataError(f"scan {judged.scan} was matched with none: there is nothing to show")
    then, now = judged.matched_stamp_ns, judged.stamp_ns
    lines = [
        f"left: scan {judged.scan} at {now / 1e9:.2f} s, recognised as view {judged.id}",
        f"right: scan {judged.matched} at {then / 1e9:.2f} s, the first of view {judged.id}",
        f"{judged.distance:.2f} m, {judged.angle:.0f} degrees and {(now - then) / 1e9:.1f} s apart",
    ]
    left = _preview(image, "image", judged.scan)
    picture = side_by_side(left, _preview(matched_image, "matched_image", judged.matched))
    measure = ImageDraw.Draw(picture).textlength
    width = max(picture.width, *(round(measure(line)) + 2 * _MARGIN for line in lines))
    height = picture.height + _LINE * len(lines) + 2 * _MARGIN
    whole = Image.new("RGB", (width, height), (255, 255, 255))
    whole.paste(picture, (0, 0))
    draw = ImageDraw.Draw(whole)
    for row, line in enumerate(lines):
        draw.text((_MARGIN, picture.height + _MARGIN + _LINE * row), line, (0, 0, 0))
    write_photo(path, whole)


def _preview(image: NDArray[np.uint8] | bytes | None, name: str, scan: int | None) -> bytes:
    if image is None:
        return missing_preview(f"no image of scan {scan}")
    if isinstance(image, bytes):
        return image
    if image.dtype != np.uint8 or image.shape[2:] not in ((), (3,)) or image.ndim < 2:
        raise ShapeError(f"{name} is {image.dtype} {image.shape}, expected uint8 (H, W, 3) RGB")
    if not image.size:
        raise ShapeError(f"{name} has no pixels: {image.shape}")
    return image_preview(image)
