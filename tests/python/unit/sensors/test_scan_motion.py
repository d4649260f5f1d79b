# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How far a robot moves within a scan is known from odometry and times of points, and is said."""

import numpy as np
import pytest

from fusionslam.base.arrays import Floats
from fusionslam.geometry.se3 import exp
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.point_times import Span
from fusionslam.sensors.scan_motion import ScanMotion
from rows import rows

SPEED: Floats = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 1.2])
SECOND = 10**9


def driven(motion: ScanMotion, frames: int, rate_hz: float = 10.0, first_ns: int = SECOND) -> None:
    """Follow a robot at a constant velocity."""
    for k in range(frames):
        motion.follow(first_ns + round(k * SECOND / rate_hz), exp(SPEED * k / rate_hz))


@rows("span", [(0.0, 0.1), (-0.05, 0.05), (-0.1, 0.0)])
def test_the_motion_within_a_scan_is_that_of_odometry_from_the_stamp_on(span: Span) -> None:
    motion = ScanMotion()
    driven(motion, 3)
    moved = motion.within(span)
    np.testing.assert_allclose(moved, np.outer(span, SPEED), atol=1e-7)
    assert list(motion.turned) == [pytest.approx(np.degrees(0.12))]


def test_nothing_is_made_up_where_the_motion_is_not_known() -> None:
    motion = ScanMotion()
    driven(motion, 1)
    assert motion.within((0.0, 0.1)) is None  # the first frame
    driven(motion, 2, 0.5)
    assert motion.within((0.0, 0.1)) is None  # after a gap
    driven(motion, 2, first_ns=0)
    assert motion.within((0.0, 0.1)) is None  # without stamps
    for pose in (None, np.full((4, 4), np.nan)):
        driven(motion, 2)
        motion.follow(SECOND + SECOND // 5, pose)
        assert motion.within((0.0, 0.1)) is None
    driven(motion, 2)
    assert motion.within(None) is None  # without times of points
    assert not motion.turned


@rows(
    "seconds, span",
    [
        (None, None),
        (np.array([0.02, np.nan, -0.01]), (-0.01, 0.02)),
        (np.array([np.nan]), None),
        (np.zeros(0), None),
        (np.array([1.7e9, 1.7e9 + 0.1]), None),  # since 1970
    ],
)
def test_the_span_of_a_scan_is_that_of_its_known_times(
    seconds: Floats | None, span: Span | None
) -> None:
    assert Frame(point_seconds=seconds).span == span


def test_the_warning_is_said_once_with_numbers(caplog: pytest.LogCaptureFixture) -> None:
    motion = ScanMotion()
    motion.warn("a.bag")
    for turn_deg in (0.0, 0.2, 0.8):
        motion.note(np.radians([[0.0] * 6, [0.0] * 5 + [turn_deg]]))
    motion.warn("a.bag")
    assert not caplog.records
    for turn_deg in (6.8, 1.4):
        motion.note(np.radians([[0.0] * 6, [0.0] * 5 + [turn_deg]]))
    motion.warn("a.bag")
    motion.warn("a.bag")
    (said,) = caplog.records
    assert said.levelname == "WARNING"
    assert said.args == ("a.bag", pytest.approx(0.8), pytest.approx(6.8), 1.0, 2, 5)
