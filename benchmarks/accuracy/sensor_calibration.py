# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Does ``fusionslam calibrate`` find where an IMU is, and how late it is?

    python -m benchmarks.accuracy.sensor_calibration [--drives N] [--imus N] [KIND ...]

Prints a Markdown table. A VLP-16 is carried or driven through made houses, each with IMUs whose
stated poses are turned by 0.1 to 5 degrees and moved by 1 to 20 cm, and whose stamps are late by 5
to 200 ms, either way. Takes half a minute of processor time
a drive, and as much an IMU.
"""

import argparse
import sys
from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.markdown import table
from fusionslam.base.arrays import Floats
from fusionslam.calibration.estimate import Estimate
from fusionslam.calibration.lidar_imu import read_imu
from fusionslam.config import merged
from fusionslam.datasets import Dataset, open_dataset
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import exp
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.pipelines.scan_paths import ScanFollower
from fusionslam.pipelines.sensor_calibration import REFINEMENTS, settle_imu
from fusionslam.sensors.messages import NANOSECONDS
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.recordings import recording_config, write_recording
from fusionslam.sim.robot import ImuMount

HAND = {"roll_deg": 5.0, "pitch_deg": 5.0, "yaw_deg": 5.0, "rate_hz": 0.5}
HAND |= {"along_m": 0.05, "aside_m": 0.05, "heave_m": 0.05}
SWAYS: dict[str, dict[str, float]] = {"in the hand": HAND, "on wheels": {}, "straight": {}}
SEEDS = (21, 22, 23, 24, 25, 26, 27, 28, 29, 30)
SECONDS = 32.0
STRAIGHT_RAD = np.radians(3.0)
HEADER = (
    "drive", "quantity", "cases", "refused", "said", "error: median", "largest", "bound",
    "within it", "interval: median", "holds the truth",
)  # fmt: skip
BOUNDS = {"deg": 0.1, "m": 0.01, "ms": 2.0}


class Result(NamedTuple):
    """What was found of a quantity."""

    kind: str
    estimate: Estimate
    truth: float


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=len(SEEDS), help="of each kind")
    parser.add_argument("--imus", type=int, default=6, help="on each drive")
    parser.add_argument("kinds", nargs="*", default=list(SWAYS), metavar="KIND")
    arguments = parser.parse_args()
    results = []
    for kind in arguments.kinds:
        for seed in SEEDS[: arguments.drives]:
            for result in judge(kind, seed, arguments.imus):
                print(*result.estimate.row(), f"truth {result.truth:.4g}", file=sys.stderr)
                results.append(result)
    rows = []
    for kind, name in dict.fromkeys((each.kind, each.estimate.name) for each in results):
        chosen = [each for each in results if (each.kind, each.estimate.name) == (kind, name)]
        rows.append(summarise(chosen, cases=arguments.drives * arguments.imus))
    print(table(HEADER, rows))


def judge(kind: str, seed: int, imus: int) -> Iterator[Result]:
    """Calibrate all IMUs of a drive."""
    rng = np.random.default_rng([seed, list(SWAYS).index(kind)])
    mounts = {f"imu{number}": random_mount(f"imu{number}", rng) for number in range(imus)}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "drive.bag"
        record(kind, seed, mounts, path)
        follower = ScanFollower(opened(path, "/imu0"), refinements=imus * REFINEMENTS)
        for mount in mounts.values():
            dataset = opened(path, mount.topic)
            truth = dataset.points_from_imu()
            assert truth is not None
            size = np.exp(rng.uniform(*np.log([0.1, 5.0])))
            moved = rng.uniform(0.01, 0.2)
            off = np.r_[moved * direction(rng), np.radians(size) * direction(rng)]
            late_s = rng.choice([-1, 1]) * np.exp(rng.uniform(*np.log([0.005, 0.2])))
            late_ns = round(late_s * NANOSECONDS)
            messages = (
                replace(each, stamp_ns=each.stamp_ns + late_ns) for each in dataset.imu_messages()
            )
            own = copy(follower)
            stated = truth @ exp(off)
            try:
                found = settle_imu(own, read_imu(messages, own.path), stated)
            except DataError as error:
                if error.code != "path":
                    raise
                print(seed, error, file=sys.stderr)
                continue
            turned = Rotation.from_matrix(truth[:3, :3] @ stated[:3, :3].T)
            turns = turned.as_rotvec(degrees=True)
            truths = dict(zip([f"IMU turned about {axis}" for axis in "xyz"], turns, strict=True))
            truths |= {f"IMU at {axis}": truth[row, 3] for row, axis in enumerate("xyz")}
            truths["IMU late by"] = 1000 * late_s
            for each in found.estimates:
                if each.name in truths:
                    yield Result(kind, each, float(truths[each.name]))


def direction(rng: np.random.Generator) -> Floats:
    """A random unit vector (3)."""
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def random_mount(name: str, rng: np.random.Generator) -> ImuMount:
    """An IMU near the LiDAR, tilted any way about its axis up, and otherwise little."""
    x, y, z = rng.uniform([-0.2, -0.2, 0.8], [0.2, 0.2, 1.1])
    roll, pitch, yaw = rng.uniform([-10, -10, -180], [10, 10, 180])
    return ImuMount(
        topic=f"/{name}", frame_id=name, position_m=(x, y, z), tilt_deg=(roll, pitch, yaw)
    )


def record(kind: str, seed: int, imus: dict[str, ImuMount], path: Path) -> None:
    """Record a drive through a house."""
    house = MADE["house"]
    changes = {
        "seed": seed,
        "seconds": SECONDS,
        "plan": {"seed": seed},
        "world": {"seed": seed},
        "robot": {
            "sway": SWAYS[kind],
            "lidars": {"velodyne": {"position_m": [0.0, 0.0, 1.0]}},
        },
    }
    config = merged(recording_config(house, "turtlebot3_vlp16"), changes)
    robot = config.robot.model_copy(update={"cameras": {}, "imus": imus})
    config = config.model_copy(update={"robot": robot})
    world, drive = drive_through(house.make(config.world), robot, config.plan)
    if kind == "straight":
        drive = longest_straight(drive)
    write_recording(world, drive, config, path)


def longest_straight(drive: Trajectory) -> Trajectory:
    """The longest part of a drive that turns by less than 3 degrees, made straight, in 30 s."""
    best, longest = (0, 1), 0.0
    for begin in range(len(drive)):
        turned = np.abs(drive.yaw[begin:] - drive.yaw[begin]) > STRAIGHT_RAD
        end = begin + int(np.argmax(turned)) - 1 if turned.any() else len(drive) - 1
        length = float(np.hypot(drive.x[end] - drive.x[begin], drive.y[end] - drive.y[begin]))
        if length > longest:
            best, longest = (begin, end), length
    x, y = drive.x[[*best]], drive.y[[*best]]
    yaw = np.full(2, np.arctan2(y[1] - y[0], x[1] - x[0]))
    return Trajectory(np.array([0.0, 30.0]), x, y, yaw)


def opened(path: Path, imu: str) -> Dataset:
    """The recording with one of its IMUs."""
    return open_dataset(path, sensors=["points"], topics={"imu": imu}, deskew=False)


def summarise(results: list[Result], cases: int) -> list[object]:
    """A row of the table; cases that are not among the results were refused."""
    first = results[0].estimate
    name, unit = first.name, first.unit
    said = [each for each in results if each.estimate.value is not None]
    heads: list[object] = [results[0].kind, name, cases, cases - len(results), len(said)]
    bound = BOUNDS[unit]
    if not said:
        return [*heads, "", "", f"{bound:g} {unit}", "", "", ""]
    errors = np.array([abs((each.estimate.value or 0) - each.truth) for each in said])
    widths = np.array([each.estimate.half_width or 0 for each in said])
    return [
        *heads,
        f"{np.median(errors):.2g} {unit}",
        f"{errors.max():.2g} {unit}",
        f"{bound:g} {unit}",
        int((errors <= bound).sum()),
        f"{np.median(widths):.2g} {unit}",
        int((errors <= widths).sum()),
    ]


if __name__ == "__main__":
    main()
