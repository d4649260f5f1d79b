# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds what a chunk, message or file of a bag expands to.

rosbags, whose versions are pinned, decompresses whatever it finds and has no option for a limit:
its tables of decompressors are replaced, for the whole process. They are looked up by name in its
modules, deep in its readers, so a subclass of a reader would copy most of it. A program that uses
rosbags beside us reads the same bytes as before, and gets a ValueError for what expands beyond the
limit.
"""

import bz2
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

from fusionslam.storage.files import EXPANSION, MOST_EXPANDED, check_expansion


def bound_decompression() -> None:
    """Replace rosbags' decompressors by bounded ones. Needs rosbags."""
    import lz4.frame  # type: ignore[import-untyped]
    from rosbags.rosbag1 import reader as first
    from rosbags.rosbag2 import reader as second
    from rosbags.rosbag2 import storage_mcap as mcap

    zstd: Any = vars(second)["zstd"]  # of Python, or its backport
    if isinstance(zstd, SimpleNamespace):
        return
    makers: dict[str, Callable[[], Any]] = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": lz4.frame.LZ4FrameDecompressor,
        "zstd": zstd.ZstdDecompressor,
    }
    for name in ("bz2", "lz4"):
        first.decompressors[name] = partial(_expand, makers[name])
    for name in ("lz4", "zstd"):
        mcap.DECOMPRESSORS[name] = partial(_expand, makers[name])
    bounded = SimpleNamespace(
        open=lambda file, mode: _BoundedFile(zstd.open(file, mode), file),
        decompress=partial(_expand, makers["zstd"]),
    )
    vars(second)["zstd"] = bounded


def _expand(make: Callable[[], Any], data: bytes, declared: int | None = None) -> bytes:
    """Decompress all frames of ``data``.

    Raises:
        ValueError: they expand beyond the limit or beyond the declared size, or are cut short.
    """
    size, most = len(data), max(MOST_EXPANDED, EXPANSION * len(data))
    if declared is not None:
        check_expansion(declared, size)
        most = declared
    parts, total, decompressor = [], 0, make()
    while True:
        parts.append(decompressor.decompress(data, max_length=most - total + 1))
        total += len(parts[-1])
        if total > most:
            raise ValueError(f"{size} compressed bytes expand to more than {most}")
        data = b""
        if decompressor.eof:
            data = decompressor.unused_data or b""
            if not data:
                return b"".join(parts)
            decompressor = make()
        elif not parts[-1]:
            raise ValueError(f"{size} compressed bytes are cut short")


class _BoundedFile:
    """A compressed file whose reading ends with an error at the limit."""

    def __init__(self, stream: Any, file: Any) -> None:
        self._stream = stream
        self._size = file.seek(0, 2)
        self._total = 0
        file.seek(0)

    def read(self, count: int = -1) -> bytes:
        data: bytes = self._stream.read(count)
        self._total += len(data)
        check_expansion(self._total, self._size)
        return data

    def __enter__(self) -> "_BoundedFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()
