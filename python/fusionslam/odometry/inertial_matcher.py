# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scans registered with what an inertial measurement unit (IMU) felt between them, by RKO-LIO."""

import logging
import subprocess
import sys
import weakref
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats, Integers, Matrix, Points
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.geometry.se3 import inverse, motion_size
from fusionslam.sensors.messages import NANOSECONDS, Imu

logger = logging.getLogger(__name__)

_G = 9.80665
_LARGEST_VOXEL_M = 0.5
_REACH = 3.0
"""Voxels, within which points correspond: a car's first scans lie that far apart."""
_NEAREST_M = 0.2
_NO_PULL = -1.0
"""Poses are not pulled towards what is felt for gravity, which hands that accelerate spoil."""
_IN_G = (0.8, 1.2)
_FELT = (8.5, 11.1)
"""m/s^2: mean acceleration of robots that start gently."""
_BEFORE_NS = NANOSECONDS
"""Until the end of the first scan, in which gravity is felt."""
_FASTEST_RAD_S = 40.0
"""Beyond what gyroscopes measure (2000 degrees/s)."""
_REST_S = 0.5
_REST_M = 0.01
_REST_DEG = 0.5
_REST_RAD_S = 0.05
_CLOSING_S = 10.0


class Felt(NamedTuple):
    """What an IMU says of itself, and of what is up.

    Attributes:
        up: float64 (3), opposite to gravity, in the axes of the first scan.
        gravity: m/s^2, as accelerations in the second until the end of the first scan say.
        bias: float64 (3), rad/s, of its turn rates, by which they are corrected; None unless the
            robot rests in the beginning, for half a second.
    """

    up: Floats
    gravity: float
    bias: Floats | None

    def __str__(self) -> str:
        """Gravity, tilt and bias in a few words."""
        tilt = np.degrees(np.arccos(np.clip(self.up[2], -1, 1)))
        rest = "not at rest in the beginning"
        if self.bias is not None:
            rest = f"bias {np.degrees(np.linalg.norm(self.bias)):.2g} degrees/s"
        return f"gravity {self.gravity:.2f} m/s^2, scanner tilted by {tilt:.1f} degrees, {rest}"


