# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Memory and time of writing and reading a long bag, to see that memory does not grow with it.

    python benchmarks/bag_memory.py OUT.bag --gigabytes 2

writes a synthetic drive (scans of 20,000 points at 10 Hz, raw noise images of 640x480 at 10 Hz,
odometry at 50 Hz), reads it as events, opens it as a dataset and reads the frames, each in a
process of its own, and prints the peak of resident memory of each. The bag stays; delete it.
"""

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fusionslam import fuse, open_dataset
from fusionslam.datasets import open_bag, open_writer
from fusionslam.sensors.messages import (
    CameraInfo,
    Event,
    FrameTransform,
    FrameTransforms,
    Odometry,
    Picture,
    Scan,
)

SECOND = 1_000_000_000
POINTS, SIZE, FOCAL = 20_000, (640, 480), 500.0
PHASES = ("write", "events", "dataset")


def drive(size: int) -> Iterator[Event]:
    """Events of a robot that drives straight on, of so many bytes."""
    still, random = np.eye(4), np.random.default_rng(0)
    camera_from_scanner = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
    yield Event("/tf_static", 0, transforms(("base", "velodyne", still)))
    yield Event("/tf_static", 0, transforms(("velodyne", "camera", camera_from_scanner.T)))
    yield Event("/camera_info", 0, calibration())
    written, step = 0, 0
    while written < size:
        stamp = step * SECOND // 50
        pose = still.copy()
        pose[0, 3] = step / 50
        yield Event("/odom", stamp, odometry(stamp, pose))
        if step % 5 == 0:
            points = random.uniform(-20, 20, (POINTS, 3)).astype(np.float32)
            image = random.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
            yield Event("/points", stamp, Scan(stamp_ns=stamp, frame_id="velodyne", points=points))
            yield Event("/image", stamp, Picture(stamp_ns=stamp, frame_id="camera", image=image))
            written += points.nbytes + image.nbytes
        step += 1


def transforms(*links: tuple[str, str, np.ndarray]) -> FrameTransforms:
    return FrameTransforms(
        transforms=tuple(
            FrameTransform(
                stamp_ns=0, parent=parent, child=child, parent_from_child=pose, static=True
            )
            for parent, child, pose in links
        )
    )


def odometry(stamp: int, pose: np.ndarray) -> Odometry:
    return Odometry(stamp_ns=stamp, frame_id="odom", child_frame_id="base", pose=pose)


def calibration() -> CameraInfo:
    matrix = np.array([[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1]])
    projection = np.hstack([matrix, np.zeros((3, 1))])
    return CameraInfo(
        stamp_ns=0, frame_id="camera", size=SIZE, camera_matrix=matrix, projection=projection
    )


def run(phase: str, path: Path, size: int) -> str:
    """Do one phase; says what was done."""
    if phase == "write":
        with open_writer(path) as bag:
            for event in drive(size):
                bag.write(event)
        return f"{bag.count} messages"
    if phase == "events":
        with open_bag(path) as source:
            return f"{sum(1 for _ in source.events())} messages"
    dataset = open_dataset(path)
    return f"{len(dataset)} frames, {sum(len(fuse(frame)) for frame in dataset)} coloured points"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path)
    parser.add_argument("--gigabytes", type=float, default=2.0)
    parser.add_argument("--phase", choices=PHASES)
    chosen = parser.parse_args()
    if chosen.phase is None:
        for phase in PHASES:
            subprocess.run([sys.executable, *sys.argv, "--phase", phase], check=True)
        return
    start, before = time.perf_counter(), peak_mb()
    done = run(chosen.phase, chosen.path, round(chosen.gigabytes * 1e9))
    seconds = time.perf_counter() - start
    print(
        f"{chosen.phase:<8}{done}, {seconds:.1f} s, peak {peak_mb():.0f} MB "
        f"({before:.0f} MB before)",
        flush=True,
    )


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


if __name__ == "__main__":
    main()
