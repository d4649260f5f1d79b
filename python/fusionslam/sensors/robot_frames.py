# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot's sensors are and where the robot was, out of TF and odometry."""

from collections.abc import Iterable

import numpy as np

from fusionslam.errors import DataError
from fusionslam.sensors.messages import FrameTransform, FrameTransforms, Odometry
from fusionslam.sensors.transforms import TransformTree
from fusionslam.storage.arrays import Matrix

# What robots call themselves and the frame that they start in, where nothing says it.
ROBOT_FRAMES = ("base_footprint", "base_link")
ODOMETRY_FRAMES = ("odom",)


class RobotFrames:
    """Where a robot's sensors are, and where the robot was, at any time.

    Odometry messages are kept apart from TF, as the two may disagree: the robot's motion comes
    from odometry where there is any, else from TF.

    Args:
        history_s: how long what moves is kept, in seconds; None for all.
        extrapolation_s: as ``TransformTree``.
        robot: the robot's frame, and
        odometry: the frame that odometry is measured in; empty finds them out.
        truth: odometry in this frame, unless it is ``odometry``, is no odometry but true poses;
            empty where there are none.

    Attributes:
        tree: all of TF.
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
        self.tree = TransformTree(history_s=history_s, extrapolation_s=extrapolation_s)
        self._moves = TransformTree(history_s=history_s, extrapolation_s=extrapolation_s)
        self._true_moves = TransformTree(history_s=history_s, extrapolation_s=extrapolation_s)
        self._robot, self._odometry, self._truth = robot, odometry, truth
        self._measured: tuple[str, str] | None = None
        self._true: tuple[str, str] | None = None

    def add(self, message: FrameTransforms | Odometry) -> None:
        """Take transforms or odometry.

        Raises:
            DataError: as ``TransformTree.add``, of the first wrong transform; the others that
                came with it are taken.
        """
        if isinstance(message, FrameTransforms):
            self._add_all(message.transforms)
            return
        ends = message.frame_id, message.child_frame_id
        if self._is_true(message):
            self._true_moves.add(_as_transform(message))
            self._true = ends
        else:
            self._moves.add(_as_transform(message))
            self._measured = ends

    def _add_all(self, transforms: Iterable[FrameTransform]) -> None:
        errors = []
        for transform in transforms:
            try:
                self.tree.add(transform)
            except DataError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def forget_moving(self) -> None:
        """Drop all that moved: the clock went back."""
        self.tree.forget_moving()
        self._moves.forget_moving()
        self._true_moves.forget_moving()

    def forget_after(self, stamp_ns: int) -> None:
        """Drop all that moved later: the clock went back to here."""
        for tree in (self.tree, self._moves, self._true_moves):
            tree.forget_after(stamp_ns)

    def goes_back(self, message: FrameTransforms | Odometry, jump_ns: int) -> bool:
        """Whether something in it lies further before the newest of its frame than this."""
        if isinstance(message, Odometry):
            moves = self._true_moves if self._is_true(message) else self._moves
            newest = moves.newest(message.child_frame_id)
            return newest is not None and newest - message.stamp_ns > jump_ns
        moving = [each for each in message.transforms if not each.static]
        newest_ones = [(self.tree.newest(each.child), each.stamp_ns) for each in moving]
        return any(new is not None and new - stamp > jump_ns for new, stamp in newest_ones)

    @property
    def robot(self) -> str | None:
        """The name of the robot's frame, if it is known."""
        # Some drivers leave the name in their odometry empty.
        measured = self._measured[1] if self._measured else ""
        return self._robot or measured or self._first(ROBOT_FRAMES)

    @property
    def odometry(self) -> str | None:
        """The name of the frame that the robot's motion is measured in, if it is known."""
        found = self._measured[0] if self._measured else self._first(ODOMETRY_FRAMES)
        return self._odometry or found

    def odometry_from_robot(self, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4) at a time, or None where nothing measures motion.

        Raises:
            TransformError: odometry is not known for that time.
        """
        if self._measured:
            return self._moves.lookup(*self._measured, stamp_ns)
        if self.odometry and self.robot:
            return self.tree.lookup(self.odometry, self.robot, stamp_ns)
        return None

    def world_from_robot(self, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), the true pose at a time, or None where nothing tells the truth.

        Raises:
            TransformError: it is not known for that time.
        """
        return self._true_moves.lookup(*self._true, stamp_ns) if self._true else None

    def robot_from(self, sensor: str, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), robot_from_sensor, or None where the robot's frame is not in TF.

        Raises:
            TransformError: the two are not linked, or not at that time.
        """
        if self.robot is None or self.robot.removeprefix("/") not in self.tree.frames:
            return None
        return self.tree.lookup(self.robot, sensor, stamp_ns)

    def camera_from_points(
        self, camera: str, camera_ns: int, scanner: str, scan_ns: int, *, still: bool = False
    ) -> Matrix:
        """float64 (4, 4): points of a scan as a camera met them when it took its image.

        Between the two times the robot moved as odometry says; without odometry, or with
        ``still``, it is taken to stand.

        Raises:
            TransformError: one of the frames is not linked, or not at its time.
        """
        from_robot = None if still else self.robot_from(scanner, scan_ns)
        if from_robot is None or camera_ns == scan_ns:
            return self.tree.lookup(camera, scanner, scan_ns)
        poses = self.odometry_from_robot(camera_ns), self.odometry_from_robot(scan_ns)
        if poses[0] is None or poses[1] is None:
            return self.tree.lookup(camera, scanner, scan_ns)
        robot_then = np.linalg.inv(poses[0]) @ poses[1] @ from_robot
        moved = self.tree.lookup(camera, self.robot or "", camera_ns) @ robot_then
        return np.asarray(moved, dtype=np.float64)

    def _is_true(self, message: Odometry) -> bool:
        frame, truth, odometry = (
            name.removeprefix("/") for name in (message.frame_id, self._truth, self._odometry)
        )
        return bool(truth) and frame == truth != odometry

    def _first(self, names: Iterable[str]) -> str | None:
        frames = self.tree.frames
        return next((name for name in names if name in frames), None)


def _as_transform(message: Odometry) -> FrameTransform:
    return FrameTransform(
        stamp_ns=message.stamp_ns,
        parent=message.frame_id,
        child=message.child_frame_id,
        parent_from_child=message.pose,
    )