class InertialMatcher:
    """RKO-LIO (Malladi et al., RA-L 2026) on one thread.

    It runs in a process of its own, as it writes to standard output.

    Args:
        scan_from_imu: float64 (4, 4), where the IMU is in the frame of the scans.
        max_range: farther points are not used, metres.

    Attributes:
        felt: None before the first scan.

    Raises:
        FusionSlamError: RKO-LIO is not installed (code "missing-extra").
    """

    def __init__(self, scan_from_imu: Matrix, max_range: float) -> None:
        self.felt: Felt | None = None
        self._scan_from_imu, self._max_range = scan_from_imu, max_range
        # At the IMU: RKO-LIO errs where it has to tell what is felt from afar.
        self._base_from_imu: Matrix = np.eye(4)
        self._waiting: list[Imu] = []
        self._unit = 1.0
        self._begin_ns = self._last_ns = 0
        self._at_rest: list[Floats] | None = []
        self._line, self._process = _start()
        weakref.finalize(self, _end, self._line, self._process)

    def add(self, imu: Imu) -> None:
        """Take a message of the IMU. Those that come after their scan are of no use.

        Raises:
            DataError: a value is not finite (code "not-finite"), or no gyroscope measures such
                rates ("imu-unit").
        """
        if not np.isfinite(np.r_[imu.angular, imu.linear]).all():
            raise DataError(
                f"the IMU's rates {imu.angular} and accelerations {imu.linear} at {imu.stamp_ns} "
                "ns are not finite",
                code="not-finite",
                fields=(str(imu.stamp_ns),),
            )
        rate = float(np.abs(imu.angular).max())
        if rate > _FASTEST_RAD_S:
            raise DataError(
                f"the IMU turns by {rate:.3g} rad/s at {imu.stamp_ns} ns, expected at most "
                f"{_FASTEST_RAD_S:g}: are its rates in degrees?",
                code="imu-unit",
                fields=("angular_velocity", f"{rate:.3g}"),
            )
        self._waiting.append(imu)

    def register(self, points: Points, times_ns: Integers, voxel: float) -> Matrix:
        """Register the next scan.

        Args:
            points: float32 (N, 3), metres, each in the scanner's frame when it was measured.
            times_ns: int64 (N), when that was.
            voxel: of the local map, metres, as the first scan says.

        Returns:
            float64 (4, 4), first_from_scan at the time of its last point, first being the first
            scan at the time of its own.

        Raises:
            DataError: the IMU says nothing between the two scans ("no-imu"); it does not feel
                gravity in the beginning ("imu-unit"); or RKO-LIO refuses the scan ("lost").
            FusionSlamError: its process ended.
        """
        last_ns = int(times_ns.max())
        due = sorted(self._waiting, key=lambda imu: imu.stamp_ns)
        # An IMU may have been carried about long before the first scan.
        begin_ns = self._last_ns or last_ns - _BEFORE_NS
        felt = [imu for imu in due if begin_ns < imu.stamp_ns <= last_ns]
        self._waiting = [imu for imu in due if imu.stamp_ns > last_ns]
        if not felt:
            raise DataError(
                f"no message of the IMU from {begin_ns} to {last_ns} ns, expected some between "
                "two scans",
                code="no-imu",
                fields=(str(begin_ns), str(last_ns)),
            )
        if self.felt is None:
            self.felt, self._begin_ns = self._feel_gravity(felt), last_ns
            self._send(self._settings(min(voxel, _LARGEST_VOXEL_M)))
        self._last_ns = last_ns
        bias = np.zeros(3) if self.felt.bias is None else self.felt.bias
        rows = [(imu.stamp_ns, self._unit * imu.linear, imu.angular - bias) for imu in felt]
        base_from_scan = self._base_from_imu @ inverse(self._scan_from_imu)
        self._send((rows, self._base_from_imu, points, times_ns, base_from_scan))
        answer = self._receive()
        if isinstance(answer, str):
            raise DataError(f"RKO-LIO refuses the scan: {answer}", code="lost", fields=(answer,))
        pose: Matrix = inverse(base_from_scan) @ answer @ base_from_scan
        self._look_for_bias(felt, pose)
        return pose

    def _feel_gravity(self, felt: list[Imu]) -> Felt:
        """Take what is felt for gravity, whose opposite is up from now on."""
        weight = np.median([imu.linear for imu in felt], axis=0)  # whatever else shakes it
        size = float(np.linalg.norm(weight))
        if _IN_G[0] < size < _IN_G[1]:
            logger.warning("the IMU feels gravity as %.3f: it is taken to measure in g", size)
            self._unit = _G
        elif not _FELT[0] < size < _FELT[1]:
            raise DataError(
                f"the IMU feels {size:.3g} m/s^2 in the beginning, expected about {_G:.2f} of "
                "gravity: are its accelerations in m/s^2, and does it rest?",
                code="imu-unit",
                fields=("linear_acceleration", f"{size:.3g}"),
            )
        level, _ = Rotation.align_vectors(np.array([[0.0, 0.0, 1.0]]), weight[None] / size)
        self._base_from_imu[:3, :3] = level.as_matrix()
        return Felt(self._scan_from_imu[:3, :3] @ weight / size, self._unit * size, None)

    def _look_for_bias(self, felt: list[Imu], pose: Matrix) -> None:
        """Take the mean turn rate of a robot that rests in the beginning for the IMU's bias."""
        if self._at_rest is None or self.felt is None:
            return
        self._at_rest += [imu.angular for imu in felt]
        bias = np.mean(self._at_rest, axis=0)
        moved_m, turned_deg = motion_size(pose)
        is_resting = moved_m < _REST_M and turned_deg < _REST_DEG
        if not is_resting or np.linalg.norm(bias) > _REST_RAD_S:
            self._at_rest = None
        elif self._last_ns - self._begin_ns >= _REST_S * NANOSECONDS:
            self.felt, self._at_rest = self.felt._replace(bias=bias), None

    def _settings(self, voxel: float) -> dict[str, Any]:
        return {
            "voxel_size": voxel,
            "max_correspondence_distance": _REACH * voxel,
            "min_range": _NEAREST_M,
            "max_range": self._max_range,
            "max_num_threads": 1,
            "min_beta": _NO_PULL,
        }

    def _send(self, value: object) -> None:
        with suppress(BrokenPipeError):  # _receive says so
            self._line.send(value)

    def _receive(self) -> Any:
        try:
            return self._line.recv()
        except (EOFError, OSError) as error:
            status = self._process.wait(_CLOSING_S)
            raise FusionSlamError(
                f"RKO-LIO ended with status {status}", code="process", fields=(str(status),)
            ) from error


def _start() -> tuple[Connection, "subprocess.Popen[bytes]"]:
    ours, its = Pipe()
    with its:
        command = [sys.executable, "-m", "fusionslam.odometry.rko_worker", str(its.fileno())]
        # In a session of its own, as Ctrl-C is for its owner, which still has scans to register.
        process = subprocess.Popen(command, pass_fds=[its.fileno()], start_new_session=True)
    try:
        problem = ours.recv()
    except EOFError:
        problem = f"its process ended with status {process.wait(_CLOSING_S)}"
    if problem is not None:
        process.wait(_CLOSING_S)
        raise FusionSlamError(
            f"odometry by LiDAR and IMU needs RKO-LIO, which is not installed ({problem}): "
            "pip install 'fusionslam[inertial]'",
            code="missing-extra",
            fields=("inertial",),
        )
    return ours, process


def _end(line: Connection, process: "subprocess.Popen[bytes]") -> None:
    line.close()
    try:
        process.wait(_CLOSING_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
