# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How far does odometry by LiDAR drift on simulated drives at 10 Hz, with an IMU or without?

    python -m benchmarks.accuracy.lidar_odometry

Prints a Markdown table. The town's drive has 697 m, the house's is planned, 100 m. The embedded
drive of the demo, at 2 m a scan, must be refused. Some 15 minutes.
"""

import statistics
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from benchmarks.accuracy.markdown import table
from fusionslam.config import merged
from fusionslam.datasets import Dataset, open_dataset
from fusionslam.errors import DataError
from fusionslam.odometry import LidarOdometryConfig
from fusionslam.pipelines.lidar_odometry import track_lidar
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.recordings import recording_config, write_recording
from fusionslam.sim.robot import ImuMount
from fusionslam.sim.town.kitti_recorder import embedded_drive

HILLS = {"height_m": 2.5, "length_m": 150.0}
BODY = {"roll_deg": 0.5, "pitch_deg": 0.5, "heave_m": 0.02}
HAND = {"roll_deg": 2.0, "pitch_deg": 2.0, "yaw_deg": 3.0, "heave_m": 0.03, "aside_m": 0.03}
RAISED = {"velodyne": {"position_m": [0.0, 0.0, 1.0]}}
DRIVES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "town": ("town", "car_lidar", {}),
    "house": ("house", "turtlebot3_vlp16", {}),
    "town on hills": ("town", "car_lidar", {"hills": HILLS, "robot": {"sway": BODY}}),
    "house, hand-held": (
        "house",
        "turtlebot3_vlp16",
        {"robot": {"sway": {**HAND, "rate_hz": 1.0}, "lidars": RAISED}},
    ),
}
"""Worlds, robots and what differs from them."""
WAYS: dict[Literal["never", "always"], str] = {"never": "scans", "always": "scans and IMU"}


def main() -> None:
    """Print the table."""
    heads = ("drive", "by", "scans", "length", "off at the end", "at most", "overlap", "a scan")
    with TemporaryDirectory() as folder:
        rows = []
        for name in DRIVES:
            recorded = record(name, Path(folder))
            rows += [judge(recorded, imu) for imu in WAYS]
            recorded.root.unlink()
    print(table(heads, rows))
    try:
        track_lidar(open_dataset(embedded_drive()))
        print("The demo's drive was not refused.")
    except DataError as error:
        print(f"The demo's drive is refused ({error.code}): {error}")


def record(name: str, folder: Path) -> Dataset:
    """The recording of a LiDAR and an IMU."""
    world, robot, changes = DRIVES[name]
    entry = MADE[world]
    config = merged(recording_config(entry, robot), changes)
    sensors: dict[str, object] = {"cameras": {}, "imus": {"imu": ImuMount()}}
    config = config.model_copy(update={"robot": config.robot.model_copy(update=sensors)})
    place, drive = drive_through(entry.make(entry.settings), config.robot, config.plan)
    path = folder / f"{name}.bag"
    write_recording(place, drive, config, path, jobs=2)
    return open_dataset(path)


def judge(dataset: Dataset, imu: Literal["never", "always"]) -> list[str]:
    """The row of a recording."""
    started = time.perf_counter()
    try:
        track = track_lidar(dataset, LidarOdometryConfig(imu=imu))
    except DataError as error:
        return [dataset.root.stem, WAYS[imu], str(len(dataset)), f"refused: {error.code}", *"----"]
    seconds = (time.perf_counter() - started) / len(dataset)
    assert dataset.poses is not None
    truth = dataset.poses
    length = float(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum())
    drift = track.drift(truth)
    return [
        Path(dataset.root).stem,
        WAYS[imu],
        str(len(dataset)),
        f"{length:.0f} m",
        f"{drift.end:.2f} m ({drift.end / length:.2%})",
        f"{drift.largest:.2f} m ({drift.largest / length:.2%})",
        f"{track.overlap.min():.2f}, median {statistics.median(track.overlap):.2f}",
        f"{1000 * seconds:.0f} ms",
    ]


if __name__ == "__main__":
    main()
