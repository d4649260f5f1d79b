# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry of a recording from its scans, and the files that keep it."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.base.files import PathLike
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, reported
from fusionslam.datasets import Dataset
from fusionslam.datasets.pose_files import write_poses_kitti, write_poses_tum
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.odometry import Deviation, Felt, LidarOdometry, LidarOdometryConfig
from fusionslam.odometry.tracking import add_until, end_of, poses_of_body
from fusionslam.pipelines.recording import name_frame
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import NANOSECONDS, Imu, Odometry

logger = logging.getLogger(__name__)


class Drift(NamedTuple):
    """How far odometry is from the truth, both beginning at the same pose; metres."""

    end: float
    largest: float


@dataclass(frozen=True, eq=False)
class LidarTrack:
    """Odometry of N frames.

    Attributes:
        name: of the recording.
        numbers: int64 (N), the frames' numbers.
        stamps_ns: int64 (N).
        poses: float64 (N, 4, 4), first_from_body, the body being that of the recording's poses.
        overlap: float64 (N - 1), of each scan with the one before.
        deviation: estimate of the error.
        has_times: whether the data say when each point was measured.
        felt: what the IMU says of itself and of gravity; None if none was used.
    """

    name: str
    numbers: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    poses: Matrix
    overlap: Floats
    deviation: Deviation
    has_times: bool
    felt: Felt | None = None

    @property
    def length_m(self) -> float:
        """Metres moved."""
        return float(np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1).sum())

    def drift(self, truth: Matrix) -> Drift:
        """Compare with true poses of the frames, float64 (N, 4, 4), world_from_body."""
        off = self.poses[:, :3, 3] - (np.linalg.inv(truth[0]) @ truth)[:, :3, 3]
        distances = np.linalg.norm(off, axis=1)
        return Drift(float(distances[-1]), float(distances.max()))

    def save(self, path: PathLike, format: str = "tum") -> None:
        """Write the poses in format "tum", with times, or "kitti", one line a frame.

        Raises:
            DataError: the file cannot be written; or in format kitti, a frame has no pose (code
                "no-pose"), as line n must be frame n.
        """
        if format == "tum":
            write_poses_tum(path, self.stamps_ns, self.poses)
            return
        lacking = np.setdiff1d(np.arange(self.numbers[-1] + 1), self.numbers)
        if lacking.size:
            raise DataError(
                f"{self.name} has no frame {lacking[0]}, but line n of a KITTI file is frame n: "
                "format tum keeps the times instead",
                code="no-pose",
                fields=(str(lacking[0]),),
            )
        write_poses_kitti(path, self.poses)

    def __str__(self) -> str:
        """Length, overlap, deviation and what the IMU says, in one line."""
        by = "by scans alone" if self.felt is None else f"by scans and IMU ({self.felt})"
        times = "with" if self.has_times else "without"
        return (
            f"{len(self.poses)} poses, {self.length_m:.1f} m, {by}, points {times} times, "
            f"overlap at least {self.overlap.min():.2f}, error about "
            f"{self.deviation.position:.2g} m and {np.rad2deg(self.deviation.angle):.2g} degrees "
            "after a metre, growing with the root of the way"
        )


