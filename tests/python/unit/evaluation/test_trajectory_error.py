# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from fusionslam.base.arrays import Floats
from fusionslam.evaluation import trajectory_error
from fusionslam.geometry.rigid import fit_motion
from fusionslam.geometry.se3 import exp

MOTION = exp(np.array([3.0, -2, 1, 0.1, -0.2, 2]))


def circle() -> Floats:
    angle = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    poses = np.tile(np.eye(4), (100, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = 40 * np.cos(angle), 40 * np.sin(angle)
    return poses


def test_the_error_is_the_root_mean_square_of_the_distances_once_aligned() -> None:
    drive = circle()
    np.testing.assert_allclose(fit_motion(drive, MOTION @ drive), MOTION, atol=1e-9)
    assert trajectory_error(MOTION @ drive, drive) < 1e-9
    drive = circle()
    away = drive.copy()
    away[::2, 2, 3] += 0.2  # half the poses 0.1 m above the mean, half below it
    assert trajectory_error(away, drive) == pytest.approx(0.1, rel=1e-3)


def test_parts_are_aligned_by_themselves_and_unknown_poses_left_out() -> None:
    drive = circle()
    broken = drive.copy()
    broken[50:] = MOTION @ broken[50:]
    parts = np.repeat([7, 3], 50)
    assert trajectory_error(broken, drive) > 1
    assert trajectory_error(broken, drive, parts) < 1e-9
    drive = circle()
    truth = drive.copy()
    truth[::3] = np.nan
    away = drive.copy()
    away[::3, 0, 3] += 99
    assert trajectory_error(away, truth) < 1e-9
    assert np.isnan(trajectory_error(drive, np.full_like(drive, np.nan)))
