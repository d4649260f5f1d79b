# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Change stored files as other programs write them: without digests."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.base.archive import DIGEST
from fusionslam.errors import DataError


def change_archive(
    path: Path, change: Callable[[dict[str, Any], dict[str, Any]], Any] | None = None, **arrays: Any
) -> None:
    """Write an archive again with its metadata and its arrays changed, without digests.

    Args:
        path: of the archive.
        change: called with the metadata and the arrays; changes them in place.
        arrays: replace those of the archive.
    """
    with np.load(path) as stored:
        content = {name: stored[name] for name in stored.files} | arrays
    about = json.loads(str(content.pop("about")))
    for name in (DIGEST, "array_digests"):
        about.pop(name, None)
    if change is not None:
        change(about, content)
    with path.open("wb") as stream:
        np.savez(stream, about=np.array(json.dumps(about)), **content)


def change_json(path: Path, **changes: Any) -> None:
    """Write a JSON file again with some values changed, without digest."""
    content = json.loads(path.read_text(encoding="utf-8"))
    content.pop(DIGEST, None)
    path.write_text(json.dumps(content | changes), encoding="utf-8")


def check_damaged_files(path: Path, load: Callable[[Path], object]) -> None:
    """A file that is cut short, that another program wrote or that is missing is named."""
    whole = path.read_bytes()
    cut = [whole[:size] for size in (0, 10, len(whole) // 3, len(whole) - 1)]
    for content in (*cut, b"a text of others", None):
        path.unlink()
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(DataError) as caught:
            load(path)
        assert str(path) in str(caught.value), caught.value
    path.write_bytes(whole)
