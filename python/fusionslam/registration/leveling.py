# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Levels clouds of tilted sensors: which way is up, by the ground they show or by odometry."""

from typing import NamedTuple

import numpy as np

from fusionslam._core import GroundPlaneConfig, remove_ground_plane, voxel_downsample
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Matrix, Points

_LEVEL = 3.0
"""Degrees. Less tilt changes nothing: registration finds it, and grounds are not flatter."""
_GROUND_TILT = 50.0
"""Degrees. The largest plane below a sensor that is tilted further may be a wall."""
_SHARE, _BELOW = 0.25, 0.03
"""Share of voxels in the plane and below it: the largest planes that hold fewer are often walls and
bushes, where a hand-held sensor sees 70 degrees."""
_LITTLE, _MUCH_BELOW = 0.15, 0.1
"""The same of what may be a ground."""
_NEAR = 10.0
"""Degrees from what the others tell, within which what may be a ground is one if nearly nothing is
below it: the ground of recorded drives is up to 7 degrees off what odometry takes for level."""
_FEWEST, _POINTS = 50, 1500
_ITERATIONS = 400
"""Of RANSAC: a plane of a fifth of the points is missed once in 25 times."""


class Level(NamedTuple):
    """How a cloud is levelled.

    Attributes:
        level_from_cloud: float64 (3, 3), the smallest rotation that turns up to z; None if the
            cloud is level, or nobody can tell.
        up: unit vector, float64 (3,), in the frame of the cloud.
        tilt: angle between up and the cloud's z axis, degrees.
        source: what told: "odometry", "mounting", "ground", or "cloud" for z as it is given.
    """

    level_from_cloud: Matrix | None
    up: Floats
    tilt: float
    source: str


@checked
def find_level(
    points: Points,
    odometry: Matrix | None = None,
    mounting: Matrix | None = None,
    up: Floats | None = None,
) -> Level:
    """Find which way is up in a cloud, from whatever knows it.

    The ground that the cloud shows is believed first: odometry of scans alone tilts as it drifts.
    Where none is seen, odometry tells, by the grounds that were seen last if there were any, else
    by its z axis, which points up in inertial systems and on robots; without it the robot's frame,
    and else the cloud's z axis. The ground is looked for within 50 degrees of what they tell.

    Args:
        points: float32 (N, 3), metres, the sensor at the origin.
        odometry: float64 (4, 4), odom_from_cloud; None if unknown.
        mounting: float64 (4, 4), robot_from_cloud; None if unknown.
        up: unit vector, float64 (3,), in the frame of odometry, of the grounds that frames before
            showed (``RecentFrames.up``); None for the z axis.
    """
    upright = np.array([0.0, 0.0, 1.0])
    told, source = upright, "cloud"
    for name, pose in (("mounting", mounting), ("odometry", odometry)):
        if pose is not None:
            told, source = np.array(pose[2, :3], np.float64), name
    expected = [upright]
    if odometry is not None and up is not None:
        told = odometry[:3, :3].T @ up
        expected.append(told)
    turn = _turn_up(told)
    plane = _largest_plane(points if source == "cloud" else points @ turn.T.astype(np.float32))
    if plane is not None:
        ground = turn.T @ plane.normal
        # Of a plane that holds little, two must say the same: most sensors are mounted level.
        agrees = any(_degrees(ground @ each) < _LEVEL for each in expected)
        near = plane.below <= _BELOW and source != "cloud" and _degrees(ground @ told) < _NEAR
        if plane.is_ground or (plane.may_be_ground and (agrees or near)):
            told, source = ground, "ground"
    told = told / np.linalg.norm(told)
    tilt = _degrees(told[2])
    return Level(None if tilt < _LEVEL else _turn_up(told), told, tilt, source)


def find_ground(points: Points) -> Floats | None:
    """Return the unit normal, float64 (3,), of the ground that a cloud shows; None without one.

    The ground is the largest plane below the sensor, within 50 degrees of z, with nearly nothing
    below it.
    """
    plane = _largest_plane(points)
    return plane.normal if plane is not None and plane.is_ground else None


class _Plane(NamedTuple):
    """A plane below the sensor: its unit normal, and shares of the voxels in and below it."""

    normal: Floats
    share: float
    below: float

    @property
    def is_ground(self) -> bool:
        return self.share >= _SHARE and self.below <= _BELOW

    @property
    def may_be_ground(self) -> bool:
        return self.share >= _LITTLE and self.below <= _MUCH_BELOW


def _largest_plane(points: Points) -> _Plane | None:
    if len(points) < _FEWEST:
        return None
    x, y, z = points.T  # NumPy is slow along axes of three
    reach = float(np.median(np.sqrt(x * x + y * y + z * z)))
    size = float(np.clip(0.03 * reach, 0.05, 0.5))
    near, _, _ = voxel_downsample(points, size=size)
    near = near[np.linalg.norm(near, axis=1) < 2.5 * reach]
    near = np.ascontiguousarray(near[:: 1 + len(near) // _POINTS])
    if len(near) < _FEWEST:
        return None
    thickness = 0.5 * size + 0.02
    config = GroundPlaneConfig(distance=thickness, max_tilt=_GROUND_TILT, iterations=_ITERATIONS)
    _, plane = remove_ground_plane(near, config=config)
    if not plane.any() or plane[3] <= 0:  # no plane, or one above the sensor
        return None
    heights = near @ plane[:3] + plane[3]
    return _Plane(
        plane[:3] / np.linalg.norm(plane[:3]),
        float(np.mean(np.abs(heights) < thickness)),
        float(np.mean(heights < -2 * thickness)),
    )


def _turn_up(up: Floats) -> Matrix:
    """The smallest rotation, float64 (3, 3), that turns a unit vector to z."""
    x, y, z = up / np.linalg.norm(up)
    if z < -1 + 1e-9:  # upside down: any axis will do
        return np.diag([1.0, -1.0, -1.0])
    return np.array(
        [
            [1 - x * x / (1 + z), -x * y / (1 + z), -x],
            [-x * y / (1 + z), 1 - y * y / (1 + z), -y],
            [x, y, z],
        ]
    )


def _degrees(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
