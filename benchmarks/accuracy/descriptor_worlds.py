# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The recordings that all descriptors are compared on, kept in the cache."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.accuracy.all_round_color import record_ring
from benchmarks.accuracy.data import data_folder
from benchmarks.accuracy.euroc_loops import Flight
from benchmarks.accuracy.rooms import CIRCLE_ROBOT, LENGTH_M
from fusionslam.base.cache import cache_folder
from fusionslam.config import merged
from fusionslam.datasets import write_cloud
from fusionslam.datasets.pose_files import write_poses_tum
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.recordings import FOLDER, record_seed, recording_config, write_recording

_SEED = 0
_IMAGE = {"width": 320, "height": 240, "rate_hz": 1.0}


def record_town(seed: int, drive: str, jobs: int) -> Path:
    """The drive of a car with one camera ahead ("front") or four ("ring") through a town."""
    if drive == "ring":
        return record_ring(seed, cache_folder() / f"town-{seed}-four-cameras")
    return record_seed("town", seed, jobs=jobs)


def record_rooms(name: str, drive: str, jobs: int) -> Path:
    """The drive of a small robot through a made interior: a scan and an image each second.

    The scanner sees the full circle and stands still during a scan; the camera sees ahead.
    """
    del drive  # there is one
    folder = cache_folder() / f"{name}-circle"
    if folder.exists():
        return folder
    still = {"velodyne": {"rate_hz": 1.0, "scan_motion": False}}
    config = merged(
        recording_config(MADE[name], CIRCLE_ROBOT),
        {"robot": {"lidars": still, "cameras": {"camera": _IMAGE}}},
    )
    plan = PlanConfig(seed=_SEED, spacing_m=8.0, again=0.2, back=0.2, length_m=LENGTH_M[name])
    world, way = drive_through(MADE[name].make(config.world), config.robot, plan)
    return _whole(
        folder, lambda path: write_recording(world, way, config, path, kind=FOLDER, jobs=jobs)
    )


def record_flight(drive: str, jobs: int) -> Path:
    """The stereo clouds of EuRoC's keyframes, in the camera's frame, as a folder."""
    del drive, jobs
    folder = cache_folder() / "euroc-v101"
    if folder.exists():
        return folder

    def write(path: Path) -> None:
        flight = Flight(data_folder() / "euroc_v101")
        for number in range(len(flight.stamps)):
            write_cloud(path / f"clouds/{number:06d}.ply", flight.cloud(number))
        seconds = (flight.stamps - flight.stamps[0]) / 1e9
        (path / "times.txt").write_text("".join(f"{value:.9f}\n" for value in seconds))
        stamps = np.rint(seconds * 1e9).astype(np.int64)
        write_poses_tum(path / "poses.txt", stamps, flight.poses)

    return _whole(folder, write)


def _whole(folder: Path, write: Callable[[Path], object]) -> Path:
    """Write a folder, whole or not at all; what an interrupted call left is deleted."""
    part = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(part, ignore_errors=True)
    part.parent.mkdir(parents=True, exist_ok=True)
    write(part)
    part.rename(folder)
    return folder
