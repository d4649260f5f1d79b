# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a robot and of its sensors from TF and odometry."""

from collections.abc import Iterable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import inverse
from fusionslam.sensors.imu_buffer import ImuBuffer
from fusionslam.sensors.messages import NANOSECONDS, FrameTransforms, Odometry
from fusionslam.sensors.transforms import TransformError, TransformTree

# Default names of the robot's frame and of the odometry frame.
ROBOT_FRAMES = ("base_footprint", "base_link")
ODOMETRY_FRAMES = ("odom",)


class RobotFrames:
    """Poses of a robot and of its sensors at any time.

    Odometry messages are kept apart from TF, as the two may disagree: the robot's motion comes
    from odometry messages if there are any, else from TF.

    Args:
        history_s: how long moving transforms are kept, in seconds; None for all.
        extrapolation_s: as ``TransformTree``.
        robot: the robot's frame; empty detects it.
        odometry: the frame that odometry is measured in; empty detects it.
        truth: odometry messages in this frame, unless it is ``odometry``, are ground truth; empty
            if there are none.

    Attributes:
        tree: all of TF.
        imu: how the robot's IMU turned.
    """

    def __init__(
        self,
        *,
        history_s: float | None = None,
        extrapolation_s: float = 0.0,
        robot: str = "",
        odometry: str = "",
        truth: str = "",
    ) -> None:
        self.tree, self._moves, self._true_moves = self._trees = [
            TransformTree(history_s=history_s, extrapolation_s=extrapolation_s) for _ in range(3)
        ]
        self.imu = ImuBuffer(history_s)
        self._robot, self._odometry, self._truth = robot, odometry, truth
        self._measured: tuple[str, str] | None = None
        self._true: tuple[str, str] | None = None

    def add(self, message: FrameTransforms | Odometry) -> None:
        """Add transforms or odometry.

        Raises:
            DataError: as ``TransformTree.add``, for the first invalid transform; the valid ones
                of the same message are added.
        """
        if isinstance(message, Odometry):
            ends = message.frame_id, message.child_frame_id
            if self._is_true(message):
                self._true_moves.add(message.transform)
                self._true = ends
            else:
                self._moves.add(message.transform)
                self._measured = ends
            return
        errors = []
        for transform in message.transforms:
            try:
                self.tree.add(transform)
            except DataError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def forget_moving(self) -> None:
        """Drop all moving transforms after the clock jumped back."""
        for tree in self._trees:
            tree.forget_moving()
        self.imu.forget_after(0)

    def forget_after(self, stamp_ns: int) -> None:
        """Drop moving transforms later than a stamp, to which the clock jumped back."""
        for tree in self._trees:
            tree.forget_after(stamp_ns)
        self.imu.forget_after(stamp_ns)

    def goes_back(self, message: FrameTransforms | Odometry, jump_ns: int) -> bool:
        """Whether a stamp in it is earlier than its frame's newest by more than ``jump_ns``."""
        if isinstance(message, Odometry):
            moves = self._true_moves if self._is_true(message) else self._moves
            newest = moves.newest(message.child_frame_id)
            return newest is not None and newest - message.stamp_ns > jump_ns
        moving = [each for each in message.transforms if not each.static]
        newest_ones = [(self.tree.newest(each.child), each.stamp_ns) for each in moving]
        return any(new is not None and new - stamp > jump_ns for new, stamp in newest_ones)

    @property
    def robot(self) -> str | None:
        """Name of the robot's frame, if it is known."""
        # Some drivers leave the name empty in their odometry.
        measured = self._measured[1] if self._measured else ""
        return self._robot or measured or self._first(ROBOT_FRAMES)

    @property
    def odometry(self) -> str | None:
        """Name of the frame that the robot's motion is measured in, if it is known."""
        found = self._measured[0] if self._measured else self._first(ODOMETRY_FRAMES)
        return self._odometry or found

    def odometry_from_robot(self, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4) at a time, or None if there is no odometry.

        Raises:
            TransformError: odometry is not known for that time.
        """
        if self._measured:
            return self._moves.lookup(*self._measured, stamp_ns)
        if self.odometry and self.robot:
            return self.tree.lookup(self.odometry, self.robot, stamp_ns)
        return None

    def world_from_robot(self, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), the true pose at a time, or None if there is no ground truth.

        Raises:
            TransformError: it is not known for that time.
        """
        return self._true_moves.lookup(*self._true, stamp_ns) if self._true else None

    def robot_from(self, sensor: str, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), robot_from_sensor, or None if the robot's frame is not in TF.

        Raises:
            TransformError: the two are not linked, or not at that time.
        """
        if self.robot is None or self.robot.removeprefix("/") not in self.tree.frames:
            return None
        return self.tree.lookup(self.robot, sensor, stamp_ns)

    def odometry_from(self, sensor: str, stamps_ns: NDArray[np.int64]) -> Matrix | None:
        """float64 (K, 4, 4), odom_from_sensor at several times.

        None if there is no odometry, or the sensor's place on the robot is not known.

        Raises:
            TransformError: the two are not linked, or not at one of the times.
        """
        body, odometry = self._body, self.odometry
        if body is None or odometry is None:
            return None
        names = {sensor.removeprefix("/"), body.removeprefix("/")}
        if len(names) == 2 and not names <= {*self.tree.frames}:
            return None
        tree, ends = self.tree, (odometry, body)
        if self._measured:
            tree, ends = self._moves, self._measured
        mounts = self.tree.lookup_all(body, sensor, stamps_ns)
        return np.asarray(tree.lookup_all(*ends, stamps_ns) @ mounts, dtype=np.float64)

    def turned_by_imu(self, sensor: str, stamps_ns: NDArray[np.int64]) -> Matrix | None:
        """float64 (K, 4, 4): where a sensor is at several times, in its frame at the first of them.

        The robot only turns, about its own frame, or about the IMU where TF does not link the two.
        None if there is no IMU, or TF does not link it to the sensor.

        Raises:
            TransformError: as ``ImuBuffer.turned``.
        """
        frame = self.imu.frame
        if frame is None or not self._is_linked(frame, sensor):
            return None
        body = self._body
        if body is None or not self._is_linked(body, frame):
            body = frame
        turns = self.tree.lookup_all(body, frame, stamps_ns)[:, :3, :3]
        mounts = self.tree.lookup_all(body, sensor, stamps_ns)
        turned = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
        turned[:, :3, :3] = turns[:1] @ self.imu.turned(stamps_ns) @ np.swapaxes(turns, 1, 2)
        return np.asarray(inverse(mounts[:1]) @ turned @ mounts, dtype=np.float64)

    def _is_linked(self, one: str, other: str) -> bool:
        with suppress(TransformError):
            return one == other or bool(self.tree.chain(one, other))
        return False

    def odometry_step(self, stamps_ns: NDArray[np.int64]) -> float:
        """Longest time between poses of odometry around some times, seconds; 0 without any."""
        tree, ends = self.tree, (self.odometry, self._body)
        if self._measured:
            tree, ends = self._moves, self._measured
        if ends[0] is None or ends[1] is None:
            return 0.0
        return tree.widest(ends[0], ends[1], stamps_ns) / NANOSECONDS

    def camera_from_points(
        self, camera: str, camera_ns: int, scanner: str, scan_ns: int, *, still: bool = False
    ) -> Matrix:
        """float64 (4, 4): maps points of a scan to the camera at the time of its image.

        Between the two times the robot moves as odometry says; without odometry, or with
        ``still``, it is assumed to stand still.

        Raises:
            TransformError: one of the frames is not linked, or not at its time.
        """
        body = self._body
        is_known = body is not None and body.removeprefix("/") in self.tree.frames
        from_robot = None
        if is_known and not still:
            from_robot = self.tree.lookup(body or "", scanner, scan_ns)
        if from_robot is None or camera_ns == scan_ns:
            return self.tree.lookup(camera, scanner, scan_ns)
        poses = self.odometry_from_robot(camera_ns), self.odometry_from_robot(scan_ns)
        if poses[0] is None or poses[1] is None:
            return self.tree.lookup(camera, scanner, scan_ns)
        robot_then = np.linalg.inv(poses[0]) @ poses[1] @ from_robot
        moved = self.tree.lookup(camera, body or "", camera_ns) @ robot_then
        return np.asarray(moved, dtype=np.float64)

    @property
    def _body(self) -> str | None:
        """The frame whose motion odometry tells: that of its messages where TF places it."""
        measured = self._measured[1] if self._measured else ""
        return measured if measured.removeprefix("/") in self.tree.frames else self.robot

    def _is_true(self, message: Odometry) -> bool:
        frame, truth, odometry = (
            name.removeprefix("/") for name in (message.frame_id, self._truth, self._odometry)
        )
        return bool(truth) and frame == truth != odometry

    def _first(self, names: Iterable[str]) -> str | None:
        frames = self.tree.frames
        return next((name for name in names if name in frames), None)