def track_lidar(
    dataset: Dataset,
    config: LidarOdometryConfig | None = None,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> LidarTrack:
    """Estimate the poses of a recording from its scans, and its IMU where it has one.

    Args:
        dataset: with scans at best 10 Hz, of which those of the leading scanner count. Where an IMU
            is used, they are read as measured.
        config: None for the defaults.
        jobs: number of scans read ahead; does not change the result.
        progress: called with (scans done, total scans).

    Raises:
        DataError: fewer than two scans, a scan cannot be read or used, or its pose is refused as
            ``LidarOdometry.process`` says; the message names the frame. An IMU is needed, but there
            is none (code "no-imu").
        FusionSlamError: KISS-ICP or RKO-LIO is missing.
    """
    if not dataset.has_points or len(dataset) < 2:
        raise DataError(
            f"{dataset.name}: odometry by LiDAR needs scans of two frames or more",
            code="no-scans",
        )
    dataset = dataset.of_leader()
    odometry = _odometry_of(dataset, config or LidarOdometryConfig())
    messages = dataset.imu_messages() if odometry.takes_imu else iter(())
    if odometry.takes_imu:
        dataset = dataset.as_measured()
    poses: list[Matrix] = []
    overlap, has_times = [], True
    with ordered_results(lambda index: _read(dataset, index), range(len(dataset)), jobs) as frames:
        for index, frame in enumerate(reported(frames, progress, len(dataset))):
            assert frame.points is not None
            has_times &= frame.point_seconds is not None or frame.deskew is not None
            with name_frame(dataset, index):
                add_until(odometry, messages, end_of(frame.stamp_ns, frame.point_seconds))
                pose = odometry.process(frame.points, frame.stamp_ns, frame.point_seconds)
                if index == len(dataset) - 1:
                    odometry.check()
            if index == 1:
                # At the first scan nothing told yet how far the LiDAR moves within a sweep.
                poses[0] = pose @ np.linalg.inv(odometry.motion)
            poses.append(pose)
            overlap.append(odometry.overlap)
    scans, body_from_points = np.stack(poses), dataset.body_from_points
    if body_from_points is None:
        logger.warning("%s does not say where its scans are: poses are of the scan", dataset.name)
        body_from_points = np.eye(4)
    return LidarTrack(
        name=dataset.name,
        numbers=dataset.numbers,
        stamps_ns=dataset.stamps_ns,
        poses=poses_of_body(scans, scans[0], body_from_points),
        overlap=np.array(overlap[1:]),
        deviation=odometry.deviation,
        has_times=has_times,
        felt=odometry.felt,
    )


def _odometry_of(dataset: Dataset, config: LidarOdometryConfig) -> LidarOdometry:
    """Odometry with the IMU of a recording if it is wanted and can be used, else without."""
    first = None if config.imu == "never" else next(dataset.imu_messages(), None)
    if first is None and config.imu != "always":
        return LidarOdometry(config)
    lacking, scan_from_imu = f"{dataset.name} has no IMU", None
    if first is not None:
        lacking, scan_from_imu = _place_imu(dataset, first)
    if scan_from_imu is None and config.imu == "always":
        raise DataError(f"{lacking}, which odometry by LiDAR and IMU needs", code="no-imu")
    if scan_from_imu is not None:
        try:
            return LidarOdometry(config, scan_from_imu)
        except FusionSlamError as error:
            if config.imu == "always" or error.code != "missing-extra":
                raise
            lacking = str(error)
    logger.warning("the IMU is not used: %s", lacking)
    return LidarOdometry(config)


def _place_imu(dataset: Dataset, first: Imu) -> tuple[str, Matrix | None]:
    """Where an IMU is in the frame of the scans, or None and what is lacking to use it."""
    name, frame = dataset.name, dataset.as_measured()[0]
    if frame.point_seconds is None:
        return f"points of {name} have no times", None
    late_s = (first.stamp_ns - frame.stamp_ns) / NANOSECONDS - frame.point_seconds.max()
    if late_s > 0:
        return f"the IMU of {name} begins {late_s:.3g} s after the first scan", None
    return f"TF of {name} does not place '{first.frame_id}'", dataset.points_from_imu()


def lidar_motions(dataset: Dataset, track: LidarTrack) -> list[Odometry]:
    """The poses as odometry messages of the robot, without velocities."""
    robots = track.poses @ dataset.body_from_robot
    return [
        Odometry(stamp_ns=stamp_ns, frame_id="odom", child_frame_id="robot", pose=robot)
        for stamp_ns, robot in zip(track.stamps_ns.tolist(), robots, strict=True)
    ]


def _read(dataset: Dataset, index: int) -> Frame:
    """A frame whose points are read."""
    frame = dataset[index]
    with name_frame(dataset, index):
        _ = frame.points, frame.point_seconds
    return frame


def pose_format_of(path: Path) -> str:
    """The format that a file's name asks for: "kitti" for X.kitti and X_kitti.txt, else "tum"."""
    return "kitti" if path.suffix == ".kitti" or path.stem.endswith("_kitti") else "tum"


def check_new_file(path: Path) -> None:
    """Raise DataError (code "exists") for a file that is there: it may be odometry of wheels."""
    if path.exists():
        raise DataError(
            f"{path} exists: remove it, or choose another file (--output)",
            code="exists",
            fields=(str(path),),
        )
