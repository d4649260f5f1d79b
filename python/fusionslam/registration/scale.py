# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fits the lengths of a configuration to what clouds show: streets or rooms, much or little."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from fusionslam._core import nearest_ranges, voxel_downsample
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
_NARROW = 0.5
"""Share of the circle: clouds that show less are joined along ``_NARROW_WAY`` of their reach."""
_SPARSE = 3000
"""Voxels: clouds with fewer are joined along ``_SPARSE_WAY``."""
_NARROW_WAY, _SPARSE_WAY = 0.4, 0.15
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
    fitted = _LENGTHS if config.local_map is not None else (*_LENGTHS, "local_map")
    return config.model_dump(exclude=set(fitted))


@checked
def has_lengths(config: RegistrationConfig) -> bool:
    """Whether any of the lengths that ``fit_lengths`` changes was given."""
    return not config.model_fields_set.isdisjoint(_LENGTHS)


@checked
def fit_lengths(
    clouds: Iterable[Cloud | Points], config: RegistrationConfig | None = None
) -> RegistrationConfig:
    """Fit a configuration to rooms if clouds do not reach farther, and to how much they show.

    Args:
        clouds: some of those that are to be registered, metres, the sensor at the origin.
        config: with lengths that suit clouds of a car; the defaults if None.

    Returns:
        The configuration with smaller voxels, cells and distances, in proportion to 20 m, a tenth
        at least, if the clouds reach less than 12 m (``measure_reach``, the median of the clouds).
        Standard deviations stay as they are. Where ``local_map`` is None and up is known
        (``gravity``), it becomes 0.4 of the reach if clouds show less than half of the circle, and
        0.15 of it if they fill fewer than 3000 voxels. The configuration itself if nothing changes.

    Raises:
        ShapeError: neither a cloud nor an array of points.
        DataError: NaN or infinity in a point; no cloud with points.
    """
    config = config or RegistrationConfig()
    given = [check_points(each.points if isinstance(each, Cloud) else each) for each in clouds]
    shown = [points for points in given if len(points)]
    if not shown:
        raise DataError("none of the clouds has points that could tell how far they reach")
    reach = float(np.median([measure_reach(points) for points in shown]))
    changes: dict[str, float] = {}
    if reach < ROOM_REACH:
        factor = max(reach / _STREET, _LEAST)
        changes = {name: factor * getattr(config, name) for name in _LENGTHS}
    if config.local_map is None and config.gravity and config.method != "planar":
        voxel = changes.get("voxel", config.voxel)
        share = float(np.median([_joined_share(points, voxel) for points in shown]))
        if share:
            changes["local_map"] = share * reach
    return RegistrationConfig(**config.model_dump() | changes) if changes else config


def _joined_share(points: Points, voxel: float) -> float:
    """Of its reach, the way along which clouds are joined that show as little as this one."""
    if (nearest_ranges(points, step=1.0) > 0).any(axis=0).mean() < _NARROW:
        return _NARROW_WAY
    return _SPARSE_WAY if len(voxel_downsample(points, size=voxel)[0]) < _SPARSE else 0.0
