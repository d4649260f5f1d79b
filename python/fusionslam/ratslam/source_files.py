# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A source of views as one file, and back: it goes on as if nothing had been."""

import os

import numpy as np

from fusionslam.errors import DataError
from fusionslam.ratslam.view_sources import ViewSource
from fusionslam.storage.archive import load_archive, save_archive

FORMAT = "fusionslam.view_source.1"


def save_source(source: ViewSource, path: str | os.PathLike[str]) -> None:
    """Write one .npz, whole or not at all. Raises DataError where that is impossible."""
    arrays = {"views": np.frombuffer(source.to_bytes(), np.uint8)}
    save_archive(path, FORMAT, {"kind": source.kind}, arrays)


def restore_source(source: ViewSource, path: str | os.PathLike[str]) -> None:
    """Let a new source go on from what ``save_source`` wrote.

    Raises:
        DataError: missing, cut short, damaged, or of another kind of source; the message names the
            file.
    """
    with load_archive(path, FORMAT, "stored views") as (about, arrays):
        if about["kind"] != source.kind:
            raise DataError(f"holds the views of a {about['kind']}, expected {source.kind}")
        source.restore(arrays["views"].tobytes())
