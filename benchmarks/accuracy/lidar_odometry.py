# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How far does odometry by LiDAR drift on simulated drives at 10 Hz? A Markdown table.

    python -m benchmarks.accuracy.lidar_odometry

The town's drive has 697 m, the house's is planned, 100 m.
The embedded drive of the demo, at 2 m a scan, must be refused. Some ten minutes.
"""

import statistics
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.accuracy.markdown import table
from fusionslam.datasets import Dataset, open_dataset
from fusionslam.errors import DataError
from fusionslam.pipelines.lidar_odometry import track_lidar
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.recordings import recording_config, write_recording
from fusionslam.sim.town.kitti_recorder import embedded_drive

DRIVES = {"town": "car_lidar", "house": "turtlebot3_vlp16"}


def main() -> None:
    """Print the table."""
    heads = ("drive", "scans", "length", "off at the end", "at most", "overlap", "CPU a scan")
    with TemporaryDirectory() as folder:
        rows = [judge(record(name, robot, Path(folder))) for name, robot in DRIVES.items()]
    print(table(heads, rows))
    try:
        track_lidar(open_dataset(embedded_drive()))
        print("The demo's drive was not refused.")
    except DataError as error:
        print(f"The demo's drive is refused ({error.code}): {error}")


def record(world: str, robot: str, folder: Path) -> Dataset:
    """The recording of a LiDAR alone."""
    entry = MADE[world]
    config = recording_config(entry, robot)
    config = config.model_copy(update={"robot": config.robot.model_copy(update={"cameras": {}})})
    place, drive = drive_through(entry.make(entry.settings), config.robot, config.plan)
    path = folder / f"{world}.bag"
    write_recording(place, drive, config, path, jobs=2)
    return open_dataset(path)


def judge(dataset: Dataset) -> list[str]:
    """The row of a recording."""
    started = time.process_time()
    track = track_lidar(dataset)
    seconds = (time.process_time() - started) / len(dataset)
    assert dataset.poses is not None
    truth = dataset.poses
    length = float(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum())
    drift = track.drift(truth)
    return [
        Path(dataset.root).stem,
        str(len(dataset)),
        f"{length:.0f} m",
        f"{drift.end:.2f} m ({drift.end / length:.2%})",
        f"{drift.largest:.2f} m ({drift.largest / length:.2%})",
        f"{track.overlap.min():.2f}, median {statistics.median(track.overlap):.2f}",
        f"{1000 * seconds:.0f} ms",
    ]


if __name__ == "__main__":
    main()
