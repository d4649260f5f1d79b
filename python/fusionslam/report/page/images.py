# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write pictures beside the report and embed them into it."""

import base64
import io
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from PIL import Image

from fusionslam.base.files import atomic_path, write_file
from fusionslam.errors import DataError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")
_COLORS = 128
"""Enough colours for drawings; it makes their files a quarter as large."""


@dataclass(frozen=True)
class Picture:
    """A PNG or JPEG with its caption.

    Attributes:
        name: file name beside the report.
        caption: what the picture shows; empty where the page says it.
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
    folder: Path,
    name: str,
    figure: "Figure | None",
    caption: str = "",
    *,
    photo: bool = False,
    vector: bool = False,
) -> Picture | None:
    """Render a figure, write it to the folder and return it; None without a figure.

    Args:
        folder: target folder.
        name: file name without its suffix.
        figure: figure to render.
        caption: what the picture shows; empty where the page says it.
        photo: True for camera images or clouds, stored as JPEG; drawings are stored as PNG.
        vector: whether to write the figure as SVG and PDF as well, for papers.

    Raises:
        DataError: the folder cannot be written.
    """
    if figure is None:
        return None
    picture = draw_picture(name, figure, caption, photo=photo)
    write_file(folder / picture.name, picture.data)
    if vector:
        for kind, date in (("svg", "Date"), ("pdf", "CreationDate")):
            with atomic_path((folder / picture.name).with_suffix(f".{kind}")) as temporary:
                figure.savefig(temporary, format=kind, metadata={date: None})
    return picture


def draw_picture(name: str, figure: "Figure", caption: str = "", *, photo: bool = False) -> Picture:
    """Render a figure as a picture that is only embedded. Arguments as for ``keep``."""
    image = _render(figure)
    data = encode_jpeg(image) if photo else _encode_png(image)
    return Picture(_picture_file(f"{name}.{'jpg' if photo else 'png'}"), caption, data)


def keep_photo(folder: Path, name: str, image: Image.Image, caption: str) -> Picture:
    """Write a rendered picture as JPEG, and return it. Arguments as for ``keep``."""
    picture = Picture(_picture_file(f"{name}.jpg"), caption, encode_jpeg(image))
    write_file(folder / picture.name, picture.data)
    return picture


def write_png(path: str | os.PathLike[str], figure: "Figure") -> None:
    """Render a drawing and write it as PNG, whole or not at all. Raises DataError."""
    write_file(path, _encode_png(_render(figure)))


def write_photo(path: str | os.PathLike[str], image: Image.Image) -> None:
    """Write a rendered picture as JPEG, whole or not at all. Raises DataError."""
    write_file(path, encode_jpeg(image))


def encode_jpeg(image: Image.Image, quality: int = 80) -> bytes:
    """Return the bytes of a JPEG file."""
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=quality, optimize=True)
    return buffer.getvalue()


def forgive(reader: Callable[..., T] | None, missed: dict[str, None]) -> Callable[..., T | None]:
    """Wrap a reader of images or clouds so that it returns None on a DataError, or if it is None.

    The reasons become keys of ``missed``, in order.
    """

    def read(*which: Any) -> T | None:
        try:
            return reader(*which) if reader else None
        except DataError as error:
            missed[str(error)] = None
            return None

    return read


def _picture_file(name: str) -> str:
    return re.sub(r"[^\w.-]+", "-", name)


def _render(figure: "Figure") -> Image.Image:
    """Render as ``savefig`` does, which draws twice and packs the picture in between."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_facecolor("white")
    canvas: Any = FigureCanvasAgg(figure)  # its methods have no types
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _encode_png(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    few = image.quantize(_COLORS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()
