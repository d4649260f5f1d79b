# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What do pose graphs believe, and how long do they take? A Markdown table.

    python -m benchmarks.accuracy.pose_graphs [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names: the true path of KITTI's sequence 00, to
which noise is added. False loops come in runs of ten that agree with each other, as where a street
looks like another one. Times are those of one thread.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.accuracy.data import ROOT, data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam import PoseGraph, Solution
from fusionslam.base.arrays import Floats, Matrix
from fusionslam.datasets.pose_files import read_poses_kitti
from fusionslam.geometry.se3 import exp, inverse

PAGE = ROOT / "docs" / "stages" / "mapping.md"
LOOPS = 790
LOOP_SD = np.array([0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
ODOMETRY = {"good": (0.01, 0.0005), "rough": (0.03, 0.003)}
"""Standard deviations after one metre, in metres and radians, of each axis."""
RUN = 10


@dataclass(frozen=True)
class Drive:
    """A drive with noise: true poses, steps of odometry and loops (a, b, a_from_b)."""

    true: Floats
    steps: Floats
    sds: Floats
    loops: list[tuple[int, int, Floats]]
    false: list[tuple[int, int, Floats]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    path = read_poses_kitti(data_folder() / "kitti" / "poses" / "00.txt")
    text = "\n\n".join(make(path) for make in (graphs_table, live_table, overconfidence_table))
    print(text)
    if arguments.write:
        write_between(PAGE, "pose graphs", text)


def graphs_table(path: Floats) -> str:
    """What is believed, and the time of one solve."""
    rows = []
    for name in ODOMETRY:
        for share in (0.0, 0.5, 1.0):
            rows.append(solved_row(f"KITTI 00, {name} odometry", make_drive(path, name, share)))
    for nodes in (5_000, 50_000):
        rows.append(solved_row("laps of KITTI 00", make_drive(lengthen(path, nodes), "good", 0.0)))
    head = ["drive", "nodes", "loops", "false", "ATE of odometry, m", "ATE, m"]
    return table([*head, "true ones believed", "false ones believed", "s"], rows)


def live_table(path: Floats) -> str:
    """Times of ``update``, node after node."""
    rows = [live_row(lengthen(path, nodes)) for nodes in (5_000, 50_000)]
    head = ["nodes", "loops", "median, ms", "95 %", "99 %", "longest"]
    return table([*head, "ATE while driving, m", "solved, m"], rows)


def overconfidence_table(path: Floats) -> str:
    """What is said of odometry whose stated deviations are divided by a factor."""
    rows = []
    for name in ODOMETRY:
        for factor in (1, 3, 10):
            drive = make_drive(path, name, 0.5)
            graph = build(drive, factor)
            for loop in drive.loops + drive.false:
                add_loop(graph, *loop)
            reason = graph.solve().reason
            said = "nothing" if reason is None else f"{reason.number:.3g}"
            rows.append([name, str(factor), said])
    return table(["odometry", "deviations divided by", "said"], rows)


def solved_row(name: str, drive: Drive) -> list[str]:
    graph = build(drive)
    odometry = graph.solve().poses
    for loop in drive.loops + drive.false:
        add_loop(graph, *loop)
    started = time.process_time()
    solution = graph.solve()
    seconds = time.process_time() - started
    right, wrong = believed(drive, solution)
    counts = [str(len(drive.true)), str(len(drive.loops)), str(len(drive.false))]
    ates = [f"{ate(poses, drive.true):.3g}" for poses in (odometry, solution.poses)]
    share = f"{right / len(drive.loops):.4f}"
    return [name, *counts, *ates, share, str(wrong), f"{seconds:.2f}"]


def live_row(path: Floats) -> list[str]:
    """Drive the path node by node; every sixth node or so closes a loop."""
    drive = make_drive(path, "good", 0.0, len(path) * LOOPS // 4541)
    arriving = {b: (a, pose) for a, b, pose in drive.loops}
    graph = PoseGraph()
    graph.add_node(drive.true[0])
    graph.update()
    seconds = []
    for step, sd in zip(drive.steps, drive.sds, strict=True):
        started = time.process_time()
        node = graph.add_node()
        graph.add_edge(node - 1, node, step, np.diag(sd**2), "odometry")
        if node in arriving:
            a, pose = arriving[node]
            add_loop(graph, a, node, pose)
        graph.update()
        seconds.append(time.process_time() - started)
    p50, p95, p99, most = np.percentile(seconds, [50, 95, 99, 100]) * 1000
    times = [f"{value:.1f}" for value in (p50, p95, p99, most)]
    live = ate(graph.poses, drive.true)
    ates = [f"{value:.3g}" for value in (live, ate(graph.solve().poses, drive.true))]
    return [str(len(path)), str(len(drive.loops)), *times, *ates]


def believed(drive: Drive, solution: Solution) -> tuple[int, int]:
    """Numbers of true and false loops that are believed."""
    first = len(drive.true) - 1 + len(drive.loops)
    wrong = sum(edge.number >= first for edge in solution.believed)
    return len(solution.believed) - wrong, wrong


def build(drive: Drive, overconfidence: float = 1.0) -> PoseGraph:
    """The odometry of a drive; its stated deviations are divided by ``overconfidence``."""
    graph = PoseGraph()
    graph.add_node(drive.true[0])
    for step, sd in zip(drive.steps, drive.sds, strict=True):
        node = graph.add_node()
        graph.add_edge(node - 1, node, step, np.diag((sd / overconfidence) ** 2), "odometry")
    return graph


def add_loop(graph: PoseGraph, a: int, b: int, pose: Floats) -> None:
    graph.add_edge(a, b, pose, np.diag(LOOP_SD**2), "loop")


def make_drive(
    path: Floats, odometry: str, false: float, loops_wanted: int = LOOPS, seed: int = 0
) -> Drive:
    """Add noise to a path, find its loops, and make up ``false`` times as many false ones."""
    rng = np.random.default_rng(seed)
    steps = inverse(path[:-1]) @ path[1:]
    metres = np.maximum(np.linalg.norm(steps[:, :3, 3], axis=1), 0.01)
    sds = np.repeat(ODOMETRY[odometry], 3) * np.sqrt(metres)[:, None]
    steps = steps @ exp(rng.normal(size=sds.shape) * sds)
    pairs = find_revisits(path)
    spread = np.unique(np.linspace(0, len(pairs) - 1, loops_wanted).astype(int))
    loops = [(a, b, inverse(path[a]) @ path[b] @ _noise(rng)) for a, b in pairs[spread].tolist()]
    invented = list(invent_loops(path, round(false * len(loops)), rng))
    return Drive(path, steps, sds, loops, invented)


def find_revisits(path: Floats) -> Floats:
    """int64 (n, 2): nodes within 5 m of an earlier one, driven 100 nodes before at least."""
    places = path[:, :3, 3]
    pairs = []
    for b, near in enumerate(cKDTree(places).query_ball_point(places, 5.0)):
        earlier = np.array([a for a in near if a < b - 100], np.int64)
        if earlier.size:
            pairs.append((earlier[np.linalg.norm(places[earlier] - places[b], axis=1).argmin()], b))
    return np.array(pairs)


def lengthen(path: Floats, nodes: int) -> Floats:
    """A path of so many nodes: laps, each beside the last one."""
    laps = -(-nodes // len(path))
    aside = exp(np.array([0.5, 0, 0, 0, 0, 0]))
    lap, moved = path, [path]
    for _ in range(laps - 1):
        lap = aside @ lap
        moved.append(lap)
    return np.concatenate(moved)[:nodes]


def ate(poses: Floats, true: Floats) -> float:
    """Root mean square of the distances, aligned by the best rigid motion."""
    aligned = fit_motion(poses, true) @ poses
    return float(np.sqrt((np.linalg.norm((aligned - true)[:, :3, 3], axis=1) ** 2).mean()))


def fit_motion(poses: Floats, true: Floats) -> Matrix:
    """Rigid motion, float64 (4, 4), that brings positions to the true ones (Kabsch 1976)."""
    here, there = poses[:, :3, 3], true[:, :3, 3]
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    motion = np.eye(4)
    motion[:3, :3] = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    motion[:3, 3] = there.mean(axis=0) - motion[:3, :3] @ here.mean(axis=0)
    return motion


def invent_loops(
    path: Floats,
    count: int,
    rng: np.random.Generator,
    *,
    run: int = RUN,
    apart: float = 20.0,
    between: int = 100,
) -> Iterator[tuple[int, int, Floats]]:
    """Runs of loops from a stretch of the path to another that agree.

    Args:
        path: float64 (n, 4, 4), true.
        count: of all loops.
        rng: decides which.
        run: loops that agree.
        apart, between: metres and nodes between both stretches, at least.
    """
    made = 0
    while made < count:
        a, b = sorted(rng.integers(0, len(path) - run, 2).tolist())
        if np.linalg.norm(path[a, :3, 3] - path[b, :3, 3]) < apart or b - a < between:
            continue
        first = _noise(rng)
        for k in range(min(run, count - made)):
            # As if the first nodes of both stretches were one place.
            along = inverse(path[a + k]) @ path[a] @ first @ inverse(path[b]) @ path[b + k]
            yield a + k, b + k, along @ _noise(rng)
            made += 1


def _noise(rng: np.random.Generator) -> Floats:
    return exp(rng.normal(size=6) * LOOP_SD)


if __name__ == "__main__":
    main()
