# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Mipmaps (Williams 1983): textures at successively halved sizes, against aliasing."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fusionslam.base.arrays import Floats32

_WHITE = np.full((1, 1, 4), 255, np.uint8)


class MipMaps:
    """All textures of a scene and their mipmap levels in one flat array of packed RGBA texels.

    Args:
        images: uint8 (H, W, 4) each: RGB and tint. Sides are resized to powers of two.
            Without images, texture 0 is white and fully tinted.

    Attributes:
        texels: float32 (K,), number of texels of each texture's finest level.
    """

    def __init__(self, images: Sequence[NDArray[np.uint8]]) -> None:
        used = images if len(images) else [_WHITE]
        pyramids = [_pyramid(image) for image in used]
        self._last = max(len(pyramid) for pyramid in pyramids) - 1
        stored = [level for pyramid in pyramids for level in pyramid]
        # Rows of each texture's levels among all stored ones, (textures, levels); small textures
        # have fewer levels than large ones, and repeat their last one.
        counts = np.array([len(pyramid) for pyramid in pyramids])
        level_of = np.minimum(np.arange(self._last + 1), counts[:, None] - 1)
        rows = (np.cumsum(counts) - counts)[:, None] + level_of
        sizes = np.array([level.shape[0] * level.shape[1] for level in stored])
        self._width = np.array([level.shape[1] for level in stored], np.int32)[rows]
        self._height = np.array([level.shape[0] for level in stored], np.int32)[rows]
        self._start = (np.cumsum(sizes) - sizes).astype(np.int32)[rows]
        flat = np.concatenate([level.reshape(-1, 4) for level in stored])
        self._packed = flat.view(np.uint32).ravel()
        self.texels = (self._width[:, 0] * self._height[:, 0]).astype(np.float32)

    def sample(
        self, texture: NDArray[np.int32], u: Floats32, v: Floats32, level: Floats32
    ) -> Floats32:
        """Bilinear samples, float32 (R, 4) in 0 .. 1: RGB and tint.

        Args:
            texture: int32 (R,), index of the texture.
            u, v: float32 (R,), texture coordinates in images, v upwards; images repeat.
            level: float32 (R,), log2 of the number of texels that a pixel's width covers.
        """
        nearest = np.clip(np.rint(level), 0, self._last).astype(np.int32)
        width, height = self._width[texture, nearest], self._height[texture, nearest]
        start = self._start[texture, nearest]
        x0, right = _split(u, width)
        y0, lower = _split(-v, height)
        x1, y1 = (x0 + 1) & (width - 1), (y0 + 1) & (height - 1)
        top, bottom = start + y0 * width, start + y1 * width
        upper = self._mix(top + x0, top + x1, right)
        upper += lower[:, None] * (self._mix(bottom + x0, bottom + x1, right) - upper)
        upper *= np.float32(1 / 255)
        return upper

    def _mix(self, first: NDArray[np.int32], second: NDArray[np.int32], part: Floats32) -> Floats32:
        a, b = self._fetch(first), self._fetch(second)
        mixed: Floats32 = a + part[:, None] * (b - a)
        return mixed

    def _fetch(self, index: NDArray[np.int32]) -> Floats32:
        return self._packed[index].view(np.uint8).reshape(-1, 4).astype(np.float32)


def _split(coordinate: Floats32, size: NDArray[np.int32]) -> tuple[NDArray[np.int32], Floats32]:
    """Index of the texel before each coordinate, wrapped, and the fraction to the next, 0 .. 1."""
    whole = coordinate - np.floor(coordinate)
    place = whole * size.astype(np.float32) - np.float32(0.5)
    before = np.floor(place)
    return before.astype(np.int32) & (size - 1), (place - before).astype(np.float32)


def _pyramid(image: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """The image, its sides resized to powers of two, and its halvings."""
    height, width = (1 << (side - 1).bit_length() for side in image.shape[:2])
    if (height, width) != image.shape[:2]:
        image = np.asarray(Image.fromarray(image, "RGBA").resize((width, height)), np.uint8)
    levels = [image]
    while min(levels[-1].shape[:2]) > 1:
        fine = levels[-1].astype(np.uint16)
        total = fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]
        levels.append(((total + 2) // 4).astype(np.uint8))
    return levels
