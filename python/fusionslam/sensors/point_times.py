# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""When the points of a scan were measured, by the fields that drivers give them."""

import numpy as np

from fusionslam.sensors.messages import NANOSECONDS, Scan
from fusionslam.storage.arrays import Floats

_NAMES = ("time", "t", "timestamp", "timestamps", "time_stamp", "offset_time")
_LONGEST_S = 1.0
# No sweep takes longer; what is farther from the stamp is another clock or unit.
_LEAST_ABSOLUTE = 1e8
_LEAST_ABSOLUTE_NS = 1e15


def point_seconds(scan: Scan) -> Floats | None:
    """float64 (N,): seconds from the scan's stamp to when each point was measured.

    Integers are nanoseconds (Ouster, Livox), floats seconds (Velodyne) or, beyond 1e15,
    nanoseconds; large ones count from 1970 (Hesai, RoboSense). None without such a field, and if
    a point is more than a second away from the stamp.
    """
    name = next((name for name in _NAMES if name in scan.fields), None)
    if name is None or not len(scan.points):
        return None
    field = scan.fields[name]
    values = field.astype(np.float64)
    returned = np.isfinite(scan.points).all(axis=1) & np.isfinite(values)
    largest = np.abs(values[returned]).max(initial=0.0)
    in_nanoseconds = field.dtype.kind in "iu" or largest > _LEAST_ABSOLUTE_NS
    seconds = values / NANOSECONDS if in_nanoseconds else values
    if largest > (_LEAST_ABSOLUTE_NS if in_nanoseconds else _LEAST_ABSOLUTE):
        seconds = seconds - scan.stamp_ns / NANOSECONDS
    # Rays without return may have any time.
    seconds[~returned] = 0.0
    return seconds if np.abs(seconds).max() <= _LONGEST_S else None
