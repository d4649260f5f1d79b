# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares maps of simulated towns with those of KISS-SLAM and of MapClosures' loops.

python -m benchmarks.accuracy.map_peers              # the first town
python -m benchmarks.accuracy.map_peers 1 2 3        # towns of these seeds

All get the full circle of the LiDAR; the odometry is that of ``benchmarks.accuracy.place_maps``.
KISS-SLAM runs as a whole, with its own odometry and with ours in its place. MapClosures only finds
loops: it gets ten scans around each, joined by the same odometry, and its loops go into our pose
graph. The peers run in the environment of ``benchmarks.accuracy.loop_peers``; where one fails, the
program says so and goes on without it. A town takes about five minutes of processor time.
"""

import argparse
import itertools
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.loop_peers import (
    CLOUDS,
    FOLDER,
    PEERS,
    last_line,
    note,
    peers_python,
    run_peer,
)
from benchmarks.accuracy.mapped_drives import RIGHT, difference
from benchmarks.accuracy.markdown import table
from benchmarks.accuracy.place_maps import Town
from benchmarks.accuracy.pose_graphs import ate
from benchmarks.accuracy.presets import mean_and_range, record_towns
from fusionslam import Cloud, PoseGraph, fuse
from fusionslam.base.arrays import Floats
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset
from fusionslam.evaluation import VerifiedRun
from fusionslam.geometry.se3 import inverse
from fusionslam.mapping.config import MapConfig, odometry_covariance

OURS, KISS = "fusionslam", "KISS-SLAM"
JOINED = 10
"""Scans of a local map of MapClosures."""
LOOP_SD = (0.5, 2.0)
"""Metres and degrees that MapClosures' loops, found in images of 0.5 m cells, are trusted to."""


class Mapped(NamedTuple):
    """What a mapper made of a town: its name, ATE, loops, false ones of them, and seconds."""

    name: str
    ate: float
    loops: int
    false: int
    seconds: float


class Drive(NamedTuple):
    """A drive through a town.

    Attributes:
        clouds: N of them.
        true: float64 (N, 4, 4), world_from_cloud.
        odometry: float64 (N, 4, 4), odom_from_cloud.
    """

    clouds: list[Cloud]
    true: Floats
    odometry: Floats


def read_drive(town: Town) -> Drive:
    (path,) = record_towns([town.seed])
    dataset = open_dataset(path)
    mounted = dataset[0].robot_from_points
    assert mounted is not None  # the simulator writes it
    return Drive(
        [fuse(frame, CLOUDS) for frame in dataset], town.true @ mounted, town.odometry @ mounted
    )


def map_ours(town: Town) -> Mapped:
    believed = [edge for edge in town.loops if edge.state == "believed"]
    false = sum(town.is_false(edge) for edge in believed)
    error = ate(town.poses, town.true_keyframes)
    return Mapped(OURS, error, len(believed), false, sum(town.seconds))


def map_by_kiss(python: Path, drive: Drive, given: bool) -> Mapped:
    """Map a drive by KISS-SLAM, with its own odometry or the given one."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "given.npz", Path(folder) / "mapped.npz"
        np.savez(
            source,
            points=np.concatenate([cloud.points for cloud in drive.clouds]),
            ends=np.cumsum([len(cloud) for cloud in drive.clouds]),
            poses=drive.odometry if given else np.empty((0, 4, 4)),
        )
        command = [str(python), str(FOLDER / "slam_worker.py"), str(source), str(target)]
        subprocess.run(command, check=True, capture_output=True, text=True)
        with np.load(target) as stored:
            found = dict(stored)
    false = 0
    for (a, b), constraint in zip(found["closures"], found["constraints"], strict=True):
        false += is_off(inverse(drive.true[b]) @ drive.true[a], constraint)
    name = f"{KISS}, {'the same odometry' if given else 'its own odometry'}"
    seconds = float(found["seconds"])
    return Mapped(name, ate(found["poses"], drive.true), len(found["closures"]), false, seconds)


def map_by_closures(python: Path, drive: Drive) -> list[Mapped]:
    """Put the loops of MapClosures and of KISS-SLAM's closer into our pose graph."""
    runs = run_peer(python, JOINED, drive.clouds, drive.odometry)
    return [
        solve(f"{name.split(',')[0]}, in our graph", drive, run)
        for name, run in zip(PEERS[JOINED], runs, strict=True)
    ]


