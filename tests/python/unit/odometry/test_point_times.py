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


MILLISECONDS, OTHER_CLOCK = SECONDS * 1e3, 1.5e9 + SECONDS


@rows("name, values", [("intensity", SECONDS), ("time", MILLISECONDS), ("timestamp", OTHER_CLOCK)])
def test_other_times_are_unknown(name: str, values: Any) -> None:
    assert scan(name, values).point_seconds is None


def test_a_frame_keeps_the_times_when_it_is_sent_to_another_process() -> None:
    frame = Frame(points=np.ones((3, 3), np.float32), point_seconds=lambda: SECONDS)
    copy = pickle.loads(pickle.dumps(Frame(points=frame.points, point_seconds=SECONDS)))
    np.testing.assert_array_equal(copy.point_seconds, frame.point_seconds)
    assert Frame().point_seconds is None
