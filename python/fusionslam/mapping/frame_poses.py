# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of all frames of a session: of keyframes by the graph, of those between by odometry."""

from typing import NamedTuple

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers
from fusionslam.geometry.se3 import carry_covariance, exp, inverse, log
from fusionslam.mapping.config import odometry_covariance
from fusionslam.mapping.marginals import keyframe_covariances
from fusionslam.mapping.place_map import PlaceMap

_STANDS = 1e-9  # metres and radians of odometry between two keyframes


class FramePoses(NamedTuple):
    """Poses of all frames of a session, in the order in which they were added.

    Attributes:
        numbers: int64 (n,), of the recording's frames.
        stamps_ns: int64 (n,), time stamps; 0 if unknown.
        poses: float64 (n, 4, 4), map_from_robot, each in its part of the map.
        parts: int64 (n,), of the map, as ``Session.parts`` numbers them.
        keyframes: int64 (n,), numbers of the keyframe that each frame is, or comes after.
        covariances: float64 (n, 6, 6), against the first keyframe of the part: x, y, z in metres,
            rotations about x, y, z in radians, as small motions in the robot's frame; None if they
            were not asked for.
    """

    numbers: Integers
    stamps_ns: Integers
    poses: Floats
    parts: Integers
    keyframes: Integers
    covariances: Floats | None = None

    def select(self, chosen: Integers) -> "FramePoses":
        """Those of some frames."""
        return FramePoses(*(None if each is None else each[chosen] for each in self))  # type: ignore[arg-type]


@checked
def frame_poses(site: PlaceMap, session: str, *, covariance: bool = False) -> FramePoses:
    """Return the poses of all frames of a session that the file has.

    Between two keyframes odometry leads from both to the frame. What the two poses differ in is
    shared out evenly along odometry's way, so that the path is continuous and goes through the
    solved poses. After the last keyframe of an unbroken odometry, the frames follow it.

    Covariances between keyframes are bounds: those of both, weighted likewise, and that of odometry
    whose two ends are held. They are equal to the marginal ones at keyframes.

    Args:
        site: the map. Frames since its last keyframe are in the file once it is solved or closed.
        session: name of the session.
        covariance: whether they are computed, which takes time for each keyframe of the map.

    Raises:
        ConfigError: there is no such session.
        DataError: the file is damaged, or a session was forgotten since it was opened (code
            "changed").
    """
    _, solved = site.trajectory(session)
    odometry, content = site.odometry(session), site.content
    keyframes = content.keyframes_of(content.find_session(session))
    between = [site.file.frames_after(each.id) for each in keyframes]
    counts = np.array([1 + len(each.numbers) for each in between])
    row, last = np.repeat(np.arange(len(counts)), counts), np.cumsum(counts) - 1
    first = last + 1 - counts
    is_between = np.ones(len(row), bool)
    is_between[first] = False
    moved, numbers, stamps = np.tile(np.eye(4), (len(row), 1, 1)), row.copy(), row.copy()
    numbers[first] = [each.frame for each in keyframes]
    stamps[first] = [each.stamp_ns for each in keyframes]
    numbers[is_between] = np.concatenate([each.numbers for each in between])
    stamps[is_between] = np.concatenate([each.stamps_ns for each in between])
    moved[is_between] = exp(np.concatenate([each.motions for each in between]))

    stretches = np.array([content.stretches[each.id] for each in keyframes])
    leads_on = np.append(stretches[:-1] == stretches[1:], False)
    # Where odometry leads from each keyframe: to the next one, or as far as it is known.
    ends = moved[last]
    ends[leads_on] = (inverse(odometry[:-1]) @ odometry[1:])[leads_on[:-1]]
    errors = np.zeros((len(keyframes), 6))
    steps = (inverse(solved[:-1]) @ solved[1:])[leads_on[:-1]]
    errors[leads_on] = log(steps @ inverse(ends[leads_on]))
    after = np.append(moved[1:], moved[:1], axis=0)
    after[last] = ends
    ways = np.linalg.norm(log(inverse(moved) @ after), axis=1)
    passed = np.cumsum(ways) - ways
    whole = (passed + ways)[last] - passed[first]
    share = (np.arange(len(row)) - first[row]) / counts[row]  # of a robot that stands
    drives = whole[row] > _STANDS
    share[drives] = ((passed - passed[first][row])[drives] / whole[row][drives]).clip(0, 1)
    poses = solved[row] @ exp(share[:, None] * errors[row]) @ moved
    covariances = None
    if covariance:
        known = keyframe_covariances(content)[[content.row[each.id] for each in keyframes]]
        mounts = np.array([each.robot_from_cloud for each in keyframes])
        known = carry_covariance(mounts, known)
        config = site.settings.map
        covariances = carry_covariance(inverse(moved), known[row])
        for k in np.flatnonzero(is_between & ~leads_on[row]).tolist():
            covariances[k] += odometry_covariance(moved[k], config)
        held = leads_on[row]
        step = np.zeros_like(known)
        step[leads_on] = [odometry_covariance(each, config) for each in ends[leads_on]]
        weight, back = share[held, None, None], inverse(moved[held]) @ ends[row[held]]
        other = carry_covariance(back, known[row[held] + 1] + (1 - weight) * step[row[held]])
        covariances[held] = (1 - weight) * covariances[held] + weight * other
    ids = np.array([each.id for each in keyframes], np.int64)[row]
    parts = np.array([content.part(each.id) for each in keyframes], np.int64)[row]
    return FramePoses(numbers, stamps, poses, parts, ids, covariances)
