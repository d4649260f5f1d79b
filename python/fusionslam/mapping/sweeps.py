# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Motion within the scans of keyframes, undone along the solved path where it was not before."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np

from fusionslam._core import deskew
from fusionslam.base.arrays import Floats
from fusionslam.geometry.se3 import exp, inverse, log
from fusionslam.loop_closure.observation import fusion_of_scans
from fusionslam.mapping.clouds import unpack_cloud
from fusionslam.mapping.config import step_covariance
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import MapFile, StoredCloud, StoredFrames
from fusionslam.mapping.map_settings import MapSettings
from fusionslam.mapping.surfaces import thickening
from fusionslam.registration import PreparedCloud, register
from fusionslam.sensors.frame import Cloud

_POSES = 65
"""Along a scan, at even steps of time."""
_KNOTS = 3
"""Poses of the path before a scan, and after its stamp, that tell how the robot moved."""
_NEAR_S = 1.0
"""Between poses farther apart in time a robot may have turned and stopped."""
_LEAST_M = 1 / 256
"""Half a step of the stored coordinates: motions that move no point farther are left."""
_ASKED = 20
"""Keyframes of a stretch, at most, that tell whether its surfaces get thinner."""
_READY = 64
"""Clouds that are kept prepared for registration."""


class SolvedSweeps:
    """Clouds of keyframes, motion within their scans undone along the solved path.

    Those are left alone whose motion was undone before they were added, or whose points have no
    times; and those of a stretch of odometry whose surfaces would get thicker, as where a driver
    had undone the motion.
    Nothing that was measured is rewritten: clouds are corrected whenever they are read.

    Args:
        content: keyframes and poses.
        read: clouds of a keyframe by its number.
        frames_after: frames between a keyframe and the next one by its number.
    """

    def __init__(
        self,
        content: MapContent,
        read: Callable[[int], StoredCloud],
        frames_after: Callable[[int], StoredFrames],
    ) -> None:
        self._content, self._read, self._frames_after = content, read, frames_after
        self._numbers, self._poses = content.numbers.tolist(), content.poses
        self._versions = lru_cache(4)(self._make_versions)
        self._is_bent = cache(self._find_bent)

    def cloud(self, number: int) -> Cloud:
        """Return the cloud of a keyframe, its motion undone if that makes surfaces thinner.

        Raises:
            DataError: a stored cloud is damaged.
        """
        is_bent = self.straightens(number)  # reads others; the cloud's versions are the newest then
        return self._versions(number)[is_bent]

    def straightens(self, number: int) -> bool:
        """Whether the cloud of a keyframe is not as it was added."""
        if not self._is_bent(self._content.stretches[number]):
            return False
        stored, corrected = self._versions(number)
        return corrected is not stored

    def _find_bent(self, stretch: int) -> bool:
        """Whether surfaces of a stretch get thinner, by the keyframes where it turns fastest."""
        rows = [
            row for k, row in self._content.row.items() if self._content.stretches[k] == stretch
        ]
        steps = log(inverse(self._poses[rows[:-1]]) @ self._poses[rows[1:]])
        stamps_ns = [self._content.keyframes[row].stamp_ns for row in rows]
        turned = np.linalg.norm(steps[:, 3:], axis=1) / np.diff(stamps_ns).clip(1)
        fastest = np.argsort(-turned, kind="stable")[:_ASKED]
        return sum(self._thickening(self._numbers[rows[each]]) for each in fastest) < 0

    def _thickening(self, number: int) -> float:
        """How much thicker surfaces get that a keyframe, the one before and the one after show."""
        stored, corrected = self._versions(number)
        if corrected is stored:
            return 0.0
        placed: list[list[Floats]] = [[], []]
        for other in (self._neighbor(number, side) for side in (-1, 0, 1)):
            if other is None:
                continue
            pose = self._step(number, other)
            for rows, cloud in zip(placed, self._versions(other), strict=True):
                rows.append(cloud.points @ pose[:3, :3].T + pose[:3, 3])
        before, after = map(np.concatenate, placed)
        return thickening(before, after)

    def stored(self, number: int) -> Cloud:
        """Return the cloud of a keyframe as it was added."""
        return self._versions(number)[0]

    def _make_versions(self, number: int) -> tuple[Cloud, Cloud]:
        """The cloud as it is stored, and corrected; the same object if there is nothing to."""
        cloud = unpack_cloud(self._read(number).points)
        if cloud.seconds is None:
            return cloud, cloud
        span = float(cloud.seconds.min()), float(cloud.seconds.max())
        motions = self._motions(number, np.linspace(*span, _POSES))
        if motions is None:
            return cloud, cloud
        points = deskew(cloud.points, cloud.seconds, exp(motions), span)
        if np.abs(points - cloud.points).max() < _LEAST_M:
            return cloud, cloud
        return cloud, replace(cloud, points=points)

    def _motions(self, number: int, times: Floats) -> Floats | None:
        """Small motions, (K, 6), from a keyframe's stamp to times after it; None if unknown.

        A cubic spline goes through the nearest poses of the path before and after.
        """
        from scipy.interpolate import CubicSpline  # slow to import

        before, after = self._path(number, -1)[-_KNOTS:], self._path(number, 1)[:_KNOTS]
        if not (before and after):  # no curve beyond the end of the path
            before, after = before[-1:], after[:1]
        if not (before or after):
            return None
        knots = [*before, (0.0, np.zeros(6)), *after]
        motions: Floats = CubicSpline(*map(np.array, zip(*knots, strict=True)))(times)
        return motions

    def _path(self, number: int, side: int) -> list[tuple[float, Floats]]:
        """The solved path from a keyframe to the one before or after, as far as it is near in time.

        Odometry tells the poses of frames in between. What the solved step differs from it is
        shared out evenly in time.

        Returns:
            Seconds after the keyframe's stamp, ascending, and small motions from there, (6,).
        """
        other = self._neighbor(number, side)
        if other is None:
            return []
        first, last = sorted((number, other))
        begin, end = (self._content.keyframes[self._content.row[each]] for each in (first, last))
        length = (end.stamp_ns - begin.stamp_ns) / 1e9
        if length <= 0:
            return []
        frames = self._frames_after(first)
        seconds = (frames.stamps_ns - begin.stamp_ns) / 1e9
        is_later = seconds > np.maximum.accumulate(np.append(0.0, seconds[:-1]))
        used = is_later & (seconds < length)
        seconds, step = seconds[used], self._step(first, last)
        driven = inverse(begin.robot_from_cloud) @ exp(frames.motions[used]) @ end.robot_from_cloud
        error = log(step @ inverse(inverse(begin.odometry) @ end.odometry))
        poses = exp(np.outer(seconds / length, error)) @ driven
        if number == first:
            seconds, poses = np.append(seconds, length), np.concatenate([poses, step[None]])
        else:
            seconds = np.append(-length, seconds - length)
            poses = inverse(step) @ np.concatenate([np.eye(4)[None], poses])
        near = np.abs(seconds) <= _NEAR_S
        return list(zip(seconds[near].tolist(), log(poses[near]), strict=True))

    def _neighbor(self, number: int, side: int) -> int | None:
        """The keyframe so many before or after one, if odometry connects them; else None."""
        row = self._content.row[number] + side
        if not 0 <= row < len(self._numbers):
            return None
        other: int = self._numbers[row]
        stretches = self._content.stretches
        return other if stretches[other] == stretches[number] else None

    def _step(self, number: int, other: int) -> Floats:
        """Solved pose of one keyframe in another's frame, number_from_other."""
        here, there = (self._poses[self._content.row[each]] for each in (number, other))
        step: Floats = inverse(here) @ there
        return step


