# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Thumbnails of scans: the camera image, or the coloured cloud from two viewpoints."""

import io
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from fusionslam.report.page.images import encode_jpeg
from fusionslam.sensors.frame import Cloud

Pixels = NDArray[np.uint8]

HEIGHT = 160
"""Height of a preview in pixels."""
_WIDTH = 300
_WIDEST = 16 * HEIGHT  # wider images are squeezed, to bound the size of files
_QUALITY = 72
_GROUND = (21, 24, 29)
_RING = (52, 58, 68)
_WORDS = (160, 166, 176)
_EYE = 0.15
"""Height of the viewpoint above the floor, metres: about that of a small robot's sensors."""
_GAMMA = 0.65  # brightens colours, which look darker on a dark background


@dataclass(frozen=True)
class Scale:
    """Scale at which all clouds of a drive are drawn.

    Attributes:
        reach: metres from the robot to the edge of the picture from above.
        side: degrees to the left and right covered by the forward picture.
        low, high: degrees, lower and upper edge of the forward picture.
        points: number of points of a typical cloud.
    """

    reach: float
    side: float
    low: float
    high: float
    points: int


def scale_of(clouds: Iterable[Cloud]) -> Scale:
    """Choose a scale that shows nearly all points of these clouds."""
    kept = [cloud.points for cloud in clouds if len(cloud)]
    if not kept:
        return Scale(reach=5.0, side=40.0, low=-15.0, high=15.0, points=1)
    ahead, up, far = _polar(np.concatenate(kept))
    low, high = np.percentile(up, (1, 99))
    return Scale(
        reach=float(np.percentile(far, 95)) + 0.2,
        side=float(np.clip(np.percentile(np.abs(ahead), 99.5) + 2, 10, 180)),
        low=float(low) - 1,
        high=float(high) + 1,
        points=int(np.median([len(points) for points in kept])),
    )


def image_preview(image: Pixels) -> bytes:
    """Make a JPEG of a camera image, uint8 (H, W, 3) RGB or (H, W), ``HEIGHT`` pixels high."""
    picture = Image.fromarray(image).convert("RGB")
    width = max(1, min(round(picture.width * HEIGHT / picture.height), _WIDEST))
    return encode_jpeg(picture.resize((width, HEIGHT), Image.Resampling.BOX), _QUALITY)


