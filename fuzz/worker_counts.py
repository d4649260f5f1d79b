# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The counts that a worker keeps in a file, which survives its crash."""

import mmap
import struct
from pathlib import Path

NAMES = ("accepted", "refused", "silent", "untyped")
_LAYOUT = struct.Struct(f"{len(NAMES)}q")


class Counts:
    """Counts in a memory-mapped file."""

    def __init__(self, folder: Path) -> None:
        path = folder / "counts"
        if not path.exists():
            path.write_bytes(bytes(_LAYOUT.size))
        with path.open("r+b") as stream:
            self._file = mmap.mmap(stream.fileno(), _LAYOUT.size)
        self._values = list(_LAYOUT.unpack(self._file[:]))

    def add(self, name: str) -> None:
        """Add one."""
        self._values[NAMES.index(name)] += 1
        self._file[:] = _LAYOUT.pack(*self._values)


def read_counts(folder: Path) -> tuple[int, ...]:
    """The counts so far, by ``NAMES``; zeros before the first input."""
    path = folder / "counts"
    return _LAYOUT.unpack(path.read_bytes()) if path.exists() else (0,) * len(NAMES)
