# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of maps: which frames are kept, and how far odometry is trusted."""

from typing import TYPE_CHECKING

import numpy as np

from fusionslam._core import DriftConfig
from fusionslam.config import Section, core_section, option
from fusionslam.mapping.drift import DriftModel
from fusionslam.storage.arrays import Floats, Matrix

if TYPE_CHECKING:
    DriftSection = Section
else:
    DriftSection = core_section("DriftSection", DriftConfig, __name__)
"""How the error of odometry grows with motion."""


class MapConfig(Section):
    """What a map keeps of a drive."""

    keyframe_distance: float | None = option(
        None,
        "distance between keyframes; none is four voxels of registration",
        unit="m",
        gt=0,
        allow_inf_nan=False,
    )
    keyframe_turn: float = option(15.0, "turn between keyframes", unit="deg", gt=0, le=360)
    voxel: float = option(0.1, "voxels of the clouds that exports show", unit="m", ge=0.01, le=10)
    drift: DriftSection = option(DriftSection(), "how far odometry is trusted")
    max_step: float = option(
        20.0,
        "odometry that moves farther from one frame to the next has jumped: the map goes on in a "
        "part of its own until loops join it",
        unit="m",
        gt=0,
    )


def odometry_covariance(step: Matrix, config: MapConfig) -> Floats:
    """Covariance, float64 (6, 6), of a step of odometry, in the frame of its end.

    Args:
        step: float64 (4, 4), before_from_after.
        config: how far odometry is trusted.
    """
    drift = DriftModel(**config.drift.model_dump())
    rest = np.diag(np.repeat([_REST_M**2, _REST_RAD**2], 3))
    return drift.covariance(step) + rest


_REST_M, _REST_RAD = 0.005, 0.001
"""Standard deviations of a robot that stands."""
