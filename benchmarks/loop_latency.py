# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Measures how soon verified loops are known while a robot drives, at the rate of its scanner.

    python -m benchmarks.loop_latency            # the embedded drive, full circle, 10 Hz

Scans are submitted at their rate, as a robot's driver would, and proven in the background: ``add``
is the time until the robot's thread goes on, ``answer`` that until the frame's loop is known.
"""

import argparse
import resource
import time

import numpy as np

from fusionslam import Frame, FusionConfig, LoopDetector, open_dataset
from fusionslam.sim import SimConfig, embedded_folder, record


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hz", type=float, default=10.0)
    parser.add_argument("--candidates", type=int, default=10)
    arguments = parser.parse_args()
    record(SimConfig(), embedded_folder())
    frames = [
        Frame(stamp_ns=frame.stamp_ns, points=frame.points)
        for frame in open_dataset(embedded_folder())
    ]
    detector = LoopDetector(
        "m2dp", fusion=FusionConfig(source="cloud"), candidates=arguments.candidates
    )
    added, answered, loops = [], [None] * len(frames), []
    usage = resource.getrusage(resource.RUSAGE_SELF)
    begun = time.perf_counter()
    for number, frame in enumerate(frames):
        due = begun + number / arguments.hz
        time.sleep(max(0.0, due - time.perf_counter()))
        started = time.perf_counter()
        future = detector.submit(frame)
        added.append(time.perf_counter() - started)

        def note(done: object, number: int = number, started: float = started) -> None:
            answered[number] = time.perf_counter() - started  # type: ignore[call-overload]

        future.add_done_callback(note)
        loops.append(future)
    found = sum(future.result() is not None for future in loops)
    whole = time.perf_counter() - begun
    spent = resource.getrusage(resource.RUSAGE_SELF)
    cores = (spent.ru_utime + spent.ru_stime - usage.ru_utime - usage.ru_stime) / whole
    skipped = detector.unverified
    print(
        f"{len(frames)} scans at {arguments.hz:g} Hz: {found} loops, {skipped} not verified; "
        f"{cores:.2f} cores busy"
    )
    for name, seconds in (("add", added), ("answer", answered)):
        p50, p95, most = np.percentile(1e3 * np.array(seconds, float), [50, 95, 100])
        print(f"{name:7} p50 {p50:6.1f} ms   p95 {p95:6.1f} ms   most {most:6.1f} ms")


if __name__ == "__main__":
    main()
