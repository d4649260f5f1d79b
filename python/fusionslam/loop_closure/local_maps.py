# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Local maps: the clouds of the last frames, joined by odometry in the frame of the newest."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusionslam._core import nearest_ranges, voxel_downsample
from fusionslam.base.arrays import Floats32, Matrix
from fusionslam.registration import RegistrationConfig
from fusionslam.registration.clouds import View
from fusionslam.sensors.frame import Cloud

MOST_JOINED = 30
"""Frames of a local map: more take time and show nothing new."""
_VIEWS = 5
"""Of them, those whose free space is remembered, evenly spaced."""


@dataclass(frozen=True)
class Piece:
    """What a frame gives to the local maps of those that follow.

    Attributes:
        cloud: that is described, thinned.
        whole: that is registered, thinned; the same object where it is the same cloud.
        ranges: of the whole cloud, as ``nearest_ranges`` returns.
        odometry: float64 (4, 4), odom_from_cloud.
    """

    cloud: Cloud
    whole: Cloud
    ranges: Floats32
    odometry: Matrix

    @classmethod
    def of(
        cls, cloud: Cloud, whole: Cloud, odometry: Matrix, config: RegistrationConfig
    ) -> "Piece":
        """Thin a frame's clouds to half of the voxels of the registration."""
        thinned = _thin([whole], config.voxel / 2)
        described = thinned if cloud is whole else _thin([cloud], config.voxel / 2)
        ranges: Floats32 = nearest_ranges(whole.points, step=config.view_step)
        return cls(described, thinned, ranges, odometry)


def pieces_to_join(pieces: Sequence[Piece], odometry: Matrix, length: float) -> list[Piece]:
    """Return the last pieces along ``length`` metres of odometry before a pose, the oldest first.

    A step longer than that, as odometry makes that jumps or begins anew, ends the local map.

    Args:
        pieces: of the frames before, the newest last.
        odometry: float64 (4, 4), odom_from_cloud of the new frame.
        length: metres.
    """
    joined: list[Piece] = []
    way, place = 0.0, odometry[:3, 3]
    for piece in reversed(pieces):
        way += float(np.linalg.norm(piece.odometry[:3, 3] - place))
        if way > length or len(joined) == MOST_JOINED:
            break
        place = piece.odometry[:3, 3]
        joined.append(piece)
    return joined[::-1]


MOST_POINTS = 4_000_000
"""Points of clouds that are joined before voxels thin them, so that memory is bounded."""


def join_clouds(placed: Iterable[tuple[Matrix, Cloud]], voxel: float) -> Cloud:
    """Return one point for each voxel of all clouds, with what all of them know of their points.

    Args:
        placed: map_from_cloud, float64 (4, 4), and the cloud.
        voxel: its side, metres.
    """
    joined: list[Cloud] = []
    for pose, cloud in placed:
        points = (cloud.points @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)
        joined.append(replace(cloud, points=points))
        if sum(map(len, joined)) > max(MOST_POINTS, 2 * len(joined[0])):
            joined = [_thin(joined, voxel)]
    return _thin(joined, voxel)


def views_of(pieces: Sequence[Piece], odometry: Matrix) -> list[View]:
    """What the sensor saw from the places of some of the pieces, for a ``PreparedCloud``."""
    rows = np.unique(np.linspace(0, len(pieces) - 1, min(_VIEWS, len(pieces))).round().astype(int))
    return [(pieces[row].ranges, np.linalg.inv(pieces[row].odometry) @ odometry) for row in rows]


def _thin(clouds: Sequence[Cloud], voxel: float) -> Cloud:
    shown = [each for each in clouds if len(each)]
    if not shown:
        return Cloud(np.empty((0, 3), np.float32))
    colors = [each.colors for each in shown if each.colors is not None]
    intensities = [each.intensities for each in shown if each.intensities is not None]
    points, kept, rows = voxel_downsample(
        np.concatenate([each.points for each in shown]),
        np.concatenate(colors) if len(colors) == len(shown) else None,
        size=voxel,
    )
    return Cloud(
        points,
        kept if len(colors) == len(shown) else None,
        np.concatenate(intensities)[rows] if len(intensities) == len(shown) else None,
    )
