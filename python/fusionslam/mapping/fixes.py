# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ties fixes of a satellite receiver to the keyframes of a session."""

from collections.abc import Iterable, Sequence

import numpy as np

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.datasets.pose_files import interpolate_poses
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import inverse
from fusionslam.mapping.map_content import robot_poses
from fusionslam.mapping.map_file import StoredKeyframe
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.mapping.satellites import Position
from fusionslam.sensors.messages import NANOSECONDS, Fix

_APART_NS = NANOSECONDS // 2
"""Fixes that are nearer in time say the same, errors included: one of them counts."""
_UNSTATED = np.diag([9.0, 9.0, 36.0])
"""m^2: covariance of fixes that state none."""


def add_fixes(
    site: PlaceMap, session: str, fixes: Iterable[Fix], robot_from_antenna: Matrix
) -> bool:
    """Take in where satellites have a session of a map, and solve, if that is new.

    ``site.content.places`` says where on the globe the parts of the map are then, or why not.
    Fixes that the map has of the time before the first of these stay.

    Args:
        site: open for writing.
        session: its name.
        fixes: of one receiver.
        robot_from_antenna: float64 (4, 4).

    Returns:
        Whether the map did not have them, and was solved.

    Raises:
        ConfigError: there is no such session, or the map is read-only.
        DataError: as ``tie_fixes``, or the map cannot be written; nothing has changed then.
    """
    keyframes = site.content.keyframes_of(site.content.find_session(session))
    known = [*fixes]
    tied = tie_fixes(known, keyframes, site.content.stretches, robot_from_antenna)
    begin_ns = min(fix.stamp_ns for fix in known if fix.position is not None)
    earlier = {each.id for each in keyframes if each.stamp_ns < begin_ns}
    positions = [each for each in site.file.positions() if each.node in earlier] + tied
    if site.file.has_positions(session, positions):
        return False
    with site.file.transaction():
        site.file.store_positions(session, positions)
    site.content.set_positions(site.file.positions())
    site.solve()
    return True


def tie_fixes(
    fixes: Iterable[Fix],
    keyframes: Sequence[StoredKeyframe],
    stretches: dict[int, int],
    robot_from_antenna: Matrix,
) -> list[Position]:
    """Positions of points that are fixed to keyframes, of fixes between them.

    The point is where odometry has the antenna at the fix's time, seen from the keyframe before.
    Fixes without a position, or where odometry is broken, tell nothing.

    Args:
        fixes: of one receiver.
        keyframes: of one session, in the order of time.
        stretches: as of ``MapContent``.
        robot_from_antenna: float64 (4, 4).

    Raises:
        DataError: there is no position (code "no-fixes"), or none during the keyframes
            ("other-clock"; the field is by how many seconds the first one is late).
    """
    known = sorted((fix for fix in fixes if fix.position is not None), key=lambda f: f.stamp_ns)
    if not known or len(keyframes) < 2:
        raise DataError("no fix tells a position between two keyframes", code="no-fixes")
    stamps = np.array([each.stamp_ns for each in keyframes], np.int64)
    times = np.array([fix.stamp_ns for fix in known], np.int64)
    robot = robot_poses(keyframes, [each.odometry for each in keyframes])
    at_fixes, gaps_ns = interpolate_poses(stamps, robot, times)
    if np.isinf(gaps_ns).all():
        late_s = (times[0] - stamps[0]) / NANOSECONDS
        raise DataError(
            f"no fix is of the time of the keyframes: the first comes {late_s:+.3f} s after the "
            "first keyframe; expected stamps of one clock (or --stamps bag)",
            code="other-clock",
            fields=(f"{late_s:.3f}",),
        )
    antennas: Floats = at_fixes @ robot_from_antenna[:, 3]
    rows = np.searchsorted(stamps, times, side="right") - 1
    tied: list[Position] = []
    last_ns: int | None = None
    for fix, row, antenna, gap_ns in zip(known, rows.tolist(), antennas, gaps_ns, strict=True):
        if np.isinf(gap_ns) or (last_ns is not None and fix.stamp_ns - last_ns < _APART_NS):
            continue
        before, after = keyframes[row], keyframes[min(row + 1, len(keyframes) - 1)]
        if stretches[before.id] != stretches[after.id]:
            continue
        assert fix.position is not None
        covariance = _UNSTATED if fix.covariance is None else fix.covariance
        arm = (inverse(before.odometry) @ antenna)[:3]
        tied.append(Position(before.id, arm, fix.position, covariance))
        last_ns = fix.stamp_ns
    return tied
