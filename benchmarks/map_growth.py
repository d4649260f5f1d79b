# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Does the work for a keyframe, or the memory, grow with a map? Markdown tables.

    python -m benchmarks.map_growth latency [--keyframes 5000] [--write]
    python -m benchmarks.map_growth hour [--minutes 60] [--write]

``latency`` copies keyframes of a simulated town until there are so many, as if a robot drove up and
down, with loops to the last time it was there, and times what the graph and the file take of each.
Then it opens the map, adds frames and localises others. ``hour`` drives up and down a town at 10 Hz
through all of ``PlaceMap.add`` and reads the resident memory of the process each minute. Most
frames are no keyframes. Files are made in a temporary folder: 1 GB for 5,000 keyframes.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import fill

import numpy as np

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import record_towns
from fusionslam import FusionConfig
from fusionslam.base.arrays import Floats, Matrix
from fusionslam.datasets import Dataset, open_dataset
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping import Edge, PlaceMap
from fusionslam.mapping.config import MapConfig, odometry_covariance
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import MapFile
from fusionslam.sensors.frame import Frame

PAGE = ROOT / "docs" / "stages" / "mapping.md"
TOWN = 1
RATE_HZ = 10
FRAMES_A_STEP = 20
"""Frames from one recorded one to the next, which is 2 m on: 1 m/s."""
DRIFT = (0.03, 0.005)
"""Standard deviations of odometry after one metre, in metres and radians, of each axis."""
LOOP_SD = np.repeat([0.05, 0.01], 3)
WARM_UP, MEAN_OF = 10, 10
"""Minutes after which memory should be flat, and minutes whose mean is compared."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    latency, hour = commands.add_parser("latency"), commands.add_parser("hour")
    latency.add_argument("--keyframes", type=int, default=5000)
    hour.add_argument("--minutes", type=int, default=60)
    for command in (latency, hour):
        command.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    if arguments.command == "hour" and arguments.minutes < WARM_UP + MEAN_OF:
        parser.error(f"--minutes: expected {WARM_UP + MEAN_OF} or more")
    (town,) = record_towns([TOWN])
    drive = open_dataset(town)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "town.fsmap"
        if arguments.command == "latency":
            name, text = "map latency", measure_latency(path, drive, arguments.keyframes)
        else:
            name, text = "map memory", measure_memory(path, drive, arguments.minutes)
    print(text)
    if arguments.write:
        write_between(PAGE, name, text)


def up_and_down(count: int, frames: int) -> Iterator[int]:
    """Indices of recorded frames of a robot that drives up and down."""
    there_and_back = [*range(frames), *range(frames - 1, -1, -1)]
    for k in range(count):
        yield there_and_back[k % len(there_and_back)]


def drift(step: Matrix, rng: np.random.Generator) -> Matrix:
    """What odometry measures of a step."""
    sds = np.repeat(DRIFT, 3) * np.sqrt(np.linalg.norm(step[:3, 3]))
    noisy: Matrix = step @ exp(rng.normal(size=6) * sds)
    return noisy


def open_map(path: Path) -> PlaceMap:
    return PlaceMap.open(
        path,
        "drive",
        descriptor="m2dp",
        fusion=FusionConfig(source="cloud"),
        config=MapConfig(keyframe_distance=1.5),
    )


# The memory of an hour.


def measure_memory(path: Path, town: Dataset, minutes: int) -> str:
    """Drive for so many minutes; return memory and size of the file by minute."""
    rows, rng = [], np.random.default_rng(0)
    true = true_poses(town)
    odometry, last = np.eye(4), true[0]
    seconds = 0.0
    with open_map(path) as site:
        steps = up_and_down(minutes * 60 * RATE_HZ // FRAMES_A_STEP, len(town))
        for step, index in enumerate(steps):
            recorded = town[index]
            odometry = odometry @ drift(inverse(last) @ true[index], rng)
            last = true[index]
            for k in range(FRAMES_A_STEP):
                number = step * FRAMES_A_STEP + k
                here = odometry @ exp(np.array([0.001 * k, 0, 0, 0, 0, 0]))  # it crawls
                frame = Frame(
                    index=number,
                    stamp_ns=number * 10**9 // RATE_HZ + 1,
                    points=recorded.points,
                    robot_from_points=recorded.robot_from_points,
                )
                started = time.process_time()
                site.add(frame, odometry=here)
                seconds += time.process_time() - started
            minute, rest = divmod((step + 1) * FRAMES_A_STEP, 60 * RATE_HZ)
            if not rest:
                size = path.stat().st_size
                rows.append((minute, len(site), len(site.loops), resident_mb(), size))
                print(*rows[-1], flush=True)
        vectors = sum(rows_.nbytes for _, rows_ in site.file.vectors().values()) / 1e6
    return memory_text(rows, vectors, seconds)


def memory_text(
    rows: list[tuple[int, int, int, float, int]], vectors: float, seconds: float
) -> str:
    minutes, keyframes = rows[-1][:2]
    then, now = rows[WARM_UP : WARM_UP + MEAN_OF], rows[-MEAN_OF:]
    before, after = (float(np.mean([row[3] for row in some])) for some in (then, now))
    share = np.mean([row[1] for row in now]) - np.mean([row[1] for row in then])
    shown = [row for row in rows if row[0] == 1 or row[0] % 10 == 0]
    head = ["minute", "keyframes", "loops", "resident memory, MB", "kB of the file a keyframe"]
    body = table(
        head,
        [
            [str(minute), str(count), str(loops), f"{memory:.0f}", f"{size / 1e3 / count:.0f}"]
            for minute, count, loops, memory, size in shown
        ],
    )
    text = (
        f"{minutes} minutes at {RATE_HZ} Hz up and down a town of the simulator, "
        f"{minutes * 60 * RATE_HZ:,} frames, a keyframe each 2 m, all in one session. "
        "Memory goes up and down with the 64 clouds that are ready for registration. Its mean of "
        f"the last {len(now)} minutes is {after:.0f} MB, that of minutes {then[0][0]} to "
        f"{then[-1][0]} {before:.0f} MB: {100 * (after / before - 1):.0f} % more, of which vectors "
        f"are {vectors * share / keyframes:.0f} MB. Processor time: "
        f"{seconds:.0f} s."
    )
    return f"{fill(text, 100)}\n\n{body}"


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def true_poses(town: Dataset) -> Floats:
    """float64 (n, 4, 4), world_from_robot."""
    assert town.true_poses is not None
    return np.asarray(town.true_poses @ town.body_from_robot, np.float64)


# The time that a keyframe takes.


def measure_latency(path: Path, town: Dataset, keyframes: int) -> str:
    """Return tables of processor time on a map of so many keyframes."""
    with open_map(path) as site:
        odometry, rng, last = np.eye(4), np.random.default_rng(0), true_poses(town)[0]
        for index, true in enumerate(true_poses(town)):
            odometry, last = odometry @ drift(inverse(last) @ true, rng), true
            site.add(town[index], odometry=odometry)
    up_to = [*up_and_down(keyframes, len(town))]
    graph, file = repeat_drive(path, true_poses(town), keyframes)
    started = time.process_time()
    with PlaceMap.open(path, read_only=True) as site:
        opened = time.process_time() - started
        localize = [time_of(site.localize, town[k]) for k in range(0, len(town), 5)]
        size = path.stat().st_size / 1e3 / len(site)
    added = []
    with open_map(path) as site:
        odometry, last = site.odometry("drive")[-1], true_poses(town)[up_to[-1]]
        for index in [*up_and_down(keyframes + 100, len(town))][keyframes:]:
            true = true_poses(town)[index]
            odometry, last = odometry @ drift(inverse(last) @ true, rng), true
            recorded = town[index]
            frame = Frame(
                index=(site.last_frame or 0) + 1,
                points=recorded.points,
                robot_from_points=recorded.robot_from_points,
            )
            added.append(time_of(site.add, frame, odometry=odometry))
    rows = [
        ("graph, of each keyframe", graph),
        ("file, of each keyframe", file),
        ("`add`, with description and registration", added),
        ("`localize`, without any guess", localize),
    ]
    text = fill(
        f"A town's map, copied as if the robot drove up and down until it had {keyframes:,} "
        f"keyframes, each second one with a loop. Milliseconds of processor time of one thread. "
        f"Opening the map takes {opened:.1f} s, too, of which a part solves its last loops; it has "
        f"{size:.0f} kB a keyframe.",
        100,
    )
    head = ["work", "times", "median", "95 %", "longest"]
    return f"{text}\n\n" + table(head, [[name, str(len(s)), *spread(s)] for name, s in rows])


def repeat_drive(path: Path, true: Floats, keyframes: int) -> tuple[list[float], list[float]]:
    """Copy the keyframes of a map until it has so many; return seconds of the graph and the file.

    Args:
        path: of the map, with a keyframe for each true pose.
        true: float64 (n, 4, 4), world_from_robot.
        keyframes: number of them.
    """
    rng = np.random.default_rng(1)
    graph_seconds, file_seconds = [], []
    with MapFile(path) as file:
        content = MapContent(file.sessions(), file.keyframes(), file.edges(), file.solution())
        known, vectors = content.keyframes[:], file.vectors()
        clouds = [file.cloud(keyframe.id) for keyframe in known]
        world = true[[keyframe.frame for keyframe in known]] @ known[0].robot_from_cloud
        steps = [edge for edge in content.edges.values() if edge.kind == "loop"]
        firm = steps[0].covariance
        seen = [[index] for index in range(len(known))]
        ways = [*up_and_down(keyframes, len(known))]
        for number in range(len(known), keyframes):
            index, before = ways[number], content.keyframes[-1]
            step = inverse(world[ways[number - 1]]) @ world[index]
            driven = drift(step, rng)
            keyframe = before._replace(
                id=number,
                frame=before.frame + 1,
                stamp_ns=before.stamp_ns + 2 * 10**9,
                odometry=before.odometry @ driven,
            )
            ends, edge = (number - 1, number), content.next_edge
            rough = odometry_covariance(driven, MapConfig())
            measured = step @ noise(rng, np.sqrt(np.diag(firm)))
            edges = [
                Edge(edge, "odometry", *ends, driven, rough, "believed"),
                Edge(edge + 1, "loop", *ends, measured, firm, "pending"),
            ]
            visits = [visit for visit in seen[index] if visit < number - 20]
            if number % 2 and visits:
                found, covariance = noise(rng, LOOP_SD), np.diag(LOOP_SD**2)
                visit = int(rng.choice(visits))
                edges.append(Edge(edge + 2, "loop", visit, number, found, covariance, "pending"))
            seen[index].append(number)
            graph_seconds.append(time_of(content.add, keyframe, edges))
            own = {name: rows[index] for name, (_, rows) in vectors.items()}
            started = time.process_time()
            with file.transaction():
                file.add_keyframe(keyframe, clouds[index], own)
                content.save(file)
            content.saved()
            file_seconds.append(time.process_time() - started)
    return graph_seconds, file_seconds


def noise(rng: np.random.Generator, sds: Floats) -> Matrix:
    moved: Matrix = exp(rng.normal(size=6) * sds)
    return moved


def time_of(action: Callable[..., object], *arguments: object, **options: object) -> float:
    """Seconds of processor time."""
    started = time.process_time()
    action(*arguments, **options)
    return time.process_time() - started


def spread(seconds: list[float]) -> list[str]:
    """Median, 95th percentile and maximum in milliseconds."""
    return [f"{1e3 * value:.1f}" for value in np.quantile(seconds, [0.5, 0.95, 1.0])]


if __name__ == "__main__":
    main()
