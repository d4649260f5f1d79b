# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How good is the map of a real stereo flight, EuRoC V1_01? A Markdown table.

    python -m benchmarks.accuracy.euroc_maps [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names. Six minutes of processor time for each
seed of odometry's noise.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from textwrap import fill

import numpy as np

from benchmarks.accuracy.data import data_folder
from benchmarks.accuracy.euroc_loops import APART_S, RIGHT_DEG, RIGHT_M, Flight
from benchmarks.accuracy.mapped_drives import MappedDrive
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.place_maps import DRIFT, PAGE, SCALE, add_drift
from benchmarks.accuracy.pose_graphs import ate
from fusionslam import FusionConfig
from fusionslam.loop_closure import LoopConfig
from fusionslam.mapping.config import MapConfig
from fusionslam.registration import RegistrationConfig
from fusionslam.sensors.frame import Frame

SEEDS = (1,)
EACH = MapConfig(keyframe_distance=0.01, keyframe_turn=0.1)
"""The frames at hand are keyframes already."""


def map_flight(flight: Flight, seed: int, folder: Path) -> MappedDrive:
    """Map the flight with odometry of a seed."""

    def frames() -> Iterator[Frame]:
        for number, stamp in enumerate(flight.stamps.tolist()):
            cloud = flight.cloud(number)
            yield Frame(number=number, stamp_ns=stamp, points=cloud.points, colors=cloud.colors)

    return MappedDrive(
        folder / f"euroc-{seed}",
        flight.poses,
        add_drift(flight.poses, seed),
        frames,
        loops=LoopConfig(window=0, window_seconds=APART_S),
        fusion=FusionConfig(source="cloud"),
        registration=RegistrationConfig(gravity=False),
        config=EACH,
    )


def row(seed: int, mapped: MappedDrive) -> list[str]:
    """Errors of odometry and of the map, and what it believes."""
    odometry = mapped.odometry[mapped.frames]
    ates = [ate(poses, mapped.true_keyframes) for poses in (odometry, mapped.poses)]
    believed = [edge for edge in mapped.loops if edge.state == "believed"]
    false = sum(mapped.is_false(edge, (RIGHT_M, RIGHT_DEG)) for edge in believed)
    return [
        *(str(seed), str(len(mapped.frames)), *(f"{value:.3f}" for value in ates)),
        *(str(len(believed)), str(false), str(len(mapped.loops) - len(believed))),
        f"{np.median(mapped.seconds):.2f}",
    ]


def flights_text() -> str:
    return fill(
        "EuRoC V1_01 (Burri et al. 2016), 100 stereo pairs, poses searched by features, without "
        f"gravity. Odometry is Vicon's path with noise of {DRIFT[0]:g} m and {DRIFT[1]:g} rad "
        f"after one metre, about each axis, and {100 * (SCALE - 1):.0f} % too long; one row for "
        f"each seed of the noise. A loop is false if it is more than {RIGHT_M:g} m or "
        f"{RIGHT_DEG:g} degrees off. No value was fitted to this flight, but the search without "
        "gravity was developed on it.",
        100,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    flight = Flight(data_folder() / "euroc_v101")
    head = ["seed", "keyframes", "ATE of odometry, m", "ATE, m", "believed", "false ones of them"]
    head += ["refused", "s a keyframe, median"]
    with tempfile.TemporaryDirectory() as folder:
        rows = [row(seed, map_flight(flight, seed, Path(folder))) for seed in SEEDS]
    text = f"{flights_text()}\n\n{table(head, rows)}"
    print(text)
    if arguments.write:
        write_between(PAGE, "flights", text)


if __name__ == "__main__":
    main()
