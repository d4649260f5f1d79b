# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry of a LiDAR, with an IMU or without; each pose is checked before it is returned.

>>> odometry = LidarOdometry()
>>> for frame in dataset:
...     first_from_scan = odometry.process(frame.points, frame.stamp_ns, frame.point_seconds)
"""

import sys
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from fusionslam._core import (
    GroundSegmentsConfig,
    count_overlap,
    deskew,
    drop_invalid,
    nearest_ranges,
    remove_ground_segments,
    voxel_downsample,
)
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Floats32, Integers, Matrix, Points, read_numbers
from fusionslam.base.texts import counted
from fusionslam.config import Section, merged, option
from fusionslam.errors import (
    ClockError,
    ConfigError,
    DataError,
    FusionSlamError,
    ShapeError,
    needing,
)
from fusionslam.geometry.se3 import inverse, motion_size
from fusionslam.odometry.inertial_matcher import Felt, InertialMatcher
from fusionslam.sensors.frame import read_pose
from fusionslam.sensors.messages import NANOSECONDS, Imu, as_stamp

FEWEST_POINTS = 100
"""Scans with fewer points are refused."""

_FAST_NS = 200_000_000
# Within this time velocity hardly changes, however fast a car drives.
_LONGEST_RATIO = 3.0
# After a gap this many times as long as the one before, the robot may have stopped.
_HIDDEN_WEIGHT = 0.25
# Of points that the other scan could not see, as in registration.
_LEAST_WAY_M = 1.0
_GROUND_STRIDE = 50
_STEPS = 65
# Along a scan, in which a LiDAR turns by a few degrees.


class LidarOdometryConfig(Section):
    """How scans are registered, and when their poses are refused."""

    voxel: float | None = option(
        None,
        "voxels of the local map; null: a 20th of the range of nine in ten points, 0.1 to 1",
        unit="m",
        gt=0,
    )
    max_range: float = option(100.0, "farther points are not used", unit="m", gt=0)
    max_step: float = option(
        1.5,
        "farthest motion between two scans more than 0.2 s apart; between others, largest change "
        "of it",
        unit="m",
        gt=0,
    )
    max_turn: float = option(15.0, "as max_step, of turns", unit="deg", gt=0, le=180)
    min_overlap: float = option(
        0.6, "least overlap of two scans whose poses are believed", ge=0, le=1
    )
    lost_scans: int = option(3, "scans with less overlap until odometry counts as lost", ge=1)
    imu: Literal["auto", "always", "never"] = option(
        "auto",
        "whether the turns and accelerations of an IMU are used: auto, where the recording has "
        "them with times of points and RKO-LIO is installed",
    )


class Deviation(NamedTuple):
    """Standard deviations of odometry that grow with the root of the way.

    Attributes:
        position: metres after one metre.
        angle: radians after one metre.
    """

    position: float
    angle: float


_LEAST_DEVIATION = Deviation(0.05, 0.005)
# A LiDAR that starts slowly seems to stand still for some decimetres, which is no random error.


class _RegisteredScan(NamedTuple):
    """What the next scan is compared with: points above the ground, and ranges seen."""

    stamp_ns: int
    pose: Matrix
    above: Points
    ranges: Floats32


@checked
class LidarOdometry:
    """Estimates the poses of a LiDAR from its scans, and refuses poses that cannot be right.

    KISS-ICP registers scans alone, RKO-LIO scans with what an IMU feels. The map is that of the
    last scans within range; there is no loop closure, so poses drift.

    Attributes:
        overlap: share of what the last scan and the one before both saw that agrees, 0 to 1.
        motion: float64 (4, 4), the pose of the last scan in the frame of the one before.
        failure: why no further scan is taken; None before one was.

    Args:
        config: None for the defaults.
        scan_from_imu: float64 (4, 4), where the IMU is in the frame of the scans; None without one.
        changes: configuration values to override.

    Raises:
        ConfigError: an unknown key, or a value out of range.
        ShapeError, DataError: ``scan_from_imu`` is no rigid motion.
        FusionSlamError: KISS-ICP or RKO-LIO is not installed (code "missing-extra"), or KISS-ICP
            has no package for this Python ("no-package").
    """

    def __init__(
        self,
        config: LidarOdometryConfig | None = None,
        scan_from_imu: Matrix | None = None,
        **changes: Any,
    ) -> None:
        self.config = merged(config or LidarOdometryConfig(), changes)
        self.overlap = 1.0
        self.motion: Matrix = np.eye(4)
        self._voxel = self.config.voxel or 0.0
        # Made here so that a missing package is found before the first scan is read.
        self._icp: Any = None
        self._inertial: InertialMatcher | None = None
        place = read_pose("scan_from_imu", scan_from_imu)
        if place is not None and not np.isfinite(place).all():
            raise DataError(f"scan_from_imu is not finite: {place.tolist()}", code="not-finite")
        if place is None:
            self._icp = _make_icp(self._voxel or 1.0, self.config.max_range)
        else:
            self._inertial = InertialMatcher(place, self.config.max_range)
        self._last: _RegisteredScan | None = None
        # In which the motion was made; None before the velocity is known.
        self._gap_ns: int | None = None
        self.failure: FusionSlamError | None = None
        self._lost = 0
        self._way = 0.0
        self._changes = np.zeros(2)

    @property
    def deviation(self) -> Deviation:
        """Estimate of the error, from how unevenly the scans moved, and at least that of starts.

        Noise of single motions and true acceleration cannot be told apart: both count.
        """
        # The difference of two motions has twice the variance of one.
        random = np.sqrt(self._changes / 2 / max(self._way, _LEAST_WAY_M))
        return Deviation(*np.maximum(random, _LEAST_DEVIATION).tolist())

    @property
    def takes_imu(self) -> bool:
        """Whether it uses an IMU."""
        return self._inertial is not None

    @property
    def felt(self) -> Felt | None:
        """What the IMU says of itself and of what is up; None before the first scan, or without."""
        return None if self._inertial is None else self._inertial.felt

    def add(self, imu: Imu) -> None:
        """Take a message of the IMU: before a scan, all until its last point.

        Raises:
            DataError: it is not finite (code "not-finite"), or in other units ("imu-unit").
            ConfigError: nothing says where the IMU is.
        """
        if self._inertial is None:
            raise ConfigError(
                "the IMU is of no use: expected its place, LidarOdometry(scan_from_imu=)"
            )
        self._inertial.add(imu)

    def process(self, points: Points, stamp_ns: int, seconds: ArrayLike | None = None) -> Matrix:
        """Register the next scan.

        Args:
            points: float32 (N, 3), metres, the sensor at the origin. NaN and infinity mark rays
                without return. Better with z up: the ground then counts as no overlap.
            stamp_ns: time of the pose that is returned.
            seconds: float (N), when each point was measured, after the stamp; None if unknown or
                if the scan shows the world at its stamp already.

        Returns:
            float64 (4, 4), first_from_scan, first being the first scan.

        Raises:
            ShapeError: arrays of other shapes.
            ClockError: a stamp that is not later than the one before (code "clock").
            DataError: too few points (code "few-points"), or a time that is not finite
                ("not-finite"). These scans change nothing.
            DataError: the IMU says nothing between two scans ("no-imu"), or feels no gravity in
                the beginning ("imu-unit"). So is every scan after it.
            DataError: the scan is too far from the one before ("far-apart"), or the last
                ``lost_scans`` overlap too little with the ones before ("lost"); so is every
                scan after it.
        """
        if self.failure is not None:
            raise self.failure
        stamp_ns = as_stamp(stamp_ns)
        kept, parts = _check_scan(points, seconds)
        if self._last is not None and stamp_ns <= self._last.stamp_ns:
            raise ClockError(
                f"scan at {stamp_ns} ns: expected a stamp after {self._last.stamp_ns} ns, that of "
                "the scan before",
                fields=(str(stamp_ns), str(self._last.stamp_ns)),
            )
        if self._last is None and not self._voxel:
            ranges = np.linalg.norm(kept, axis=1)
            self._voxel = float(np.clip(np.quantile(ranges, 0.9) / 20, 0.1, 1.0))
            if self._inertial is None:
                self._icp = _make_icp(self._voxel, self.config.max_range)
        try:
            return self._register(kept, stamp_ns, parts)
        except FusionSlamError as error:
            self.failure = error
            raise

    def _register(self, points: Points, stamp_ns: int, seconds: Floats) -> Matrix:
        last = self._last
        gap_ns = stamp_ns - last.stamp_ns if last else NANOSECONDS
        # At constant velocity; none where nothing tells the velocity.
        ratio = gap_ns / self._gap_ns if self._gap_ns else 0.0
        part = ratio if ratio <= _LONGEST_RATIO else 0.0
        expected: Matrix = _take_part(self.motion, np.array([part]))[0]
        if self._inertial is None:
            # To the middle of the sweep: to its begin, errors of the velocity would build up.
            at = (seconds.min() + seconds.max()) / 2 if len(seconds) else 0.0
            points, above = self._look_above(points, seconds - at, gap_ns, expected)
            pose = self._match(points, above, expected if last else np.eye(4))
        else:
            at = float(seconds.max()) if len(seconds) else 0.0
            times_ns = stamp_ns + np.round(seconds * NANOSECONDS).astype(np.int64)
            if not len(seconds):
                times_ns = np.full(len(points), stamp_ns)
            pose = self._inertial.register(points, times_ns, self._voxel)
            motion = np.eye(4) if last is None else inverse(last.pose) @ pose
            points, above = self._look_above(points, seconds - at, gap_ns, motion)
        voxels = voxel_downsample(points[above], size=self._voxel / 2)[0]
        self._last = _RegisteredScan(stamp_ns, pose, voxels, nearest_ranges(points, step=1.0))
        if last is not None:
            self._follow(last, self._last, expected)
        until_stamp = np.array([-at * NANOSECONDS / gap_ns])
        at_stamp: Matrix = pose @ _take_part(self.motion, until_stamp)[0]
        return at_stamp

    def _look_above(
        self, points: Points, seconds: Floats, gap_ns: int, motion: Matrix
    ) -> tuple[Points, Integers]:
        """The points as seen at the time 0 of theirs, and the indices of those above the ground."""
        if len(seconds):
            points = _undo(points, seconds * (NANOSECONDS / gap_ns), motion)
        # Rings on the ground move with the LiDAR: only what is above it shows motion.
        ground = GroundSegmentsConfig(distance=self._voxel / 5)
        return points, remove_ground_segments(points, config=ground)[0]

    def _match(self, points: Points, above: Integers, expected: Matrix) -> Matrix:
        """first_from_scan by KISS-ICP."""
        self._icp.last_delta = expected
        thinned = _thin_rest(points, above).astype(np.float64)
        self._icp.register_frame(thinned, np.zeros(0))
        pose: Matrix = self._icp.last_pose.copy()
        return pose

    def _follow(self, last: _RegisteredScan, scan: _RegisteredScan, expected: Matrix) -> None:
        """Take over the motion between two scans, and check it."""
        is_moving, gap_ns = self._gap_ns is not None, scan.stamp_ns - last.stamp_ns
        motion: Matrix = np.linalg.inv(last.pose) @ scan.pose
        back = np.linalg.inv(motion).astype(np.float64)
        self.motion, self._gap_ns = motion, gap_ns
        self._check_motion(expected, gap_ns, is_moving)
        self.overlap = min(
            _overlap(last, scan, back, self._voxel / 2),
            _overlap(scan, last, motion, self._voxel / 2),
        )
        self._lost = self._lost + 1 if self.overlap < self.config.min_overlap else 0
        if self._lost >= self.config.lost_scans:
            raise self._lost_error()

    def _check_motion(self, expected: Matrix, gap_ns: int, is_moving: bool) -> None:
        step, turn = motion_size(self.motion)
        change = motion_size(np.linalg.inv(expected) @ self.motion)
        self._way += step
        if is_moving:
            self._changes += np.square([change[0], np.deg2rad(change[1])])
        is_fast = gap_ns <= _FAST_NS
        if is_fast and not is_moving:
            return  # the velocity is known from the next scan on
        checked, what = (step, turn), "from the one before"
        if is_fast:
            checked, what = change, "from where constant velocity leads"
        if checked[0] > self.config.max_step or checked[1] > self.config.max_turn:
            raise DataError(
                f"the scan is {checked[0]:.2f} m and {checked[1]:.1f} degrees {what}, "
                f"{gap_ns / NANOSECONDS:.3g} s earlier: {self._expectation()}",
                code="far-apart",
                fields=(f"{checked[0]:.2f}", f"{checked[1]:.1f}"),
            )

    def check(self) -> None:
        """Refuse a recording that ends with scans that overlap too little.

        Raises:
            DataError: the last scan does, without being one of ``lost_scans`` (code "lost").
        """
        if self._lost:
            raise self._lost_error()

    def _lost_error(self) -> DataError:
        assert self._gap_ns is not None
        return DataError(
            f"odometry is lost: the last {counted(self._lost, 'scan')} overlapped too little with "
            f"those before, this one by {self.overlap:.2f}, at least {self.config.min_overlap:g} "
            f"wanted, {self._gap_ns / NANOSECONDS:.3g} s later: {self._expectation()}",
            code="lost",
            fields=(str(self._lost), f"{self.overlap:.2f}"),
        )

    def _expectation(self) -> str:
        if self._inertial is not None:
            return (
                "expected turns and accelerations of the IMU in rad/s and m/s^2, in a place and at "
                "times that fit the scans"
            )
        return (
            f"expected scans at most {self.config.max_step:g} m and {self.config.max_turn:g} "
            "degrees apart, as 10 in a second are; slower scans need odometry of the wheels"
        )


def _make_icp(voxel: float, max_range: float) -> Any:
    """KISS-ICP (Vizzo et al., RA-L 2023): scans registered to a local map, on one thread.

    Its own deskewing is off: it takes the pose for that of the last point, whatever the stamp, and
    ends the process where all points have the same time.

    Args:
        voxel: of the local map, metres.
        max_range: farther points are not used, metres.

    Raises:
        FusionSlamError: KISS-ICP is not installed (code "missing-extra"), or has no package for
            this Python ("no-package").
    """
    try:
        with needing("odometry", "odometry by LiDAR needs KISS-ICP"):
            from kiss_icp import kiss_icp
            from kiss_icp.config import config
    except FusionSlamError as error:
        if sys.version_info < (3, 14):
            raise
        raise FusionSlamError(
            "odometry by LiDAR needs KISS-ICP, which has no package for Python 3.14 and later",
            code="no-package",
            fields=("kiss-icp",),
        ) from error
    # Its own class of the whole configuration takes values from the environment, too.
    return kiss_icp.KissICP(
        SimpleNamespace(
            data=config.DataConfig(max_range=max_range, min_range=0.0, deskew=False),
            mapping=config.MappingConfig(voxel_size=voxel, max_points_per_voxel=20),
            registration=config.RegistrationConfig(max_num_threads=1),
            adaptive_threshold=config.AdaptiveThresholdConfig(),
        )
    )


def _take_part(motion: Matrix, parts: Floats) -> Floats:
    """float64 (K, 4, 4): parts or multiples (K) of a motion, turn and translation on their own."""
    result = np.tile(np.eye(4), (len(parts), 1, 1))
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    result[:, :3, :3] = Rotation.from_rotvec(parts[:, None] * turn).as_matrix()
    result[:, :3, 3] = parts[:, None] * motion[:3, 3]
    return result


def _check_scan(points: Any, seconds: ArrayLike | None) -> tuple[Points, Floats]:
    """The points that are returns, and their times; empty times if unknown."""
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind != "f":
        raise ShapeError(
            f"points: {array.dtype} {array.shape}, expected float32 (N, 3)", code="no-cloud"
        )
    array = np.ascontiguousarray(array, np.float32)
    kept = drop_invalid(array)
    if len(kept) < FEWEST_POINTS:
        raise DataError(
            f"the scan has {len(kept)} finite points, expected at least {FEWEST_POINTS}",
            code="few-points",
            fields=(str(len(kept)),),
        )
    if seconds is None:
        return array[kept], np.zeros(0)
    times = read_numbers("seconds", seconds, "(N,), one for each point")
    if times.shape != (len(array),):
        raise ShapeError(f"seconds: {times.shape}, expected ({len(array)},), one for each point")
    if (bad := np.flatnonzero(~np.isfinite(times[kept]))).size:
        raise DataError(
            f"the time of point {kept[bad[0]]} is {times[kept[bad[0]]]}, expected a finite one",
            code="not-finite",
            fields=(str(kept[bad[0]]),),
        )
    return array[kept], times[kept]


def _thin_rest(points: Points, kept: Integers) -> Points:
    """The kept points, and a few of the others, which hold height and tilt."""
    is_rest = np.ones(len(points), np.bool_)
    is_rest[kept] = False
    is_rest[np.flatnonzero(is_rest)[::_GROUND_STRIDE]] = False
    return points[~is_rest]


def _undo(points: Points, parts: Floats, motion: Matrix) -> Points:
    """The points as seen from where the parts are 0, each measured after a part of a motion."""
    span = float(parts.min()), float(parts.max())
    return deskew(points, parts, _take_part(motion, np.linspace(*span, _STEPS)), span)


def _overlap(
    one: _RegisteredScan, other: _RegisteredScan, other_from_one: Matrix, distance: float
) -> float:
    """Share of a scan's points above the ground that the other confirms, of those it could."""
    counts = count_overlap(one.above, other.above, other.ranges, other_from_one, distance=distance)
    against = counts["before"] + _HIDDEN_WEIGHT * (counts["behind"] + counts["open"])
    return counts["agreeing"] / max(1.0, counts["agreeing"] + against)
