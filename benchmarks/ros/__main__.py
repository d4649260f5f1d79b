# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Latency and processor time of the nodes on a live ROS: python -m benchmarks.ros [--write].

A simulated drive through the made house is played at its own pace, twice: with the thesis's sensors
(camera 30 Hz, LiDAR 2 Hz, a sector ahead), and with a VLP-16 (10 Hz, full circle) beside the same
camera. With --write the table goes into docs/guides/ros.md.
"""

import argparse
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.markdown import table, write_between
from benchmarks.ros.world import Heard, RosWorld
from fusionslam.config import merged
from fusionslam.datasets.bags.messages import stamp_of, value_of
from fusionslam.ros.nodes.data_fusion import DataFusion
from fusionslam.ros.ros1.environment import need_ros
from fusionslam.sensors.frame_builder import FrameBuilder
from fusionslam.sim.catalogue import MADE
from fusionslam.sim.recordings import embedded_bag, recording_config

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "ros.md"
SCANS = "/velodyne_points"
IMAGES = "/camera/rgb/image_raw/compressed"
INPUTS = (SCANS, IMAGES, "/camera/rgb/camera_info", "/odom", "/tf", "/tf_static")
STAGES = {
    "data_fusion": "/rgb_cloud",
    "lv_builder": "/current_scene_description",
    "lv_matching": "/LocalView/Template",
    "ratslam": "/ExperienceMap/RobotPose",
}
"""What each node publishes of a scan, in the order in which it goes through them."""
REPORTS = "/diagnostics"

Floats = NDArray[np.float64]

_METRES, _IMAGES_HZ = 12.0, 30.0
_SETTLED = 5
"""Scans at the start that do not count: Python still imports and compiles."""


@dataclass(frozen=True)
class Robot:
    """A set of sensors that is timed."""

    title: str
    name: str


ROBOTS = (
    Robot("LiDAR 2 Hz (18 x 120 ahead), camera 30 Hz", "turtlebot3_waffle_pi"),
    Robot("VLP-16 10 Hz (16 x 900, full circle), camera 30 Hz", "turtlebot3_vlp16"),
)


def main() -> None:
    """Time all robots and print, or write, the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    need_ros()
    tables = "\n\n".join(f"{robot.title}:\n\n{timed(robot)}" for robot in ROBOTS)
    print(tables)
    if arguments.write:
        write_between(PAGE, "latency", tables)


def timed(robot: Robot) -> str:
    """The table of one robot."""
    bag = _bag(robot)
    with tempfile.TemporaryDirectory() as folder, RosWorld(Path(folder)) as world:
        listener = world.listen(*INPUTS, *STAGES.values(), REPORTS)
        for node in reversed(STAGES):
            world.node(node, f"camera/rgb/image_raw:={IMAGES}")
        before = _stolen()
        world.play(bag)
        taken = (_stolen() - before).tolist()
        heard = listener.heard()
    rows = _latencies(heard)
    rows.append(["the host took from this virtual machine", "", "", f"{taken[0] / taken[1]:.0%}"])
    return table(["", "p50 [ms]", "p95 [ms]", "CPU"], rows)


def _stolen() -> NDArray[np.int64]:
    """Clock ticks that the host of a virtual machine took, and all, since the machine started."""
    ticks = np.array(Path("/proc/stat").read_text().split(maxsplit=9)[1:9], np.int64)
    return np.array([ticks[7], ticks.sum()])


def _bag(robot: Robot) -> Path:
    config = recording_config(MADE["house"], robot.name)
    changes = {
        "plan": {"length_m": _METRES},
        "robot": {"cameras": {"camera": {"rate_hz": _IMAGES_HZ}}},
    }
    return embedded_bag("house", merged(config, changes), jobs=2)


def _latencies(heard: list[Heard]) -> list[list[str]]:
    """Rows of the table: waiting, the stages, all of them together."""
    done = {"sensors": _ready(heard)}
    done |= {node: first_arrivals(heard, topic) for node, topic in STAGES.items()}
    scans = first_arrivals(heard, SCANS)
    stamps = sorted(set.intersection(*(set(times) for times in done.values())))[_SETTLED:]
    at = {name: np.array([times[stamp] for stamp in stamps]) for name, times in done.items()}
    scan, ready, shown = np.array([scans[s] for s in stamps]), at["sensors"], at["ratslam"]
    shares = processor_shares(heard, [*STAGES])
    rows = [_row("waiting for image and odometry after the scan", ready - scan)]
    for before, node in pairwise(at):
        rows.append(_row(node, at[node] - at[before], shares[node]))
    whole = f"{sum(shares.values()):.0%}"
    rows.append(_row("**from the last message that was needed to the map**", shown - ready, whole))
    rows.append(_row("from the scan to the map, waiting included", shown - scan))
    return [*rows, [f"scans: {len(stamps)} of {len(scans)}", "", "", ""]]


def _row(title: str, seconds: Floats, share: float | str = "") -> list[str]:
    milliseconds = [f"{1e3 * np.quantile(seconds, quantile):.1f}" for quantile in (0.5, 0.95)]
    return [title, *milliseconds, share if isinstance(share, str) else f"{share:.0%}"]


def first_arrivals(heard: list[Heard], topic: str) -> dict[int, float]:
    """When the first message of each stamp arrived."""
    found: dict[int, float] = {}
    for each in heard:
        if each.topic == topic:
            found.setdefault(stamp_of(each.message.header.stamp), each.seconds)
    return found


def _ready(heard: list[Heard]) -> dict[int, float]:
    """When the last message arrived that a scan had to wait for."""
    builder, found = FrameBuilder(DataFusion.defaults.online), {}
    for each in heard:
        if each.topic in INPUTS:
            value = value_of(each.message, each.type_name, each.topic)
            for frame in builder.process(value):
                found[frame.stamp_ns] = each.seconds
    return found


def processor_shares(heard: list[Heard], nodes: list[str]) -> dict[str, float]:
    """Processor time of each node by the time that passed, between its first and last report."""
    reports: dict[str, list[tuple[float, float]]] = {node: [] for node in nodes}
    for each in heard:
        if each.topic == REPORTS:
            status = each.message.status[0]
            values = {value.key: value.value for value in status.values}
            node = status.name.removeprefix("fusionslam: ")
            reports[node].append((each.seconds, float(values["processor time [s]"])))
    return {
        node: (spent[-1][1] - spent[0][1]) / (spent[-1][0] - spent[0][0])
        for node, spent in reports.items()
    }


if __name__ == "__main__":
    main()
