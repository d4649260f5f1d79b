# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrates the IMU of a recording by the path of its LiDAR."""

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
from fusionslam.datasets import Dataset
from fusionslam.errors import DataError
from fusionslam.pipelines.scan_paths import ScanFollower

logger = logging.getLogger(__name__)

FORMAT = "fusionslam.calibration.1"
REFINEMENTS = 2
"""More than one, as the path leans to what the IMU told with a wrong calibration."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a recording says of its sensors.

    Attributes:
        estimates: quantities, with intervals.
        lidar_from_imu: float64 (4, 4), found, or as stated where nothing can be said.
        frames: (parent, child) of that transform, of the LiDAR and the IMU.
    """

    estimates: list[Estimate]
    lidar_from_imu: Matrix
    frames: tuple[str, str]

    def transform_lines(self) -> list[str]:
        """The found pose of the IMU, also as arguments of ROS's static_transform_publisher."""
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
        whole = asdict(self) | {"lidar_from_imu": self.lidar_from_imu.tolist()}
        save_json(path, FORMAT, whole, indent=1)


def calibrate(dataset: Dataset, progress: Progress = lambda done, total: None) -> Calibration:
    """Estimate where the IMU is in the frame of the leading LiDAR, and how late its stamps are.

    Raises:
        DataError: the data have no IMU (code "no-imu"), or as ``ScanFollower``, ``read_imu`` and
            ``calibrate_imu`` say.
        FusionSlamError: KISS-ICP is missing.
    """
    dataset = dataset.of_leader()
    first = next(dataset.imu_messages(), None)
    if first is None:
        raise DataError(f"{dataset.name} has no IMU to calibrate", code="no-imu")
    follower = ScanFollower(dataset, progress, REFINEMENTS)
    imu = settle_imu(
        follower, read_imu(dataset.imu_messages(), follower.path), dataset.points_from_imu()
    )
    if imu.unit != 1:
        logger.warning("accelerations of '%s' are in g, expected m/s^2", first.frame_id)
    frames = dataset.points_frame, first.frame_id
    return Calibration(imu.estimates, imu.lidar_from_imu, frames)


def settle_imu(follower: ScanFollower, imu: ImuRows, stated: Matrix | None) -> ImuCalibration:
    """Calibrate an IMU and refine the LiDAR's path by it, in turns.

    Raises:
        DataError: as ``calibrate_imu``.
    """
    found = calibrate_imu(follower.path, imu, stated)
    for _ in range(REFINEMENTS):
        found = calibrate_imu(follower.refine(found.turning), imu, stated, found)
    return found
