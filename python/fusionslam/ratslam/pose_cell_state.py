# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The state of pose cells as arrays, and the validation of such arrays."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError

Arrays = Mapping[str, NDArray[Any]]

VIEW_TABLES = {"places": (3,), "decays": (), "since": ()}
"""The tables with one row per view, and the shape of a row."""
EXPERIENCE_TABLES = {"experiences": (3,), "views_of": (), "offsets": (3,)}
"""The tables with one row per experience, and the shape of a row."""
_FIXED: dict[str, tuple[int, ...]] = {"relative": (3,), "counts": (4,), "flags": (3,)}
_DTYPES = {"since": np.int64, "views_of": np.int64, "counts": np.int64, "flags": np.bool_}
NAMES = ("cells", "network", *_FIXED, *VIEW_TABLES, *EXPERIENCE_TABLES)


def check_state(state: Arrays) -> dict[str, NDArray[Any]]:
    """Check arrays of a stored state, and return them with the right types.

    Raises:
        DataError: an array is missing, or has a wrong shape or impossible values.
    """
    missing = [name for name in NAMES if name not in state]
    if missing:
        raise DataError(f"pose cells: no array {missing[0]!r} in the state")
    arrays = {name: _check_type(name, np.asarray(state[name])) for name in NAMES}
    for name, shape in _FIXED.items():
        _check_shape(name, arrays[name], shape)
    views = _check_table(arrays, VIEW_TABLES)
    experiences = _check_table(arrays, EXPERIENCE_TABLES)
    arrived, view, previous, current = arrays["counts"]
    _check_range("counts", arrived, np.iinfo(np.int64).max)
    _check_range("counts", np.array((view, previous)), max(views, 1))
    _check_range("counts", current, max(experiences, 1))
    _check_range("views_of", arrays["views_of"], views)
    _check_range("since", arrays["since"], int(arrived) + 1)
    return arrays


def _check_type(name: str, array: NDArray[Any]) -> NDArray[Any]:
    dtype = np.dtype(_DTYPES.get(name, np.float64))
    if not np.can_cast(array.dtype, dtype, "safe"):
        raise DataError(f"pose cells: {name} is {array.dtype}, expected {dtype}")
    if name != "network" and array.dtype.kind == "f" and not np.isfinite(array).all():
        raise DataError(f"pose cells: {name} holds values that are not finite")
    return array.astype(dtype)


def _check_shape(name: str, array: NDArray[Any], shape: tuple[int, ...], why: str = "") -> None:
    if array.shape != shape:
        raise DataError(f"pose cells: {name} has the shape {array.shape}, expected {shape}{why}")


def _check_table(arrays: Arrays, tables: Mapping[str, tuple[int, ...]]) -> int:
    """The number of rows that all of these tables share."""
    first = next(iter(tables))
    count = len(arrays[first]) if arrays[first].ndim else 0
    for name, row in tables.items():
        _check_shape(name, arrays[name], (count, *row), f", with a row for each of {first}")
    return count


def _check_range(name: str, values: NDArray[Any], end: int) -> None:
    wrong = values[(values < 0) | (values >= end)]
    if wrong.size:
        raise DataError(f"pose cells: {name} holds {wrong.flat[0]}, expected 0 to {end - 1}")
