# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrates the IMU and odometry of a recording by the path of its LiDAR."""

import logging
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.base.archive import save_json
from fusionslam.base.arrays import Matrix
from fusionslam.base.progress import Progress
from fusionslam.calibration.estimate import Estimate
from fusionslam.calibration.lidar_imu import ImuCalibration, ImuRows, calibrate_imu, read_imu
from fusionslam.calibration.wheels import calibrate_wheels
from fusionslam.datasets import Dataset
from fusionslam.errors import DataError
from fusionslam.pipelines.scan_paths import ScanFollower

logger = logging.getLogger(__name__)

FORMAT = "fusionslam.calibration.1"
REFINEMENTS = 2
"""With an IMU: the path leans to what the IMU told with a wrong calibration."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a recording says of its sensors.

    Attributes:
        estimates: quantities, with intervals.
        lidar_from_imu: float64 (4, 4), found, or as stated where nothing can be said; None without
            an IMU.
        frames: (parent, child) of that transform, of the LiDAR and the IMU.
        left_out: what was not calibrated, and why.
    """

    estimates: list[Estimate]
    lidar_from_imu: Matrix | None
    frames: tuple[str, str]
    left_out: list[str]

    def transform_lines(self) -> list[str]:
        """The found pose of the IMU, also as arguments of ROS's static_transform_publisher."""
        if self.lidar_from_imu is None:
            return []
        xyz = self.lidar_from_imu[:3, 3]
        turn = Rotation.from_matrix(self.lidar_from_imu[:3, :3])
        roll, pitch, yaw = turn.as_euler("xyz")
        parent, child = self.frames
        metres = " ".join(f"{each:.4f}" for each in xyz)
        degrees = " ".join(f"{each:.3f}" for each in np.degrees([roll, pitch, yaw]))
        names = ("x", "y", "z", "roll", "pitch", "yaw")
        options = " ".join(
            f"--{name} {each:.5f}"
            for name, each in zip(names, (*xyz, roll, pitch, yaw), strict=True)
        )
        return [
            f"{child} in {parent}: xyz {metres} m, roll pitch yaw {degrees} degrees",
            f"static_transform_publisher {options} --frame-id {parent} --child-frame-id {child}",
        ]

    def save(self, path: Path) -> None:
        """Write the result as JSON."""
        whole = asdict(self)
        if self.lidar_from_imu is not None:
            whole["lidar_from_imu"] = self.lidar_from_imu.tolist()
        save_json(path, FORMAT, whole, indent=1)


def calibrate(dataset: Dataset, progress: Progress = lambda done, total: None) -> Calibration:
    """Estimate where the IMU is, how late IMU and odometry are, and odometry's factors.

    Raises:
        DataError: as ``ScanFollower`` and ``read_imu`` say; or there is neither IMU nor odometry.
        FusionSlamError: KISS-ICP or small_gicp is missing.
    """
    first = next(dataset.imu_messages(), None)
    estimates, left_out = [], []
    if first is None:
        left_out.append("IMU: the recording has none")
    try:
        wheels = dataset.motion("odometry")
    except DataError as error:
        wheels = []
        left_out.append(f"odometry: {error}")
    if first is None and not wheels:
        raise DataError(
            f"{dataset.name} has neither an IMU nor odometry to calibrate", code="no-messages"
        )
    follower = ScanFollower(dataset, progress, 1 if first is None else REFINEMENTS)
    pose, child, path = None, "", follower.path
    if first is None:
        path = follower.refine(None)
    else:
        rows, stated = read_imu(dataset.imu_messages(), path), dataset.points_from_imu()
        imu = settle_imu(follower, rows, stated)
        path = follower.path
        pose, child = imu.lidar_from_imu, first.frame_id
        estimates += imu.estimates
        if imu.unit != 1:
            logger.warning("accelerations of '%s' are in g, expected m/s^2", child)
    robot_from_points = dataset[0].robot_from_points
    if wheels and robot_from_points is None:
        left_out.append("odometry: the recording does not say where the LiDAR is on the robot")
    elif wheels:
        try:
            estimates += calibrate_wheels(path, wheels, np.asarray(robot_from_points))
        except DataError as error:
            if error.code != "few-scans":
                raise
            left_out.append(str(error))
    return Calibration(estimates, pose, (dataset.points_frame, child), left_out)


def settle_imu(follower: ScanFollower, imu: ImuRows, stated: Matrix | None) -> ImuCalibration:
    """Calibrate an IMU and refine the LiDAR's path by it, in turns.

    Raises:
        DataError: as ``calibrate_imu``.
    """
    found = calibrate_imu(follower.path, imu, stated)
    for _ in range(REFINEMENTS):
        found = calibrate_imu(follower.refine(found.turning), imu, stated, found)
    return found
