# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""FAISS's index of the rows of a table, in a file that is written once."""

import hashlib
import math
import secrets
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.arrays import Floats32, Integers, Mask
from fusionslam.base.files import atomic_path, cannot_write, why_not
from fusionslam.errors import DataError, needing

FOLDER = "segments"
_VECTORS = ".npy"
_TRAINING = 64  # rows for each list

Blocks = Callable[[], Iterable[tuple[Integers, Floats32]]]
"""Yields numbers (n) and vectors (n, D) of all rows, some thousands at a time."""


class Segment:
    """An inverted file with one byte a value, and the vectors themselves, by number of the row.

    Both stay on the disk and are mapped to memory. Several threads may search.

    Args:
        path: of FAISS's file; that of the vectors lies beside it.
        digest: that both have to have, as of ``digest_of``. They are read for it, a second or two
            for each GB, before FAISS and NumPy parse them.

    Attributes:
        name: of the file.
        vectors: float32 (n, D), by number of the row; zeros where there is none.

    Raises:
        DataError: it cannot be read (code "damaged").
        FusionSlamError: FAISS is not installed (code "missing-extra").
    """

    def __init__(self, path: Path, digest: str) -> None:
        faiss = _load()
        self.name = path.name
        try:
            if digest_of(path) != digest:
                raise ValueError("it, or its vectors, was changed after it was written")
            self._index = faiss.read_index(str(path), faiss.IO_FLAG_MMAP_IFC)
            self.vectors: Floats32 = np.load(path.with_suffix(_VECTORS), mmap_mode="r")
            rows, length = self.vectors.shape
            if self._index.ntotal > rows or self._index.d != length:
                raise ValueError(
                    f"it says {self._index.ntotal} rows of {self._index.d} numbers, expected at "
                    f"most {rows} of {length}, as its vectors"
                )
        except Exception as error:  # headers that others made, digest and all, raise anything
            why = getattr(error, "strerror", None) or str(error).rpartition("\n")[2]
            raise DataError(
                f"{path} cannot be read: {why}", code="damaged", fields=(str(path),)
            ) from error

    def __len__(self) -> int:
        return int(self._index.ntotal)

    @property
    def lists(self) -> int:
        """Number of its lists."""
        return int(self._index.nlist)

    def search(self, queries: Floats32, nprobes: int, count: int, allowed: Mask | None) -> Integers:
        """Find rows that may be near.

        Args:
            queries: float32 (q, D).
            nprobes: lists that are searched, at most all.
            count: of rows to find for each query.
            allowed: bool (n), by number of a row, which rows may be found; None for all.

        Returns:
            int64 (q, count), numbers of rows, the nearest first; -1 where there are no more.
        """
        faiss = _load()
        bits = None if allowed is None else np.packbits(allowed, bitorder="little")
        parameters = faiss.SearchParametersIVF(
            nprobe=min(nprobes, self.lists),
            sel=None if bits is None else faiss.IDSelectorBitmap(bits),
        )
        rows: Integers = self._index.search(queries, count, params=parameters)[1]
        return rows


def size_of(path: Path) -> int:
    """Bytes of a segment. Raises OSError if it is not there."""
    return path.stat().st_size + path.with_suffix(_VECTORS).stat().st_size


def digest_of(path: Path) -> str:
    """SHA-256 of a segment's files, in hexadecimal. Raises OSError: one is not there."""
    digests = []
    for each in (path, path.with_suffix(_VECTORS)):
        with each.open("rb") as file:
            digests.append(hashlib.file_digest(file, "sha256").hexdigest())
    return "-".join(digests)


def write_segment(
    folder: Path, rows: int, last_row: int, blocks: Blocks, progress: Callable[[str], None]
) -> Path:
    """Build a segment and write its files, each whole or not at all.

    Args:
        folder: which is made if it is not there.
        rows: number of them, at least 1.
        last_row: the greatest number of a row.
        blocks: all rows; called twice.
        progress: called with a line of text for each step.

    Returns:
        Path of FAISS's file.

    Raises:
        DataError: it cannot be written (code "cannot-write").
    """
    faiss = _load()
    lists = math.isqrt(rows)
    every = max(1, rows // (_TRAINING * lists))
    progress(f"{lists} lists")
    sample = np.vstack([vectors[::every].copy() for _, vectors in blocks()])
    index: Any = faiss.index_factory(sample.shape[1], f"IVF{lists},SQ8")
    index.train(sample)
    path = folder / f"{secrets.token_hex(8)}.faiss"
    try:
        with (
            atomic_path(path.with_suffix(_VECTORS)) as temporary,
            _VectorFile(temporary, last_row + 1, sample.shape[1]) as file,
        ):
            for numbers, vectors in blocks():
                index.add_with_ids(vectors, numbers)
                file.write(numbers, vectors)
                progress(f"{index.ntotal} of {rows} rows")
        with atomic_path(path) as temporary:
            faiss.write_index(index, str(temporary))
    except (OSError, RuntimeError) as error:  # FAISS raises the latter when the disk is full
        reason = why_not(path, error) if isinstance(error, OSError) else str(error).splitlines()[-1]
        raise cannot_write(path, reason) from error
    return path


class _VectorFile:
    """An array in NumPy's format, of which rows that are not written take no room on the disk.

    It is not mapped to memory: a full disk would kill the process.
    """

    def __init__(self, path: Path, rows: int, length: int) -> None:
        empty = np.lib.format.open_memmap(path, "w+", np.float32, (rows, length))
        self._begin, self._row_bytes = empty.offset, empty.itemsize * length
        self._file = path.open("r+b")

    def __enter__(self) -> "_VectorFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, numbers: Integers, vectors: Floats32) -> None:
        """Write rows by their numbers, which are mostly consecutive."""
        breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
        for some, rows in zip(np.split(numbers, breaks), np.split(vectors, breaks), strict=True):
            if len(some):
                self._file.seek(self._begin + int(some[0]) * self._row_bytes)
                self._file.write(rows.tobytes())


def delete_segments(folder: Path, *, but: str) -> None:
    """Delete the segments that no process will open any more.

    Args:
        folder: of them.
        but: name of the one that stays; "" for none.
    """
    if folder.is_dir():
        for path in folder.iterdir():
            if path.stem != Path(but).stem:
                path.unlink(missing_ok=True)


def _load() -> Any:
    """FAISS's module.

    Raises:
        FusionSlamError: it is not installed (code "missing-extra").
    """
    with needing("fleet", "the index of places needs FAISS"):
        import faiss
    return faiss
