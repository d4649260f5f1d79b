# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write pictures beside the report and embed them into it."""

import base64
import io
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from fusionslam.storage.files import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_COLORS = 128
"""Enough colours for drawings; it makes their files a quarter as large."""
_QUALITY = 80


@dataclass(frozen=True)
class Picture:
    """A PNG or JPEG with its caption.

    Attributes:
        name: file name beside the report.
        caption: what the picture shows.
        data: the file's bytes.
    """

    name: str
    caption: str
    data: bytes

    @property
    def data_uri(self) -> str:
        """The picture as a data URI, which needs no file."""
        kind = {".png": "png", ".jpg": "jpeg"}[Path(self.name).suffix]
        return f"data:image/{kind};base64," + base64.b64encode(self.data).decode("ascii")


def keep(
    folder: Path, name: str, figure: "Figure", caption: str, *, photo: bool = False
) -> Picture:
    """Render a figure, write it to the folder and return it.

    Args:
        folder: target folder.
        name: file name without its suffix.
        figure: figure to render.
        caption: what the picture shows.
        photo: True for camera images or clouds, stored as JPEG; drawings are stored as PNG.

    Raises:
        DataError: the folder cannot be written.
    """
    encode, end = (_jpeg, ".jpg") if photo else (_png, ".png")
    return _kept(folder, name + end, encode(_rendered(figure)), caption)


def write_png(path: str | os.PathLike[str], figure: "Figure") -> None:
    """Render a drawing and write it as PNG, whole or not at all. Raises DataError."""
    data = _png(_rendered(figure))
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_photo(path: str | os.PathLike[str], image: Image.Image) -> None:
    """Write a rendered picture as JPEG, whole or not at all. Raises DataError."""
    data = _jpeg(image)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def keep_photo(folder: Path, name: str, image: Image.Image, caption: str) -> Picture:
    """Write a rendered picture as JPEG, and return it. Arguments as for ``keep``."""
    return _kept(folder, name + ".jpg", _jpeg(image), caption)


def _kept(folder: Path, name: str, data: bytes, caption: str) -> Picture:
    picture = Picture(re.sub(r"[^\w.-]+", "-", name), caption, data)
    with atomic_path(folder / picture.name) as temporary:
        temporary.write_bytes(picture.data)
    return picture


def _rendered(figure: "Figure") -> Image.Image:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", facecolor="white")
    return Image.open(buffer).convert("RGB")


def _png(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    few = image.quantize(_COLORS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _jpeg(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=_QUALITY, optimize=True)
    return buffer.getvalue()
