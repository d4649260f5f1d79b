# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Motion within the scans of keyframes, undone anew along the solved path."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fusionslam._core import deskew
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.geometry.se3 import adjoint, exp, inverse, log
from fusionslam.mapping.clouds import Sweep, unpack_cloud
from fusionslam.mapping.config import DriftModel, MapConfig, odometry_covariance
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import StoredCloud
from fusionslam.sensors.frame import Cloud

_POSES = 65
"""Along a sweep, at even steps of time."""
_NEAR_S = 1.0
"""Between keyframes farther apart in time a robot may have turned and stopped."""
_LEAST_M = 1 / 256
"""Half a step of the stored coordinates: corrections that move no point farther are left."""
_PATCH_M = 0.4
_FEWEST = 10
"""Points of a patch."""
_FLAT = 0.1
"""Variance across a surface, of the lesser one along it."""


class SolvedSweeps:
    """Clouds of keyframes as the solved poses say that their sensor moved, where that is better.

    Nothing that was measured is rewritten: clouds are corrected whenever they are read.

    Args:
        content: keyframes and poses.
        config: how far odometry is trusted.
        read: clouds of a keyframe by its number.
    """

    def __init__(
        self, content: MapContent, config: MapConfig, read: Callable[[int], StoredCloud]
    ) -> None:
        self._content, self._config, self._read = content, config, read
        self._drift = DriftModel(**config.drift.model_dump())
        self._numbers, self._poses = content.numbers.tolist(), content.poses
        self._versions = lru_cache(4)(self._make_versions)

    def cloud(self, number: int) -> Cloud:
        """Return the cloud of a keyframe, its motion undone anew if that makes surfaces thinner.

        Those are the surfaces that it shows together with the keyframes before and after it.

        Raises:
            DataError: a stored cloud is damaged.
        """
        stored, corrected = self._versions(number)
        if corrected is stored:
            return stored
        placed: list[list[Floats]] = [[], []]
        for other in (self._neighbor(number, side) for side in (-1, 0, 1)):
            if other is None:
                continue
            pose = self._step(number, other)
            for rows, cloud in zip(placed, self._versions(other), strict=True):
                rows.append(cloud.points @ pose[:3, :3].T + pose[:3, 3])
        before, after = map(np.concatenate, placed)
        return corrected if is_thinner(before, after) else stored

    def _make_versions(self, number: int) -> tuple[Cloud, Cloud]:
        """The cloud as it is stored, and corrected; the same object if there is nothing to."""
        cloud, sweep = unpack_cloud(self._read(number).points)
        if sweep is None or not len(cloud):
            return cloud, cloud
        assert cloud.seconds is not None
        times = np.linspace(*sweep.span, _POSES)
        find = self._motion if sweep.moved is None else self._remaining
        motions = find(number, times, sweep)
        if motions is None:
            return cloud, cloud
        # Registration found the keyframe's pose by the stored points, and fits their middle.
        middle = [np.interp(cloud.seconds.mean(), times, column) for column in motions.T]
        poses = inverse(exp(np.array(middle))) @ exp(motions)
        points = deskew(cloud.points, cloud.seconds, poses, sweep.span)
        if np.abs(points - cloud.points).max() < _LEAST_M:
            return cloud, cloud
        return cloud, replace(cloud, points=points)

    def _remaining(self, number: int, times: Floats, sweep: Sweep) -> Floats | None:
        """What is left of a motion that was undone by odometry, (K, 6), as small motions.

        Odometry's error over the step to the next keyframe (or the one before, for points before
        the stamp), which the solution tells, is shared between the sweep and the rest of the step
        as its covariances are: the mean of the one error, given the sum of both.
        """
        assert sweep.moved is not None
        motions = np.zeros((len(times), 6))
        for side, end, moved in zip((-1, 1), sweep.span, sweep.moved, strict=True):
            other = self._neighbor(number, side)
            if other is None or side * end <= 0:
                continue
            odometry = self._content.odometry
            driven = inverse(odometry[number]) @ odometry[other]
            error = log(inverse(driven) @ self._step(number, other))
            swept = exp(moved)
            rest = inverse(swept) @ driven
            carry = adjoint(inverse(rest))
            own = self._drift.covariance(swept) @ carry.T
            whole = carry @ own + odometry_covariance(rest, self._config)
            solved = swept @ exp(own @ np.linalg.solve(whole, error))
            shares = np.clip(times / end, 0, None)
            motions += np.outer(shares, log(solved @ inverse(swept)))
        return motions

    def _motion(self, number: int, times: Floats, sweep: Sweep) -> Floats | None:
        """The motion along the solved path, (K, 6), of a cloud that is as measured.

        The path goes through the keyframes before and after, as a parabola where both are near in
        time.
        """
        keyframes, row = self._content.keyframes, self._content.row
        stamp_ns = keyframes[row[number]].stamp_ns
        known: list[tuple[float, Floats]] = []
        for side in (-1, 1):
            other = self._neighbor(number, side)
            if other is None:
                continue
            seconds = (keyframes[row[other]].stamp_ns - stamp_ns) / 1e9
            if 0 < side * seconds <= _NEAR_S and stamp_ns:
                known.append((seconds, log(self._step(number, other))))
        if not known:
            return None
        powers = np.array([[at**k for k in range(1, len(known) + 1)] for at, _ in known])
        rates = np.linalg.solve(powers, np.array([moved for _, moved in known]))
        found: Floats = np.stack([times**k for k in range(1, len(known) + 1)], axis=1) @ rates
        return found

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


def is_thinner(before: Floats, after: Floats) -> bool:
    """Whether surfaces of points, float64 (N, 3), get thinner on average as they move elsewhere.

    Points that were in one cube before stay together; cubes with a flat surface, before or after,
    count by their points.
    """
    patches, counts = patches_of(before)
    thick, is_flat = zip(*(thickness(points, patches) for points in (before, after)), strict=True)
    counted = (is_flat[0] | is_flat[1]) & (counts >= _FEWEST)
    return bool((thick[1] - thick[0])[counted] @ counts[counted] < 0)


def patches_of(points: Floats) -> tuple[Integers, Integers]:
    """Number the cubes that points, (N, 3), are in: int64 (N,), and how many are in each."""
    cells = np.floor(points / _PATCH_M).astype(np.int64)
    spans = np.ptp(cells, axis=0) + 1
    keys = np.ravel_multi_index(tuple((cells - cells.min(axis=0)).T), tuple(spans))
    _, patches, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return patches.reshape(-1), counts


def thickness(points: Floats, patches: Integers) -> tuple[Floats, Mask]:
    """Standard deviations of points, (N, 3), across the plane of each patch, and which are flat."""
    count = np.bincount(patches)
    mean = np.stack([np.bincount(patches, axis) for axis in points.T], axis=1) / count[:, None]
    off = points - mean[patches]
    products = [[np.bincount(patches, a * b) / count for b in off.T] for a in off.T]
    variances = np.linalg.eigvalsh(np.moveaxis(np.array(products), -1, 0))
    is_flat = variances[:, 0] < _FLAT * variances[:, 1]
    return np.sqrt(variances[:, 0].clip(0)), is_flat