def solve(name: str, drive: Drive, run: VerifiedRun) -> Mapped:
    """Solve the graph of the odometry and of the accepted loops of a run."""
    graph = PoseGraph()
    nodes = [graph.add_node() for _ in drive.odometry]
    for a, b in itertools.pairwise(nodes):
        step = inverse(drive.odometry[a]) @ drive.odometry[b]
        graph.add_edge(a, b, step, odometry_covariance(step, MapConfig()), "odometry")
    covariance = np.diag(np.repeat([LOOP_SD[0], np.radians(LOOP_SD[1])], 3) ** 2)
    rows = np.flatnonzero(run.accepted).tolist()
    for row in rows:
        match, pose = int(run.match[row]), run.match_from_query[row]
        graph.add_edge(match, row, pose, covariance, "loop")
    solution = graph.solve()
    believed = [edge for edge in solution.believed if edge.kind == "loop"]
    false = sum(
        is_off(inverse(drive.true[edge.a]) @ drive.true[edge.b], edge.pose) for edge in believed
    )
    seconds = float(run.seconds["match"].sum())
    return Mapped(name, ate(solution.poses, drive.true), len(believed), false, seconds)


def is_off(truly: Floats, pose: Floats) -> bool:
    metres, degrees = difference(truly, pose)
    return metres > RIGHT[0] or degrees > RIGHT[1]


def compare(seed: int, folder: Path, python: Path | None) -> Iterator[Mapped]:
    """Map the town of a seed by each; peers that fail are left out, with the reason on stderr."""
    town = Town(seed, folder)
    yield map_ours(town)
    if python is None:
        return
    drive = read_drive(town)
    for given in (True, False):
        try:
            yield map_by_kiss(python, drive, given)
        except (OSError, subprocess.CalledProcessError) as error:
            note(f"without {KISS}: {last_line(error)}")
    try:
        yield from map_by_closures(python, drive)
    except (OSError, subprocess.CalledProcessError) as error:
        note(f"without MapClosures: {last_line(error)}")


def peers_text(seeds: Sequence[int]) -> str:
    listed = " ".join(map(str, seeds))
    return fill(
        f"`python -m benchmarks.accuracy.map_peers {listed}`: towns of these seeds, full "
        "circle. The same odometry is that of the tables above. KISS-SLAM as a whole, a local map "
        "each 100 m, its loops those between them. MapClosures alone makes no map: its loops, of "
        f"local maps of {JOINED} scans, joined by the same odometry, and what KISS-SLAM's closer "
        f"makes of them, go into our pose graph with {LOOP_SD[0]:g} m and {LOOP_SD[1]:g} degrees. "
        f"Loops: that count in the end. False: more than {RIGHT[0]:g} m or {RIGHT[1]:g} degrees "
        "off. Seconds of processor time of all threads for the whole drive; without joining local "
        "maps and the graph for MapClosures. Mean (lowest to highest) over the towns.",
        100,
    )


def peers_table(towns: Sequence[Sequence[Mapped]]) -> str:
    """A row for each mapper."""
    found: dict[str, list[Mapped]] = {}
    for each in (each for town in towns for each in town):
        found.setdefault(each.name, []).append(each)
    rows = [
        [
            name,
            mean_and_range(np.array([each.ate for each in some])),
            *(" ".join(str(each[k]) for each in some) for k in (2, 3)),
            " ".join(f"{each.seconds:.0f}" for each in some),
        ]
        for name, some in found.items()
    ]
    return table(["mapped by", "ATE, m", "loops", "false ones of them", "s"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", type=int, default=[1])
    arguments = parser.parse_args()
    folder = cache_folder() / "place-maps"
    folder.mkdir(parents=True, exist_ok=True)
    python = peers_python()
    towns = [list(compare(seed, folder, python)) for seed in arguments.seeds]
    print(f"{peers_text(arguments.seeds)}\n\n{peers_table(towns)}")


if __name__ == "__main__":
    main()