def measure_anew(content: MapContent, settings: MapSettings, file: MapFile) -> list[Edge]:
    """Return loops and steps as clouds measure them whose motion is undone along the solved path.

    Those of clouds that stay as they are stored are left out, and so are those that clouds no
    longer prove, or that a person decided.

    Args:
        content: solved.
        settings: of the map. Where coloured clouds are a part of the scans that are registered,
            or range images are, nothing is measured anew.
        file: of the map.
    """
    registration = settings.registration
    is_whole = fusion_of_scans(settings.fusion, registration) == settings.fusion
    if registration.method == "planar" or not is_whole:
        return []
    sweeps = SolvedSweeps(content, file.cloud, file.frames_after)

    straightens = cache(sweeps.straightens)

    @lru_cache(_READY)
    def prepare(number: int) -> PreparedCloud:
        return PreparedCloud(sweeps.cloud(number), registration)

    anew = []
    for edge in content.edges.values():
        is_decided = edge.kind == "odometry" or edge.is_by_hand
        if is_decided or content.part(edge.a) != content.part(edge.b):
            continue
        if not (straightens(edge.a) or straightens(edge.b)):
            continue
        guess = inverse(content.pose(edge.a)) @ content.pose(edge.b)
        found = register(prepare(edge.b), prepare(edge.a), guess, search=False)
        if found.target_from_source is None or found.covariance is None:
            continue
        covariance = found.covariance
        if content.is_step(edge) and not prepare(edge.b).is_sector:
            covariance = step_covariance(covariance, registration, settings.map)
        anew.append(replace(edge, pose=found.target_from_source, covariance=covariance))
    return anew
