# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the last frames tell of the next: clouds for its local map, and which way is up."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fusionslam._core import nearest_ranges, voxel_downsample
from fusionslam.base.arrays import Floats, Floats32, Matrix
from fusionslam.geometry.keyframes import is_keyframe
from fusionslam.geometry.se3 import motion_size
from fusionslam.registration import RegistrationConfig
from fusionslam.registration.clouds import View, as_stored
from fusionslam.sensors.frame import Cloud

_MOST = 30
"""Frames of a local map: more take time and show nothing new."""
_TURN = 10.0
"""Degrees: a frame that is turned further shows something new, wherever it is."""
_LEAST_CIRCLE = 0.9
"""Share of the directions that a scanner sees all round."""
_MOST_TURN = 15.0
"""Degrees: to a scanner that sees all round frames turned further show nothing more, and odometry
that errs by one percent of a turn bends the local map."""
_VIEWS = 5
"""Of them, those whose free space is remembered, evenly spaced."""
_GROUNDS = 5
"""Frames that showed the ground: of fewer, one that took a slope for it tells too much."""


@dataclass(frozen=True)
class Piece:
    """What a frame gives to the local maps of those that follow.

    Attributes:
        cloud: that is described, thinned.
        whole: that is registered, thinned; the same object where it is the same cloud.
        ranges: of the whole cloud, as a ``PreparedCloud`` keeps them.
        odometry: float64 (4, 4), odom_from_cloud.
    """

    cloud: Cloud
    whole: Cloud
    ranges: Floats32
    odometry: Matrix

    @cached_property
    def circle(self) -> float:
        """Share of the directions around it that it saw."""
        return float((self.ranges > 0).any(axis=0).mean())

    @classmethod
    def of(
        cls, cloud: Cloud, whole: Cloud, odometry: Matrix, config: RegistrationConfig
    ) -> "Piece":
        """Thin a frame's clouds to half of the voxels of the registration."""
        thinned = _thin([whole], config.voxel / 2)
        described = thinned if cloud is whole else _thin([cloud], config.voxel / 2)
        ranges = as_stored(nearest_ranges(whole.points, step=config.view_step))
        return cls(described, thinned, ranges, odometry)


class RecentFrames:
    """What the last frames tell: pieces of those that moved or turned, and which way is up."""

    def __init__(self) -> None:
        self._pieces: deque[tuple[int, Piece]] = deque(maxlen=_MOST)
        self._grounds: deque[Floats] = deque(maxlen=_GROUNDS)

    @property
    def pieces(self) -> list[Piece]:
        """The newest is the last."""
        return [piece for _, piece in list(self._pieces)]

    @property
    def up(self) -> Floats | None:
        """Unit vector, float64 (3,), in the frame of odometry: up by the grounds seen last."""
        if not (grounds := list(self._grounds)):
            return None
        mean: Floats = np.mean(grounds, axis=0)
        return mean / np.linalg.norm(mean)

    def numbers_since(self, joined: int, number: int) -> range:
        """Return the numbers of the frames before ``number`` from the oldest of ``joined`` on."""
        first = max(len(self._pieces) - joined, 0)
        return range(self._pieces[first][0] if joined and self._pieces else number, number)

    def add_piece(self, number: int, piece: Piece, length: float) -> None:
        """Take what a frame gives; ``length`` is that of local maps, metres."""
        if self._pieces:
            step = np.linalg.inv(self._pieces[-1][1].odometry) @ piece.odometry
            if not is_keyframe(step, length / _MOST, _TURN):
                return
        self._pieces.append((number, piece))

    def add_ground(self, up: Floats) -> None:
        """Take the unit normal, float64 (3,), in the frame of odometry, of a ground."""
        self._grounds.append(up)

    def clear(self) -> None:
        """Begin anew: odometry of the next frame says nothing of those before."""
        self._pieces.clear()
        self._grounds.clear()


def pieces_to_join(pieces: Sequence[Piece], odometry: Matrix, length: float) -> list[Piece]:
    """Return the last pieces along ``length`` metres of odometry before a pose, the oldest first.

    A step longer than that, as odometry makes that jumps or begins anew, ends the local map; so
    does a turn of a scanner that sees all round.

    Args:
        pieces: of the frames before, the newest last.
        odometry: float64 (4, 4), odom_from_cloud of the new frame.
        length: metres.
    """
    joined: list[Piece] = []
    way, place = 0.0, odometry[:3, 3]
    for piece in reversed(pieces):
        way += float(np.linalg.norm(piece.odometry[:3, 3] - place))
        if way > length or len(joined) == _MOST:
            break
        if piece.circle > _LEAST_CIRCLE:
            turned = motion_size(np.linalg.inv(piece.odometry) @ odometry)[1]
            if turned > _MOST_TURN:
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
    count = 0
    for pose, cloud in placed:
        points = (cloud.points @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)
        joined.append(replace(cloud, points=points))
        count += len(points)
        if count > max(MOST_POINTS, 2 * len(joined[0])):
            joined = [_thin(joined, voxel)]
            count = len(joined[0])
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
