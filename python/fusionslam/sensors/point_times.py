# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""When the points of a scan were measured, whatever their driver calls and counts it."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Mask, read_numbers

_FIELDS = ("time", "t", "timestamp", "timestamps", "time_stamp", "offset_time")
"""What drivers call the times of points."""
_UNITS = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
LONGEST_SWEEP_S = 1.0
"""No sweep takes longer; what is farther from the stamp is another clock or unit."""
_SHORTEST_SWEEP_S = 2.5e-4
_USUAL_S = (0.01, 0.5)
_WHOLE = 500
"""Fewer points may be a part of a sweep, which says nothing of the unit."""
_LEAST_ABSOLUTE = 1e8
_LEAST_ABSOLUTE_NS = 1e15
Span = tuple[float, float]
"""Seconds from a scan's stamp to its first and to its last point."""


class PointTimes(NamedTuple):
    """Times of the points of a scan.

    Attributes:
        seconds: float64 (N,), from the stamp to when each point was measured, 0 for rays without
            return; None if they cannot be used.
        remark: why they cannot be used, or what is unusual about how they were taken; else empty.
    """

    seconds: Floats | None
    remark: str = ""


def span_of(seconds: Any) -> Span | None:
    """Return when the first and the last point were measured; None if that is not known.

    Args:
        seconds: float (N,), of each point after the stamp; NaN where unknown, None if all are. Of
            another clock, and none, if one is more than a second before or after the stamp.

    Raises:
        DataError, ShapeError: times that are no numbers.
    """
    if seconds is None:
        return None
    numbers = read_numbers("point_seconds", seconds, "(N,), one for each point")
    known = numbers[np.isfinite(numbers)]
    if not known.size or np.abs(known).max() > LONGEST_SWEEP_S:
        return None
    return float(known.min()), float(known.max())


def read_point_times(
    fields: Mapping[str, NDArray[Any]], stamp_ns: int, returned: Mask
) -> PointTimes:
    """Read the times of a scan's points.

    Integers are nanoseconds (Ouster, Livox), floats seconds (Velodyne) or, beyond 1e15,
    nanoseconds; large ones count from 1970 (Hesai, RoboSense), others from the stamp. Where a sweep
    would last for less than 0.25 ms or more than a second by that, the unit is the one by which it
    lasts for 0.01 to 0.5 s.

    Args:
        fields: values of each point by name.
        stamp_ns: of the scan.
        returned: bool (N,), the rays with a return; others may have any time.
    """
    name = next((name for name in _FIELDS if name in fields), None)
    if name is None or not returned.any():
        return PointTimes(None)
    given = np.asarray(fields[name])
    if given.shape != returned.shape or given.dtype.kind not in "iuf":
        return PointTimes(
            None,
            f"times of points ('{name}') are {given.dtype} {given.shape}, expected numbers "
            f"{returned.shape}: they are taken as unknown",
        )
    values = given.astype(np.float64)
    returned = returned & np.isfinite(values)
    known = values[returned]
    if not known.size:
        return PointTimes(None, f"no time of a point ('{name}') is finite")
    seconds, remark = _seconds_from(values, known, given.dtype.kind in "iu", stamp_ns / 1e9, name)
    off = float(np.abs(seconds[returned]).max())
    if off > LONGEST_SWEEP_S:
        return PointTimes(
            None,
            f"times of points ('{name}') lie up to {off:.3g} s from the scan's stamp, expected up "
            f"to {LONGEST_SWEEP_S:g} s: they are of another clock, and taken as unknown",
        )
    seconds[~returned] = 0.0
    return PointTimes(seconds, remark)


def _seconds_from(
    values: Floats, known: Floats, is_integer: bool, stamp_s: float, name: str
) -> tuple[Floats, str]:
    """Seconds after the stamp, and a remark on an unusual unit; ``known`` are the finite values."""
    largest, span = float(np.abs(known).max()), float(np.ptp(known))
    in_nanoseconds = is_integer or largest > _LEAST_ABSOLUTE_NS
    unit = 1e-9 if in_nanoseconds else 1.0
    absolute: Floats = values * unit - stamp_s
    is_absolute = largest > (_LEAST_ABSOLUTE_NS if in_nanoseconds else _LEAST_ABSOLUTE)
    if is_absolute and np.abs(known * unit - stamp_s).max() <= LONGEST_SWEEP_S:
        return absolute, ""
    low, high = _USUAL_S
    is_sweep = _SHORTEST_SWEEP_S <= span * unit <= LONGEST_SWEEP_S
    if is_absolute or (span and known.size >= _WHOLE and not is_sweep):
        for other, words in _UNITS.items():
            begins = float(np.abs(known * other).max())
            if low <= span * other <= high and begins <= LONGEST_SWEEP_S:
                return values * other, f"times of points ('{name}') are taken for {words}"
    return (absolute if is_absolute else values * unit), ""
