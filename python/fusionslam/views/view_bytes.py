# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views as bytes, exact: one process makes them of clouds, another one recognises them.

    data = view_to_bytes(builder, builder.view(cloud))
    match = matcher.process(view_from_bytes(matcher.comparison, data))

gives what ``matcher.process(cloud)`` gives if both were configured alike: ``builder`` is
``comparison_of(config.views, config.descriptors)``.
"""

import io
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError, FusionSlamError
from fusionslam.views.comparisons import Comparison, View

FORMAT = b"fusionslam.view.1\n"
_KIND = "comparison"
_SUM = 4  # bytes of the check sum
# What numpy and zipfile raise where others wrote the content.
_FOREIGN = (
    ValueError,
    TypeError,
    EOFError,
    AttributeError,
    OSError,
    RuntimeError,
    MemoryError,
    zlib.error,
    zipfile.BadZipFile,
)
_ADVICE = "who builds views and who matches them need the same configuration of views"


def view_to_bytes(comparison: Comparison, view: View) -> bytes:
    """A view that ``comparison`` made: format, check sum (CRC-32, little endian), and a .npz."""
    stream = io.BytesIO()
    arrays: dict[str, Any] = {_KIND: np.array(comparison.kind), **comparison.arrays_of(view)}
    np.savez(stream, **arrays)
    content = stream.getvalue()
    return FORMAT + zlib.crc32(content).to_bytes(_SUM, "little") + content


def view_from_bytes(comparison: Comparison, data: bytes) -> View:
    """The view that ``view_to_bytes`` wrote, to the bit.

    Args:
        comparison: as configured where the view was made.
        data: what was written there.

    Raises:
        DataError: bytes that are cut short, damaged, of another version, no view, or one of
            another comparison; the message says what was found and expected.
    """
    content = _content(data)
    try:
        arrays = _arrays(content)
        kind = str(arrays[_KIND])
        if kind != comparison.kind:
            raise DataError(f"is for comparison {kind}, expected {comparison.kind}")
        return comparison.view_of(arrays)
    except KeyError as error:
        raise DataError(f"view: no array {error}; {_ADVICE}") from error
    except FusionSlamError as error:
        raise DataError(f"view: {error}; {_ADVICE}") from error


def _content(data: bytes) -> bytes:
    """What the check sum is of. Raises DataError."""
    if not data.startswith(FORMAT):
        expected = FORMAT.decode().strip()
        raise DataError(f"view: begins with {bytes(data[: len(FORMAT)])!r}, expected {expected}")
    start = len(FORMAT) + _SUM
    content = data[start:]
    if zlib.crc32(content) != int.from_bytes(data[len(FORMAT) : start], "little"):
        raise DataError(f"view: {len(data)} bytes that are cut short or damaged")
    return content


def _arrays(content: bytes) -> dict[str, NDArray[Any]]:
    """Arrays by name. Raises DataError."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except _FOREIGN as error:
        raise DataError(f"no arrays: {error}") from error
