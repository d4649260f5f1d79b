# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry of a robot from scans and messages of an IMU as they arrive, in any order."""

from collections import Counter, deque
from collections.abc import Callable, Iterator

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Matrix
from fusionslam.errors import ClockError, DataError, FusionSlamError
from fusionslam.odometry.lidar_odometry import LidarOdometry, LidarOdometryConfig
from fusionslam.odometry.tracking import add_until, end_of, poses_of_body
from fusionslam.sensors.messages import (
    NANOSECONDS,
    FrameTransforms,
    Imu,
    Odometry,
    Scan,
    as_nanoseconds,
)
from fusionslam.sensors.robot_frames import ODOMETRY_FRAMES, RobotFrames
from fusionslam.sensors.transforms import TransformError

_KEPT_NS = 2 * NANOSECONDS
"""What was felt is kept so long, for gravity where tracking begins anew."""
_AGAIN_NS = NANOSECONDS
"""Tracking that fails soon after it began does not begin anew before this time."""


@checked
class LiveOdometry:
    """Tracks scans once all that belongs to them has arrived; bad messages never stop it.

    A scan waits until the IMU is beyond its last point and TF places scanner and IMU, at most for
    ``wait_s`` by the newest stamp of scans. Of messages that arrive in the order of each topic in a
    bag, poses are those of ``track_lidar``, bit for bit. Where the odometry of scans is lost, it
    begins anew at the last pose.

    Args:
        config: ``imu`` "always" takes an IMU; otherwise scans alone are tracked.
        frames: TF, which the owner keeps up to date; its buffer of the IMU says which IMU counts.
        refuse: gets the reason of each scan or message that cannot be used.
        wait_s: how long a scan waits, in seconds of stamps.
        jump_s: stamps that lie farther back mean that the clock went back.
        most: largest number of waiting scans.

    Attributes:
        counts: scans tracked, left out, and how often tracking began anew after it failed.

    Raises:
        FusionSlamError: KISS-ICP or RKO-LIO is not installed (code "missing-extra").
    """

    def __init__(
        self,
        config: LidarOdometryConfig,
        frames: RobotFrames,
        refuse: Callable[[FusionSlamError], None],
        *,
        wait_s: float,
        jump_s: float,
        most: int = 100,
    ) -> None:
        self.counts: Counter[str] = Counter(tracked=0)
        self._config, self._frames, self._refuse = config, frames, refuse
        self._takes_imu, self._most = config.imu == "always", most
        self._wait_ns = as_nanoseconds("wait", wait_s)
        self._jump_ns = as_nanoseconds("jump", jump_s)
        # Here only to find a missing package before the first scan.
        LidarOdometry(config, np.eye(4) if self._takes_imu else None)
        self._odometry: LidarOdometry | None = None
        self._scans: deque[Scan] = deque()
        self._due: deque[Imu] = deque()
        self._felt: deque[Imu] = deque()
        self._newest_ns: int | None = None
        self._tried_ns: int | None = None
        self._names = "", ""
        self._robot_from_points: Matrix = np.eye(4)
        self._first: Matrix | None = None
        self._held: tuple[int, Matrix] | None = None
        self._start: Matrix = np.eye(4)
        self._last: Matrix = np.eye(4)

    @property
    def restarts(self) -> int:
        """How often tracking began anew after it had failed."""
        return self.counts["began anew"]

    @property
    def state(self) -> str:
        """By what the last scan was tracked, and what the IMU says of itself; or what it awaits."""
        if self._odometry is None:
            return "waiting for scans" + (" and IMU" if self._takes_imu else "")
        felt = self._odometry.felt
        by = "by scans alone" if felt is None else f"by scans and IMU ({felt})"
        return f"{by}, overlap {self._odometry.overlap:.2f}"

    def process(self, message: Scan | Imu | FrameTransforms) -> list[Odometry]:
        """Take a message; transforms must be in ``frames`` already. Returns the poses it leads to.

        Each is odom_from_robot at the stamp of a scan, the robot at the origin at the first one. If
        TF does not say where the robot is, it is where the scanner is.
        """
        if isinstance(message, Scan):
            self._take_scan(message)
        elif isinstance(message, Imu) and self._takes_imu:
            self._take_imu(message)
        return self._advance()

    def settle(self) -> list[Odometry]:
        """Track all waiting scans after a silence, or at the end."""
        return self._advance(final=True)

    def _take_scan(self, scan: Scan) -> None:
        newest = self._newest_ns
        if newest is not None and newest - scan.stamp_ns > self._jump_ns:
            self._scans.clear()
            kept = [imu for imu in self._due if imu.stamp_ns <= scan.stamp_ns + self._jump_ns]
            self._due = deque(kept)
            self._felt.clear()
            self._begin_anew()
            newest = self._tried_ns = None
        if newest is not None and scan.stamp_ns <= newest:
            self._leave_out(
                ClockError(
                    f"a scan at {scan.stamp_ns} ns: expected a stamp after {newest} ns, that of "
                    "the scan before",
                    code="clock",
                )
            )
            return
        self._newest_ns = scan.stamp_ns
        self._scans.append(scan.returns)
        if len(self._scans) > self._most:
            self._scans.popleft()
            self._leave_out(
                DataError(
                    f"more than {self._most} scans wait: expected the IMU and TF in time",
                    code="buffer-full",
                )
            )

    def _take_imu(self, imu: Imu) -> None:
        if imu.frame_id != self._frames.imu.frame:
            return  # refused there: of two IMUs the first counts
        newest = next((each[-1].stamp_ns for each in (self._due, self._felt) if each), imu.stamp_ns)
        if newest - imu.stamp_ns > self._jump_ns:
            self._due.clear()
            self._felt.clear()
        self._due.append(imu)
        while self._due[0].stamp_ns < imu.stamp_ns - self._wait_ns - _KEPT_NS:
            self._due.popleft()

    def _advance(self, *, final: bool = False) -> list[Odometry]:
        found = []
        while self._scans:
            scan = self._scans[0]
            assert self._newest_ns is not None  # that of a scan
            is_late = final or self._newest_ns - scan.stamp_ns > self._wait_ns
            if not is_late and not self._has_all_of(scan):
                break
            self._scans.popleft()
            try:
                found += self._track(scan)
            except FusionSlamError as error:
                self._leave_out(error)
                if self._odometry is not None and self._odometry.failure is not None:
                    self._begin_anew()
                    self.counts["began anew"] += 1
        return found

    def _leave_out(self, error: FusionSlamError) -> None:
        self.counts["scans left out"] += 1
        self._refuse(error)

    def _has_all_of(self, scan: Scan) -> bool:
        end_ns = end_of(scan.stamp_ns, scan.point_seconds)
        if self._takes_imu and not any(imu.stamp_ns > end_ns for imu in self._due):
            return False
        if self._odometry is not None:
            return True
        try:
            if self._takes_imu:
                self._frames.tree.lookup(scan.frame_id, self._due[0].frame_id, scan.stamp_ns)
            return self._frames.robot_from(scan.frame_id, scan.stamp_ns) is not None
        except TransformError:
            return False

    def _track(self, scan: Scan) -> list[Odometry]:
        """Poses that a scan leads to.

        Raises:
            FusionSlamError: the scan cannot be used.
        """
        odometry = self._odometry or self._begin(scan)
        if odometry is None:
            return []
        end_ns = end_of(scan.stamp_ns, scan.point_seconds)
        is_fed = not self._takes_imu
        while not is_fed:
            try:
                add_until(odometry, self._next_felt(), end_ns)
                is_fed = True
            except DataError as error:
                self._refuse(error)
        pose = odometry.process(scan.points, scan.stamp_ns, scan.point_seconds)
        self.counts["tracked"] += 1
        if self._first is not None:
            return self._move([(scan.stamp_ns, pose)])
        if self._held is None:
            self._held = scan.stamp_ns, pose
            return []
        # At the first scan nothing told yet how far the LiDAR moves within a sweep.
        self._first = pose @ np.linalg.inv(odometry.motion)
        return self._move([(self._held[0], self._first), (scan.stamp_ns, pose)])

    def _move(self, scans: list[tuple[int, Matrix]]) -> list[Odometry]:
        assert self._first is not None
        found = []
        for stamp_ns, pose in scans:
            moved = poses_of_body(pose[None], self._first, self._robot_from_points)[0]
            self._last = moved if (self._start == np.eye(4)).all() else self._start @ moved
            frame, robot = self._names
            found.append(
                Odometry(stamp_ns=stamp_ns, frame_id=frame, child_frame_id=robot, pose=self._last)
            )
        return found

    def _next_felt(self) -> Iterator[Imu]:
        while self._due:
            imu = self._due.popleft()
            self._felt.append(imu)
            while self._felt[0].stamp_ns < imu.stamp_ns - _KEPT_NS:
                self._felt.popleft()
            yield imu

    def _begin(self, scan: Scan) -> LidarOdometry | None:
        """Begin to track with a scan; None soon after that failed."""
        scan_from_imu = self._place_imu(scan) if self._takes_imu else None
        if self._tried_ns is not None and scan.stamp_ns - self._tried_ns < _AGAIN_NS:
            self.counts["scans left out"] += 1
            return None
        self._tried_ns = scan.stamp_ns
        place = self._frames.robot_from(scan.frame_id, scan.stamp_ns)
        self._robot_from_points = np.eye(4) if place is None else place
        robot = scan.frame_id if place is None else str(self._frames.robot)
        self._names = self._frames.odometry or ODOMETRY_FRAMES[0], robot
        self._due = deque([*self._felt, *self._due])
        self._felt.clear()
        self._odometry = LidarOdometry(self._config, scan_from_imu)
        return self._odometry

    def _place_imu(self, scan: Scan) -> Matrix:
        """Where the IMU is in the frame of a scan. Raises DataError if it tells nothing of it."""
        if scan.point_seconds is None:
            raise DataError(
                "odometry by LiDAR and IMU needs times of points, which the scans have not: "
                "expected a field such as time, t or timestamp",
                code="no-times",
            )
        end_ns = end_of(scan.stamp_ns, scan.point_seconds)
        felt = [*self._felt, *self._due]
        silence = ""
        if not felt:
            silence = "has said nothing yet"
        elif felt[0].stamp_ns > end_ns:
            silence = f"begins {(felt[0].stamp_ns - end_ns) / NANOSECONDS:.3g} s after it"
        elif felt[-1].stamp_ns < scan.stamp_ns:
            silence = f"ended {(scan.stamp_ns - felt[-1].stamp_ns) / NANOSECONDS:.3g} s before it"
        if silence:
            raise DataError(
                f"a scan is left out, as the IMU {silence}: expected messages from before the scan "
                "to its last point, by the same clock",
                code="no-imu",
            )
        return self._frames.tree.lookup(scan.frame_id, felt[0].frame_id, scan.stamp_ns)

    def _begin_anew(self) -> None:
        self._odometry = self._first = self._held = None
        self._start = self._last
