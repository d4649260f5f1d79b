# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Change stored files as earlier versions and other programs write them: without digests."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam import DescriptorIndex
from fusionslam.errors import DataError
from fusionslam.storage.archive import DIGEST


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


def write_as_former_detector(folder: Path) -> None:
    """Replace the file of a loop detector, aligned or not, by the files that version 0.1 wrote."""
    with np.load(folder / "detector.npz") as stored:
        arrays = dict(stored)
    about = json.loads(str(arrays["about"]))
    config, rows = about["loop_closure"], arrays["descriptors"]
    index = DescriptorIndex(
        rows.shape[1], window=config["window"], window_seconds=config["window_seconds"]
    )
    for row, stamp in zip(rows, arrays["stamps_ns"].tolist(), strict=True):
        index.add(row, stamp_ns=stamp)
    index.save(folder / "descriptors-0123456789ab.index")
    del config["max_frames"]
    kept = ("descriptor", "frames", "loop_closure", "descriptors", "fusion")
    content = {name: about[name] for name in kept}
    content |= {
        "format": "fusionslam.loop_detector.2",
        "index": "descriptors-0123456789ab.index",
    }
    (folder / "detector.json").write_text(json.dumps(content))
    if "scenes" in arrays:
        np.savez(
            folder / "scenes.npz",
            about=np.array('{"format": "fusionslam.aligned_loops.1"}'),
            scenes=arrays["scenes"],
            offsets=arrays["offsets"],
            stamps_ns=arrays["scene_stamps_ns"],
        )
    (folder / "detector.npz").unlink()


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
