# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Motion while a cloud is taken makes its pose less certain."""

import numpy as np

from fusionslam.base.arrays import Floats, Points
from fusionslam.registration.uncertainty import motion_covariance
from rows import rows

NOTHING: Points = np.zeros((0, 3), np.float32)


@rows("span", [(0.0, 0.1), (-0.05, 0.05), (-0.02, 0.08)])
def test_a_pose_is_off_by_the_motion_until_one_of_the_points(span: tuple[float, float]) -> None:
    velocity = np.array([0.5, 0.1, 0.0, 0.02, 0.0, 1.2])
    times = np.linspace(*span, 100_001)
    expected = (times**2).mean() * np.outer(velocity, velocity)
    found = motion_covariance(np.outer(span, velocity), NOTHING)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_a_cloud_that_is_bent_by_a_turn_moves_across_its_axis() -> None:
    angles: Floats = np.linspace(0, 2 * np.pi, 3600, endpoint=False)
    wall = 4 * np.stack([np.cos(angles), np.sin(angles), np.zeros(3600)], axis=1)
    turn = 0.01
    moved = np.zeros((2, 6))
    moved[1, 5] = turn
    # Each ray is taken for one of the stamp, before the part of the turn that was made until then.
    late = angles - turn * angles / (2 * np.pi)
    centre = 4 * np.hypot(np.cos(late).mean(), np.sin(late).mean())
    found = motion_covariance(moved, wall.astype(np.float32))
    np.testing.assert_allclose(np.diag(found)[:3], [centre**2, centre**2, 0], rtol=0.01)
    np.testing.assert_allclose(np.sqrt(found[5, 5]), turn / np.sqrt(3))
