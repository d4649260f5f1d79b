# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How much too short odometry's distances and turns are, and how late it is, by a LiDAR's path."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.calibration.estimate import Estimate
from fusionslam.calibration.lidar_imu import LATEST_S, solve, state
from fusionslam.calibration.scan_path import PoseSpline, ScanPath
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import inverse
from fusionslam.sensors.messages import NANOSECONDS, Odometry

_WINDOW = 10
"""Scans, over which motions are compared."""
_STEP_S = 0.01
_CLEAR = 10.0
"""Motions are that much larger than misfits, or nothing is said of them."""
_WIDEST_SHARE, _WIDEST_S = 0.05, 0.05
"""Half widths of intervals beyond which nothing is said."""


def calibrate_wheels(
    path: ScanPath, messages: Sequence[Odometry], robot_from_lidar: Matrix
) -> list[Estimate]:
    """Estimate the factors that correct odometry's distances and turns, and its delay.

    Args:
        path: of the LiDAR.
        messages: of odometry, by stamp.
        robot_from_lidar: float64 (4, 4), the robot being the odometry's child frame.

    Raises:
        DataError: odometry is of another time than the scans (code "clock"), or hardly of the same
            ("few-scans").
    """
    stamps, first = np.unique([each.stamp_ns for each in messages], return_index=True)
    seconds = (stamps - path.begin_ns) / NANOSECONDS
    spline = PoseSpline(seconds, np.array([messages[row].pose for row in first]))
    begins, lengths, moved, labels = [], [], [], []
    for number, piece in enumerate(path.pieces):
        robot = piece.poses @ inverse(robot_from_lidar)
        for row in range(0, len(robot) - _WINDOW, _WINDOW):
            begin, end = piece.seconds[row], piece.seconds[row + _WINDOW]
            if begin - LATEST_S > seconds[0] and end + LATEST_S < seconds[-1]:
                begins.append(begin)
                lengths.append(end - begin)
                moved.append(inverse(robot[row]) @ robot[row + _WINDOW])
                labels.append(number)
    if len(begins) < _WINDOW:
        raise DataError(
            f"odometry is from {seconds[0]:.3f} to {seconds[-1]:.3f} s after the first scan, which "
            f"covers {len(begins)} seconds of the scans, expected {_WINDOW} or more",
            code="few-scans" if begins else "clock",
            fields=(f"{seconds[0]:.3f}", f"{seconds[-1]:.3f}"),
        )
    begin, length = np.array(begins), np.array(lengths)
    found = _way_and_turn(np.array(moved))

    def told(delay: float) -> Floats:
        ends = begin + delay, begin + length + delay
        return _way_and_turn(inverse(spline.at(ends[0])) @ spline.at(ends[1]))

    def misfit(delay: float) -> float:
        said = told(delay)
        rest = found - said * (said * found).sum(axis=0) / np.maximum((said**2).sum(axis=0), 1e-12)
        return float(np.abs(rest / np.maximum(found.std(axis=0), 1e-6)).sum())

    tried = np.linspace(-LATEST_S, LATEST_S, 81)
    best = float(tried[int(np.argmin([misfit(float(delay)) for delay in tried]))])
    bounds = max(-LATEST_S, best - 0.05), min(LATEST_S, best + 0.05)
    delay = float(minimize_scalar(misfit, bounds=bounds, method="bounded").x)
    said = told(delay)
    change = (told(delay + _STEP_S) - told(delay - _STEP_S)) / (2 * _STEP_S)
    factor = (said * found).sum(axis=0) / np.maximum((said**2).sum(axis=0), 1e-12)
    # Of equal weight where both fit equally well.
    spread = np.maximum(np.median(np.abs(found - said * factor), axis=0), 1e-6)
    none = np.zeros(len(said))
    model = np.concatenate(
        [
            np.stack([said[:, 0], none, factor[0] * change[:, 0]], axis=1) / spread[0],
            np.stack([none, said[:, 1], factor[1] * change[:, 1]], axis=1) / spread[1],
        ]
    )
    fit = solve(model, (found / spread).T.ravel(), np.tile(np.arange(len(said)), 2))
    way, turn = np.abs(said).sum(axis=0)
    values, widths = fit.values, fit.half_widths.copy()
    # Where odometry tells little more than its noise, factors of the noise come out near zero.
    noise = _CLEAR * spread / np.maximum(np.sqrt((said**2).mean(axis=0)), 1e-12)
    widths[:2] = np.maximum(widths[:2], np.where(noise > 1, _WIDEST_SHARE * noise, 0))
    needed = widths / (_WIDEST_SHARE, _WIDEST_SHARE, _WIDEST_S)
    return [
        state(
            "odometry: factor of distances",
            values[0],
            widths[0],
            "",
            _WIDEST_SHARE,
            f"the robot drives {way:.3g} m; some {way * needed[0] ** 2:.2g} m are needed",
            1.0,
        ),
        state(
            "odometry: factor of turns",
            values[1],
            widths[1],
            "",
            _WIDEST_SHARE,
            f"the robot turns by {np.degrees(turn):.3g} degrees in all; some "
            f"{np.degrees(turn) * needed[1] ** 2:.2g} are needed",
            1.0,
        ),
        state(
            "odometry late by",
            1000 * (delay + values[2]),
            1000 * widths[2],
            "ms",
            1000 * _WIDEST_S,
            "speed and turn rate change too little",
            0.0,
        ),
    ]


def _way_and_turn(motions: Floats) -> Floats:
    """Metres ahead along the chord and radians to the left of motions (K, 4, 4): (K, 2)."""
    turn = np.arctan2(motions[:, 1, 0], motions[:, 0, 0])
    ahead = motions[:, 0, 3] * np.cos(turn / 2) + motions[:, 1, 3] * np.sin(turn / 2)
    return np.stack([ahead, turn], axis=1)
