# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What data_fusion loses and adds in ROS 2 under load: python -m benchmarks.ros.load [--write].

A process of plain rclpy publishes clouds of 120,000 points and images of 640 x 480 at 10 Hz for a
minute, reliably, on the loopback; another one listens to them and to what data_fusion makes of
them. Latency added is from the arrival of a cloud at the listener to that of the coloured one.
With --write the table goes into docs/guides/ros2.md.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.accuracy.markdown import table, write_between
from benchmarks.ros.__main__ import first_arrivals, processor_shares
from benchmarks.ros.ros2_world import JAZZY, PUBLISHER, Ros2World, lacking
from benchmarks.ros.world import REPORTS

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "ros2.md"
SCANS, CLOUDS = "/velodyne_points", "/rgb_cloud"
INPUTS = (SCANS, "/camera/rgb/image_raw", "/camera/rgb/camera_info")
_MARGIN_S = 600


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=120_000)
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    if lacking:
        raise SystemExit(lacking)
    found = measure(arguments.points, arguments.rate, arguments.seconds)
    print(found)
    if arguments.write:
        write_between(PAGE, "load", found)


def measure(points: int, rate: float, seconds: float) -> str:
    """Return the table."""
    with tempfile.TemporaryDirectory() as folder, Ros2World(Path(folder)) as world:
        listener = world.listen(*INPUTS, CLOUDS, REPORTS)
        world.node("data_fusion", "_online.robot_frame:=camera", "_fusion.frame:=scan")
        listener.wait_for(CLOUDS)
        python, sizes = str(JAZZY / "bin" / "python"), map(str, (points, rate, seconds))
        publisher = world.run("publisher", [python, str(PUBLISHER), *sizes])
        assert publisher.wait(seconds + _MARGIN_S) == 0, world.log("publisher")
        listener.settle()
        heard, sent = listener.heard(), int(world.log("publisher").split()[-1])
    arrived = {topic: first_arrivals(heard, topic) for topic in (SCANS, CLOUDS)}
    both = sorted(arrived[SCANS].keys() & arrived[CLOUDS].keys())
    added = 1e3 * np.array([arrived[CLOUDS][stamp] - arrived[SCANS][stamp] for stamp in both])
    (share,) = processor_shares(heard, ["data_fusion"]).values()
    rows = [
        ["clouds sent", str(sent)],
        ["received by another process", str(len(arrived[SCANS]))],
        ["coloured clouds received", str(len(arrived[CLOUDS]))],
        ["latency added, median", f"{np.median(added):.1f} ms"],
        ["latency added, 95 %", f"{np.quantile(added, 0.95):.1f} ms"],
        ["processor time of data_fusion", f"{share:.0%} of a core"],
    ]
    return table([f"{points:,} points at {rate:g} Hz, {seconds:g} s", ""], rows)


if __name__ == "__main__":
    main()
