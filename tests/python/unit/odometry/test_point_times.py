# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Times of points are read whatever a driver calls and counts them."""

import pickle
from typing import Any

import numpy as np

from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Scan
from rows import rows

STAMP_NS = 1_700_000_000_250_000_000
SECONDS = np.array([0.0, 0.05, 0.0999])


def scan(name: str, values: Any, points: Any = None) -> Scan:
    cloud = np.ones((3, 3), np.float32) if points is None else points
    return Scan(stamp_ns=STAMP_NS, frame_id="lidar", points=cloud, fields={name: values})


@rows(
    "name, values",
    [
        ("time", SECONDS.astype(np.float32)),
        ("t", (SECONDS * 1e9).astype(np.uint32)),
        ("offset_time", (SECONDS * 1e9).astype(np.uint32)),
        ("timestamp", STAMP_NS / 1e9 + SECONDS),
        ("timestamp", STAMP_NS + SECONDS * 1e9),
    ],
)
def test_times_are_seconds_after_the_stamp(name: str, values: Any) -> None:
    found = scan(name, values).point_seconds
    assert found is not None
    np.testing.assert_allclose(found, SECONDS, atol=1e-6)
    # Rays without return may have any time.
    points = np.ones((3, 3), np.float32)
    points[1] = np.nan
    found = scan("time", np.array([0.0, np.nan, 0.1], np.float32), points).point_seconds
    assert found is not None
    np.testing.assert_allclose(found, [0, 0, 0.1], atol=1e-6)


@rows(
    "name, values, remark",
    [
        ("intensity", SECONDS, ""),
        ("time", SECONDS * 1e3, "lie up to 99.9 s from the scan's stamp"),
        ("timestamp", STAMP_NS / 1e9 + 3600 + SECONDS, "lie up to 3.6e+03 s"),
        ("time", np.full(3, np.nan), "no time of a point ('time') is finite"),
    ],
)
def test_other_times_are_unknown_and_named(name: str, values: Any, remark: str) -> None:
    found = scan(name, values).point_times
    assert found.seconds is None and remark in found.remark and bool(found.remark) == bool(remark)


SWEEP = np.linspace(0, 0.0999, 1000)


@rows(
    "values, unit",
    [
        ((SWEEP * 1e6).astype(np.uint32), "microseconds"),  # not nanoseconds
        ((SWEEP * 1e3).astype(np.float32), "milliseconds"),  # not seconds
        (SWEEP * 1e9, "nanoseconds"),
        (SWEEP * 1.002e9, "nanoseconds"),  # more than 1e8, which could be seconds since 1973
        (SWEEP[::-1] * 1e6, "microseconds"),
        (-SWEEP[::-1], ""),  # before the end of the sweep
        (SWEEP[::-1], ""),
        ((SWEEP * 1e9).astype(np.uint32), ""),
        (np.zeros(1000), ""),
    ],
)
def test_times_in_a_wrong_unit_are_taken_for_what_a_sweep_can_last(values: Any, unit: str) -> None:
    cloud = np.ones((1000, 3), np.float32)
    taken = Scan(stamp_ns=STAMP_NS, frame_id="lidar", points=cloud, fields={"t": values})
    assert taken.span is not None and unit in taken.point_times.remark
    assert bool(taken.point_times.remark) == bool(unit)
    lasts = taken.span[1] - taken.span[0]
    assert lasts == 0 or abs(lasts - 0.0999) < 3e-4


def test_a_frame_keeps_the_times_when_it_is_sent_to_another_process() -> None:
    frame = Frame(points=np.ones((3, 3), np.float32), point_seconds=lambda: SECONDS)
    copy = pickle.loads(pickle.dumps(Frame(points=frame.points, point_seconds=SECONDS)))
    np.testing.assert_array_equal(copy.point_seconds, frame.point_seconds)
    assert Frame().point_seconds is None
