# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of maps: which frames are kept, and how far odometry is trusted.

How odometry's error grows is the model by which RatSLAM checks loops, in space.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from fusionslam._core import DriftConfig, drift_covariance
from fusionslam.base.arrays import Floats, Matrix
from fusionslam.config import Section, core_section, option
from fusionslam.mapping.edge import check_pose
from fusionslam.registration.config import RegistrationConfig

if TYPE_CHECKING:
    DriftSection = Section
else:
    DriftSection = core_section("DriftSection", DriftConfig, __name__)
"""How the error of odometry grows with motion."""


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
    step_sd: float = option(
        0.02,
        "floor of the standard deviation of steps that clouds of neighbouring keyframes measure",
        unit="m",
        gt=0,
        le=10,
    )
    step_angle_sd: float = option(
        0.1, "floor of the standard deviation of their angles", unit="deg", gt=0, le=180
    )
    max_step: float = option(
        20.0,
        "odometry that moves farther from one frame to the next, and faster than the robot was so "
        "far, has jumped: the map goes on in a part of its own until loops join it",
        unit="m",
        gt=0,
    )
    max_silence: float = option(
        10.0,
        "odometry of frames that are farther apart in time counts unless their clouds contradict "
        "it, or do not confirm it where time goes back; else the map goes on in a part of its own",
        unit="s",
        gt=0,
    )
    lost_after: float = option(
        200.0,
        "a robot is lost after this way by odometry alone, without a loop or a localisation that "
        "confirms its position",
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


def step_covariance(
    covariance: Floats, registration: RegistrationConfig, config: MapConfig
) -> Floats:
    """Covariance of a registered step, whose floor may be lower than that of loops.

    Neighbouring clouds show nearly the same: their poses are off by 8 to 14 mm and 0.02 to 0.05
    degrees on KITTI (docs/stages/registration.md). Of clouds that show less than half of the circle
    they are not: steps of a Livox Avia, carried by hand, bent a path that odometry knew better.

    Args:
        covariance: float64 (6, 6), of the registration, of method global.
        registration: with the floor that the covariance has.
        config: with the floor of steps.
    """
    had = np.repeat([registration.position_sd, np.radians(registration.angle_sd)], 3)
    floor = np.repeat([config.step_sd, np.radians(config.step_angle_sd)], 3)
    return covariance - np.diag(had**2 - np.minimum(had, floor) ** 2)


_REST_M, _REST_RAD = 0.005, 0.001
"""Standard deviations of a robot that stands."""
