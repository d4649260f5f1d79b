# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Chunks of described frames, which an unfinished run keeps on disk."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.storage.archive import load_arrays, save_arrays

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Described:
    """One described frame: index, vectors, number of points, seconds by stage; or why it failed."""

    index: int
    vectors: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    points: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    reason: str | None = None


def save_chunk(path: Path, frames: Sequence[Described]) -> None:
    """Write some frames atomically. Raises DataError."""
    good, bad = [f for f in frames if f.reason is None], [f for f in frames if f.reason is not None]
    arrays: dict[str, NDArray[Any]] = {
        "rows": np.array([f.index for f in good], np.int64),
        "points": np.array([f.points for f in good], np.int64),
        "bad": np.array([f.index for f in bad], np.int64),
        "reasons": np.array([f.reason for f in bad], np.str_),
    }
    for first in good[:1]:
        for name in first.vectors:
            arrays[f"vectors.{name}"] = np.array([f.vectors[name] for f in good], np.float32)
        for stage in first.seconds:
            arrays[f"seconds.{stage}"] = np.array([f.seconds[stage] for f in good])
    save_arrays(path, arrays)


def joined_chunks(paths: Sequence[Path]) -> Arrays:
    """Concatenate the arrays of all chunks; those of frames are included only if there are any.

    Raises:
        DataError: a chunk cannot be read; the message names it.
    """
    chunks = []
    for path in paths:
        with load_arrays(path, "described frames; delete it and run again") as arrays:
            chunks.append(arrays)
    keys = dict.fromkeys(key for chunk in chunks for key in chunk)
    return {key: np.concatenate([c[key] for c in chunks if key in c]) for key in keys}


def partial_folder(folder: Path, source: str, names: Sequence[str], key: str) -> Path:
    """Return the folder that holds the chunks of a call until all are done."""
    return folder / f".partial-{source}-{'+'.join(names)}-{key}"


def forget_partial(folder: Path, source: str, names: Sequence[str]) -> None:
    """Delete the chunks of calls for these descriptors or some of them, whatever the settings."""
    for path in _partial_of(folder, source):
        if set(path.name.split("-")[2].split("+")) <= set(names):
            shutil.rmtree(path, ignore_errors=True)


def _partial_of(folder: Path, source: str) -> Iterator[Path]:
    return folder.glob(f".partial-{source}-*-*")
