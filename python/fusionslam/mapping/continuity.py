# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Whether odometry goes on from one frame to the next, however long the wait between them."""

import itertools
from collections.abc import Sequence

import numpy as np

from fusionslam._core import count_overlap
from fusionslam.base.arrays import Matrix
from fusionslam.geometry.se3 import inverse, log
from fusionslam.mapping.config import MapConfig
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.map_file import StoredKeyframe
from fusionslam.registration import PreparedCloud, Refusal

_ORIGIN, _AWAY = 0.5, 1.0
"""Odometry that begins anew is this near to its origin, and was farther away: m or rad."""
_FASTER = 2.0
"""Than the session's fastest step between keyframes, a robot is not on average."""
_FEWEST_SEEN = 0.1
"""Of a cloud's points, those that the other sensor must have seen the places of."""


def find_doubt(
    before: Matrix, now: Matrix, seconds: float, fastest: float, config: MapConfig
) -> Refusal | None:
    """Say why odometry may not go on; None if it does.

    Args:
        before, now: float64 (4, 4), odom_from_robot of a frame and of the next.
        seconds: between them; 0 if unknown, negative where the time stamp goes back.
        fastest: m/s of the session's fastest step so far.
        config: of the map.

    Returns:
        Code "jump" (number: metres) is certain. "restart" (metres back to odometry's origin) and
        "stamp" (seconds that time went back) are so unless clouds confirm odometry, "silence"
        (seconds without frames) only if they contradict it.
    """
    step = float(np.linalg.norm(now[:3, 3] - before[:3, 3]))
    apart = "the map goes on in a part of its own until loops join it"
    allowed = max(config.max_step, _FASTER * fastest * seconds)
    is_silent = abs(seconds) > config.max_silence
    is_back = _from_origin(now) <= _ORIGIN and _from_origin(before) > _AWAY
    if is_back and (is_silent or step > max(_AWAY, _FASTER * fastest * seconds)):
        text = f"odometry is back at its origin, {step:.1f} m away, as if it began anew: {apart}"
        return Refusal("restart", step, text)
    if step > allowed:
        text = f"odometry jumped by {step:.1f} m, more than {allowed:.4g}: {apart}"
        return Refusal("jump", step, text)
    if not is_silent:
        return None
    if seconds < 0:  # a recording that is played again, or a clock that was set
        text = f"the time stamp goes back by {-seconds:.1f} s, and clouds do not confirm odometry"
        return Refusal("stamp", -seconds, f"{text}: {apart}")
    text = f"{seconds:.1f} s without frames, and clouds contradict odometry: {apart}"
    return Refusal("silence", seconds, text)


def contradicts(source: PreparedCloud, target: PreparedCloud, driven: Edge) -> bool:
    """Whether points of either cloud stand, by odometry, where the other sensor saw free space.

    Clouds that show different places contradict nothing, nor do any if odometry may be off by more
    than points that agree are apart. Range images of method planar have no points; they contradict
    what they do not confirm.

    Args:
        source, target: clouds that registration refused to join.
        driven: target_from_source by odometry.
    """
    if source.scene is not None:
        return True
    if np.linalg.eigvalsh(driven.covariance[:3, :3])[-1] > source.config.overlap_distance**2:
        return False
    leveled = target.level_from_cloud @ driven.pose @ inverse(source.level_from_cloud)
    for one, other, pose in ((source, target, leveled), (target, source, inverse(leveled))):
        points = one.above_ground
        counts = count_overlap(
            points,
            other.above_ground,
            other.ranges,
            pose,
            distance=one.config.overlap_distance,
            further=other.further,
        )
        seen = counts["agreeing"] + counts["before"]
        if seen > _FEWEST_SEEN * len(points) and counts["before"] > counts["agreeing"]:
            return True
    return False


def fastest_step(keyframes: Sequence[StoredKeyframe]) -> float:
    """Largest speed by odometry from one keyframe to the next, m/s; 0 if times tell none."""
    speeds = [0.0]
    for before, after in itertools.pairwise(keyframes):
        seconds = (after.stamp_ns - before.stamp_ns) / 1e9
        if before.stamp_ns and seconds > 0:
            way = np.linalg.norm(after.odometry[:3, 3] - before.odometry[:3, 3])
            speeds.append(float(way) / seconds)
    return max(speeds)


def _from_origin(odometry: Matrix) -> float:
    """Metres or radians, whichever are more."""
    turn = np.linalg.norm(log(odometry)[3:])
    return float(max(np.linalg.norm(odometry[:3, 3]), turn))