def missing_preview(words: str) -> bytes:
    """Make a JPEG with text that says why there is no picture."""
    picture = Image.new("RGB", (_WIDTH, HEIGHT), _GROUND)
    draw = ImageDraw.Draw(picture)
    draw.text(((_WIDTH - draw.textlength(words)) // 2, HEIGHT // 2 - 6), words, _WORDS)
    return encode_jpeg(picture, _QUALITY)


def cloud_preview(cloud: Cloud, scale: Scale) -> bytes:
    """Make a JPEG of a cloud in the robot's frame: as the robot sees it and (right) from above.

    Distant points are darker. Clouds without colours are coloured by distance.
    """
    picture = Image.new("RGB", (_WIDTH + HEIGHT + 4, HEIGHT), (255, 255, 255))
    picture.paste(Image.fromarray(_ahead(cloud, scale)), (0, 0))
    picture.paste(_from_above(cloud, scale), (_WIDTH + 4, 0))
    if not len(cloud):
        ImageDraw.Draw(picture).text((_WIDTH // 2 - 30, HEIGHT // 2 - 6), "no points", _WORDS)
    return encode_jpeg(picture, _QUALITY)


def side_by_side(left: bytes, right: bytes) -> Image.Image:
    """Join two previews into one picture, for files that show a pair."""
    pictures = [Image.open(io.BytesIO(data)).convert("RGB") for data in (left, right)]
    width = sum(picture.width for picture in pictures) + 12
    joined = Image.new("RGB", (width, HEIGHT), (255, 255, 255))
    joined.paste(pictures[0], (0, 0))
    joined.paste(pictures[1], (pictures[0].width + 12, 0))
    return joined


def _polar(
    points: NDArray[np.floating],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Degrees to the left, degrees upwards, and metres on the floor, from the viewpoint."""
    x, y, z = points.astype(np.float64).T
    far = np.hypot(x, y)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z - _EYE, far)), far


def _ahead(cloud: Cloud, scale: Scale) -> Pixels:
    """Uint8 (HEIGHT, _WIDTH, 3): the nearest point in each direction."""
    canvas = np.full((HEIGHT, _WIDTH, 3), _GROUND, dtype=np.uint8)
    ahead, up, far = _polar(cloud.points)
    column = ((scale.side - ahead) / (2 * scale.side) * _WIDTH).astype(np.int64)
    row = ((scale.high - up) / (scale.high - scale.low) * HEIGHT).astype(np.int64)
    seen = (column >= 0) & (column < _WIDTH) & (row >= 0) & (row < HEIGHT)
    order = np.flatnonzero(seen)[np.argsort(-far[seen], kind="stable")]
    if not order.size:
        return canvas
    filled = np.zeros((HEIGHT, _WIDTH), dtype=np.bool_)
    shaded = _shade(cloud, far, scale)
    # Of several points in a pixel the last one written, the nearest, remains.
    canvas[row[order], column[order]] = shaded[order]
    filled[row[order], column[order]] = True
    return _without_holes(canvas, filled, scale)


def _without_holes(canvas: Pixels, filled: NDArray[np.bool_], scale: Scale) -> Pixels:
    """Fill pixels between the rays with the colour of the nearest ray."""
    from scipy.ndimage import distance_transform_edt

    apart, (rows, columns) = distance_transform_edt(~filled, return_indices=True)
    reach = min(max(0.95 * (filled.size / scale.points) ** 0.5, 1.0), 9.0)
    near = apart <= reach
    canvas[near] = canvas[rows[near], columns[near]]
    return canvas


def _from_above(cloud: Cloud, scale: Scale) -> Image.Image:
    """Draw from above, the robot at the bottom, or in the middle if it sees behind itself."""
    picture = Image.new("RGB", (HEIGHT, HEIGHT), _GROUND)
    behind = scale.side > 95
    base = HEIGHT / 2 if behind else HEIGHT - 6
    per_metre = base / scale.reach if behind else (HEIGHT - 12) / scale.reach
    draw = ImageDraw.Draw(picture)
    step = next((s for s in (1, 2, 5, 10, 20, 50) if scale.reach / s <= 6), 100)
    for ring in range(1, int(scale.reach / step) + 2):
        wide = ring * step * per_metre
        box = (HEIGHT / 2 - wide, base - wide, HEIGHT / 2 + wide, base + wide)
        draw.ellipse(box, outline=_RING)
    draw.text((4, 2), f"rings {step} m", fill=_WORDS)
    draw.polygon(
        [(HEIGHT / 2, base - 6), (HEIGHT / 2 - 4, base + 4), (HEIGHT / 2 + 4, base + 4)], _WORDS
    )
    pixels = np.array(picture)
    x, y = cloud.points[:, 0].astype(np.float64), cloud.points[:, 1].astype(np.float64)
    row = (base - x * per_metre).astype(np.int64)
    column = (HEIGHT / 2 - y * per_metre).astype(np.int64)
    bright = _shade(cloud, np.hypot(x, y), scale, dark=1.0)
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        rows, columns = row + down, column + right
        inside = (rows >= 0) & (rows < HEIGHT) & (columns >= 0) & (columns < HEIGHT)
        pixels[rows[inside], columns[inside]] = bright[inside]
    return Image.fromarray(pixels)


def _shade(cloud: Cloud, far: NDArray[np.float64], scale: Scale, dark: float = 0.45) -> Pixels:
    """Uint8 (n, 3): colours, darker with distance; without colours yellow is near, blue far."""
    depth = np.clip(far / scale.reach, 0, 1)[:, None]
    if cloud.colors is None:
        mixed = (1 - depth) * np.array([253, 224, 90]) + depth * np.array([60, 80, 160])
        return np.asarray(mixed, dtype=np.uint8)
    bright = 255 * (cloud.colors.astype(np.float64) / 255) ** _GAMMA
    return np.asarray(bright * (1 - (1 - dark) * depth), dtype=np.uint8)
