# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps of what comes one after the other."""

import numpy as np

from fusionslam.errors import ClockError, ShapeError
from fusionslam.messages import NANOSECONDS


def next_stamp(stamp_ns: int, last_ns: int | None) -> int:
    """The stamp as an int, not before the last one; the same again is allowed.

    Raises:
        ClockError: it lies before the last one.
        ShapeError: no whole number that int64 holds.
    """
    stamp = np.asarray(stamp_ns)
    if stamp.shape or stamp.dtype.kind not in "iu" or stamp > np.iinfo(np.int64).max:
        raise ShapeError(f"stamp_ns is {stamp_ns!r}, expected whole nanoseconds in int64")
    found = int(stamp)
    if last_ns is not None and found < last_ns:
        back = (last_ns - found) / NANOSECONDS
        raise ClockError(f"stamp {found} ns lies {back:g} s before the last one")
    return found
