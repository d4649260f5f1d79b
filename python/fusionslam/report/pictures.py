# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A picture is written beside the report and embedded into it."""

import base64
import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fusionslam._files import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """A PNG and what to see in it.

    Attributes:
        name: of the file beside the report.
        caption: what to see.
        png: the file's bytes.
    """

    name: str
    caption: str
    png: bytes

    @property
    def data_uri(self) -> str:
        """The picture as an address that needs no file."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode("ascii")


def keep(folder: Path, name: str, figure: "Figure", caption: str) -> Picture:
    """Render a figure, write it to the folder and return it. Raises DataError if unwritable."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", facecolor="white")
    picture = Picture(re.sub(r"[^\w.-]+", "-", name) + ".png", caption, buffer.getvalue())
    with atomic_path(folder / picture.name) as temporary:
        temporary.write_bytes(picture.png)
    return picture
