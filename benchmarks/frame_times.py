# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where the time of a verified frame goes: python -m benchmarks.frame_times [NAME ...] [--write].

Processor time of the frames that have candidates, of a simulated drive and of real recordings
(names as of benchmarks.real), which are part of the test data that FUSIONSLAM_TEST_DATA names. A
step that another one calls is not counted twice. With --write the table goes into
docs/stages/loop_closure.md. Nothing else should run meanwhile.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial, wraps
from typing import Any

import numpy as np

from benchmarks.accuracy.data import ROOT, find_folder
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.real.recordings import CLOUDS, read_recording
from fusionslam import Cloud, LoopDetector, open_dataset
from fusionslam.loop_closure import detector, observation, verification
from fusionslam.registration import PreparedCloud, clouds, pose_estimation
from fusionslam.sim import SimConfig, embedded_folder, record

PAGE = ROOT / "docs" / "stages" / "loop_closure.md"
TOWN = "town"
RECORDINGS = (TOWN, "kitti00_keyframes", "hku_1")
STEPS: tuple[tuple[str, Any, str], ...] = (
    ("level", observation, "find_level"),
    ("join the local map", observation, "join_clouds"),
    ("describe", observation, "describe"),
    ("describe", observation, "describe_or_zeros"),
    ("thin, store ranges", observation, "PreparedCloud"),
    ("find the ground", clouds, "remove_ground_segments"),
    ("images from above", clouds, "draw_turned"),
    ("compare images", verification, "compare_images"),
    ("search poses", verification, "search_poses"),
    ("normals", clouds, "SurfaceCloud"),
    ("refine", pose_estimation, "refine_pose"),
    ("overlap", pose_estimation, "count_overlap"),
    ("pack", PreparedCloud, "to_bytes"),
    ("unpack", PreparedCloud, "from_bytes"),
    ("the rest", detector.LoopDetector, "add"),
)
"""A step's name, and the function that is timed."""
Frames = Iterator[tuple[Cloud, dict[str, Any]]]


class Watch:
    """Adds up the processor time of steps, less that of the steps that they call."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inner: list[float] = []
        for name, owner, function in STEPS:
            setattr(owner, function, self._timed(name, getattr(owner, function)))

    def _timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function, updated=())
        def timed(*arguments: Any, **options: Any) -> Any:
            self._inner.append(0.0)
            started = time.process_time()
            try:
                return function(*arguments, **options)
            finally:
                spent = time.process_time() - started
                self.seconds[name] += spent - self._inner.pop()
                if self._inner:
                    self._inner[-1] += spent

        return timed


def drive_town() -> tuple[LoopDetector, Frames]:
    """The embedded drive, full circle."""
    record(SimConfig(), embedded_folder())
    frames = open_dataset(embedded_folder())
    scans: Frames = ((Cloud(each.points), {}) for each in frames if each.points is not None)
    return LoopDetector("m2dp", fusion=CLOUDS), scans


def play(name: str) -> tuple[LoopDetector, Frames]:
    """A recording of the test data, with its odometry."""
    recording = read_recording(find_folder(), name)
    if recording is None:
        raise SystemExit(f"{name} is not in the test data")
    known = zip(recording.clouds, recording.stamps_ns, recording.odometry, strict=True)
    scans = ((cloud, {"stamp_ns": int(stamp), "odometry": pose}) for cloud, stamp, pose in known)
    return recording.detector(), scans


def measure(watch: Watch, name: str) -> dict[str, str]:
    """Return a column of the table."""
    finder, scans = drive_town() if name == TOWN else play(name)
    totals, points, loops, packed = [], [], 0, []
    steps: dict[str, float] = defaultdict(float)
    for number, (cloud, options) in enumerate(scans):
        watch.seconds.clear()
        loop = finder.add(cloud, **options)
        if finder.nearest is None and not finder.rejected:
            continue
        loops += loop is not None
        totals.append(1e3 * sum(watch.seconds.values()))
        points.append(len(cloud))
        for step, seconds in watch.seconds.items():
            steps[step] += seconds
        packed.append(len(finder.stored_frame(number).unpack().to_bytes()) / 1e3)
    column = {
        "frames": f"{len(totals)}",
        "points": f"{np.median(points):,.0f}",
        "loops": f"{loops}",
    }
    column["kB a stored cloud"] = f"{np.mean(packed):.0f}"
    column |= {"ms a frame, median": f"{np.median(totals):.1f}"}
    column |= {"95 %": f"{np.percentile(totals, 95):.1f}"}
    return column | {step: f"{1e3 * steps[step] / len(totals):.1f}" for step, *_ in STEPS}


def main() -> None:
    """Time all and print, or write, the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=RECORDINGS, metavar="NAME")
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    columns = [*map(partial(measure, Watch()), arguments.names)]
    rows = [[name, *(each[name] for each in columns)] for name in columns[0]]
    text = table(["", *arguments.names], rows)
    print(text)
    if arguments.write:
        write_between(PAGE, "frame times", text)


if __name__ == "__main__":
    main()
