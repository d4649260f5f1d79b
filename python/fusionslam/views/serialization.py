# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Exact serialisation of views: one process builds them, another recognises them.

    data = view_to_bytes(builder, builder.view(cloud))
    match = matcher.process(view_from_bytes(matcher.comparison, data))

gives the same as ``matcher.process(cloud)`` if both have the same configuration. ``builder`` is
``build_comparison(config.views, config.descriptors)``.
"""

import io
import json
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import load_arrays, save_arrays
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.views.comparison import Comparison, View

FORMAT = b"fusionslam.view.1\n"
_ABOUT = "about"
_SUM = 4  # bytes of the check sum
_ADVICE = "who builds views and who matches them need the same configuration of views"


def view_to_bytes(comparison: Comparison, view: View) -> bytes:
    """Serialise a view of ``comparison``: format, check sum (CRC-32, little endian), and a .npz."""
    stream = io.BytesIO()
    text = json.dumps(_about(comparison)).encode()
    save_arrays(stream, {_ABOUT: np.frombuffer(text, np.uint8), **comparison.arrays_of(view)})
    content = stream.getvalue()
    return FORMAT + zlib.crc32(content).to_bytes(_SUM, "little") + content


def view_from_bytes(comparison: Comparison, data: bytes) -> View:
    """Read what ``view_to_bytes`` wrote, bit for bit.

    Args:
        comparison: configured as in the process that built the view.
        data: the bytes written there.

    Raises:
        DataError: the bytes are truncated, damaged, of another version, not a view, or a view of
            another comparison or configuration; the message says what was found and expected.
    """
    if not data.startswith(FORMAT):
        expected = FORMAT.decode().strip()
        raise DataError(f"view: begins with {bytes(data[: len(FORMAT)])!r}, expected {expected}")
    start = len(FORMAT) + _SUM
    content = data[start:]
    if zlib.crc32(content) != int.from_bytes(data[len(FORMAT) : start], "little"):
        raise DataError(f"view: {len(data)} bytes that are cut short or damaged")
    try:
        with load_arrays(io.BytesIO(content), "a view") as arrays:
            _check_about(arrays[_ABOUT], _about(comparison))
            return comparison.view_of(arrays)
    except FusionSlamError as error:
        raise DataError(
            f"view: {error}; {_ADVICE}", code=error.code, fields=error.fields
        ) from error


def _about(comparison: Comparison) -> dict[str, Any]:
    return {"comparison": comparison.kind, **comparison.settings()}


def _check_about(text: NDArray[Any], expected: dict[str, Any]) -> None:
    """Raise DataError unless a view was built as expected."""
    try:
        found = json.loads(text.tobytes())
    except (ValueError, RecursionError) as error:
        raise DataError(f"does not say how it was made: {error}") from error
    if not isinstance(found, dict):
        raise DataError(f"does not say how it was made, but {found!r}")
    for name, value in expected.items():
        if found.get(name) != value:
            raise DataError(
                f"was made with {name} {found.get(name)!r}, expected {value!r}",
                code="other-settings",
                fields=[name],
            )
