# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fits the lengths of a configuration to how far clouds reach: streets or rooms."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from fusionslam._core import voxel_downsample
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Points
from fusionslam.errors import DataError
from fusionslam.registration.clouds import ROOM_REACH, check_points
from fusionslam.registration.config import RegistrationConfig
from fusionslam.sensors.frame import Cloud

_REACH_VOXEL = 0.5
"""Metres. One point each, so that what is near, with more points, does not count for more."""
_STREET = 20.0
"""Metres: the reach that the defaults are for."""
_LEAST = 0.1
_LENGTHS = (
    "voxel",
    "search_cell",
    "search_voxel",
    "guess_distance",
    "distance",
    "ground_height",
    "overlap_distance",
)


@checked
def measure_reach(cloud: Cloud | Points) -> float:
    """Median distance of a cloud's surfaces from the sensor, metres; 0 of an empty cloud."""
    points = check_points(cloud.points if isinstance(cloud, Cloud) else cloud)
    if not len(points):
        return 0.0
    voxels, _, _ = voxel_downsample(points, size=_REACH_VOXEL)
    return float(np.median(np.linalg.norm(voxels, axis=1)))


@checked
def without_lengths(config: RegistrationConfig) -> dict[str, Any]:
    """Return the values of a configuration but for the lengths that ``fit_lengths`` changes."""
    return config.model_dump(exclude=set(_LENGTHS))


@checked
def has_lengths(config: RegistrationConfig) -> bool:
    """Whether any of the lengths that ``fit_lengths`` changes was given."""
    return not config.model_fields_set.isdisjoint(_LENGTHS)


@checked
def fit_lengths(
    clouds: Iterable[Cloud | Points], config: RegistrationConfig | None = None
) -> RegistrationConfig:
    """Fit a configuration to rooms if clouds do not reach farther.

    Args:
        clouds: some of those that are to be registered, metres, the sensor at the origin.
        config: with lengths that suit clouds of a car; the defaults if None.

    Returns:
        The configuration itself if the clouds reach 12 m or more (``measure_reach``, the median of
        the clouds); else with voxels, cells and distances that are smaller in proportion to 20 m,
        a tenth at least. Standard deviations stay as they are.

    Raises:
        ShapeError: neither a cloud nor an array of points.
        DataError: NaN or infinity in a point; no cloud with points.
    """
    config = config or RegistrationConfig()
    reaches = [reach for reach in map(measure_reach, clouds) if reach > 0]
    if not reaches:
        raise DataError("none of the clouds has points that could tell how far they reach")
    reach = float(np.median(reaches))
    if reach >= ROOM_REACH:
        return config
    factor = max(reach / _STREET, _LEAST)
    values = config.model_dump()
    return RegistrationConfig(**values | {name: factor * values[name] for name in _LENGTHS})
