# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How far odometry may be off: the model by which RatSLAM checks loops, in space."""

from typing import Any

from fusionslam._core import DriftConfig, drift_covariance
from fusionslam.mapping.edge import check_pose
from fusionslam.storage.arrays import Floats


class DriftModel:
    """How the error of odometry grows with motion: random walks, whose variances add up.

    Args:
        options: of ``DriftConfig``: ``drift_m``, ``drift_height`` and ``drift_heading``,
            ``drift_tilt`` (standard deviations after one metre, in metres and radians), and
            ``drift_turn`` (after a turn of one radian).

    Raises:
        ConfigError: an option is unknown or out of range.
    """

    def __init__(self, **options: float) -> None:
        self.config = DriftConfig(**options)

    def covariance(self, motion: Any) -> Floats:
        """Covariance of odometry over a motion.

        Args:
            motion: float64 (4, 4), from where the robot was to where it is.

        Returns:
            float64 (6, 6), as that of an ``Edge``.

        Raises:
            ShapeError, DataError: the motion is none (codes "not-finite", "not-a-rotation").
        """
        return drift_covariance(self.config, check_pose("motion", motion))
