# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A source of views as one file, and back: it goes on as if nothing had been."""

import json
import os
from pathlib import Path

import numpy as np

from fusionslam.errors import DataError
from fusionslam.ratslam.view_sources import ViewSource
from fusionslam.storage.files import atomic_path, reading

FORMAT = "fusionslam.view_source.1"


def save_source(source: ViewSource, path: str | os.PathLike[str]) -> None:
    """Write one .npz, whole or not at all. Raises DataError where that is impossible."""
    about = json.dumps({"format": FORMAT, "kind": source.kind})
    content = np.frombuffer(source.to_bytes(), np.uint8)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, about=np.array(about), views=content)


def restore_source(source: ViewSource, path: str | os.PathLike[str]) -> None:
    """Let a new source go on from what ``save_source`` wrote.

    Raises:
        DataError: missing, cut short, damaged, or of another kind of source; the message names the
            file.
    """
    with (
        reading(path, "no stored views"),
        Path(path).open("rb") as stream,
        np.load(stream, allow_pickle=False) as stored,
    ):
        about = json.loads(str(stored["about"]))
        if about["format"] != FORMAT:
            raise DataError(f"is of format {about['format']}, expected {FORMAT}")
        if about["kind"] != source.kind:
            raise DataError(f"holds the views of a {about['kind']}, expected {source.kind}")
        source.restore(stored["views"].tobytes())
