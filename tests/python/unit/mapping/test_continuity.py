# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What odometry itself says about whether it goes on."""

import numpy as np
import pytest

from fusionslam.base.arrays import Matrix
from fusionslam.geometry.se3 import exp
from fusionslam.mapping.config import MapConfig
from fusionslam.mapping.continuity import find_doubt


def at(metres: float, yaw: float = 0.0) -> Matrix:
    return exp(np.array([metres, 0, 0, 0, 0, yaw]))


@pytest.mark.parametrize(
    ("before", "now", "seconds", "fastest", "expected"),
    [
        pytest.param(at(30), at(31), 0.1, 10, None, id="the next frame"),
        pytest.param(at(30), at(55), 0.1, 10, ("jump", 25), id="farther than it ever drove"),
        pytest.param(at(30), at(80), 5, 10, None, id="five seconds left out at speed"),
        pytest.param(at(30), at(80), 5, 1, ("jump", 50), id="too far for a slow robot"),
        pytest.param(at(30), at(55), 0, 10, ("jump", 25), id="times unknown"),
        pytest.param(at(30), at(900), 600, 2, ("silence", 600), id="ten minutes left out"),
        pytest.param(at(30), at(0.1), 60, 1, ("restart", 29.9), id="back at the origin"),
        pytest.param(at(5), at(0.1), 0.1, 1, ("restart", 4.9), id="at once, nearer than a jump"),
        pytest.param(at(0.6, 2.0), at(0.0), 60, 1, ("restart", 0.5), id="turned there"),
        pytest.param(at(1.2), at(0.4), 1, 1, None, id="it drives past its origin"),
        pytest.param(at(30), at(30), -60, 1, ("stamp", 60), id="played again"),
        pytest.param(at(30), at(30), -1, 1, None, id="a clock that went back a little"),
    ],
)
def test_odometry_goes_on_unless_it_jumps_or_begins_anew(
    before: Matrix,
    now: Matrix,
    seconds: float,
    fastest: float,
    expected: tuple[str, float] | None,
) -> None:
    doubt = find_doubt(before, now, seconds, fastest, MapConfig())
    assert (doubt and (doubt.code, round(doubt.number, 1))) == expected
