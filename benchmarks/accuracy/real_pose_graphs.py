# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which loops of recorded robots are believed, and how near to the optimum are poses?

    python -m benchmarks.accuracy.real_pose_graphs [--write]

Needs the pose graphs among the test data, which FUSIONSLAM_TEST_DATA names: wheel odometry of
Bicocca 25b with loops of a bag of words, many of them false; KITTI with right loops, to which false
ones are added; and graphs without truth, beside GTSAM's solution of all edges.
"""

import argparse
import gzip
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import gtsam
import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from benchmarks.accuracy.data import ROOT, data_folder
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.pose_graphs import ate, invent_loops
from fusionslam import PoseGraph, Solution
from fusionslam.base.arrays import Floats, Integers, Matrix
from fusionslam.datasets.pose_files import read_poses_kitti
from fusionslam.geometry.se3 import inverse, motion_size

PAGE = ROOT / "docs" / "stages" / "mapping.md"
THRESHOLDS = ("0.000", "0.100", "0.250", "0.500")
KITTI = ("00", "02", "05", "06", "07", "09")
SHARES = (0.0, 0.5, 1.0)
WITHOUT_TRUTH = ("parking-garage", "input_MITb_g2o", "CSAIL")
RIGHT = (3.0, 30.0)
"""Metres and degrees off the truth, at most, of right loops of Bicocca."""
RIGHT_OF_KITTI = (4.0, 30.0)
"""Its loops are right; the worst is off by 3.7 m."""
OUT_OF_PLANE = 1e-3
"""Standard deviation of height (m) and tilt (rad) of edges that are measured in the plane."""
_OURS = np.array([3, 4, 5, 0, 1, 2])  # GTSAM's small motions are rotations first


class Measured(NamedTuple):
    """An edge of a file: a_from_b, covariance as of ``Edge``."""

    a: int
    b: int
    pose: Matrix
    covariance: Floats


class Recorded(NamedTuple):
    """A pose graph: number of nodes, odometry that connects all of them, and the other edges."""

    nodes: int
    odometry: list[Measured]
    loops: list[Measured]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the tables into the docs")
    arguments = parser.parse_args()
    folder = data_folder() / "real" / "pose_graphs"
    head = ["graph", "nodes", "right loops", "false", "ATE of odometry, m", "ATE, m"]
    believed = [*bicocca_rows(folder), *kitti_rows(folder)]
    text = table([*head, "right ones believed", "false ones believed", "s"], believed)
    head = ["graph", "nodes", "loops", "believed", "chi square, of GTSAM's", "s"]
    text += "\n\n" + table(head, [optimum_row(folder, name) for name in WITHOUT_TRUTH])
    print(text)
    if arguments.write:
        write_between(PAGE, "real pose graphs", text)


def bicocca_rows(folder: Path) -> Iterator[list[str]]:
    """Wheel odometry, and loops above a threshold of a bag of words."""
    stamps = np.loadtxt(folder / "B25b_timestamps.txt.gz")
    true = np.loadtxt(folder / "Bicocca_2009-02-25b-GT-extended.csv.gz", delimiter=",")
    heading = np.unwrap(true[:, 3])
    columns = [np.interp(stamps, true[:, 0], each) for each in (true[:, 1], true[:, 2], heading)]
    for threshold in THRESHOLDS:
        recorded = read_graph(folder / f"bicocca25b_{threshold}.g2o.gz")
        path = np.array([lift(gtsam.Pose2(*pose)) for pose in zip(*columns, strict=True)])[
            : recorded.nodes
        ]
        yield judged_row(f"Bicocca 25b, above {float(threshold):g}", recorded, path, RIGHT)


def kitti_rows(folder: Path) -> Iterator[list[str]]:
    """Recorded odometry and loops, and made false ones in runs of ten that agree."""
    for name in KITTI:
        recorded = read_graph(folder / f"kitti_{name}.g2o.gz")
        camera = read_poses_kitti(data_folder() / "kitti" / "poses" / f"{name}.txt")
        path = camera[: recorded.nodes] @ _UP
        for share in SHARES:
            rng = np.random.default_rng(int(name))
            covariance = recorded.loops[0].covariance
            invented = [
                Measured(a, b, pose, covariance)
                for a, b, pose in invent_loops(path, round(share * len(recorded.loops)), rng)
            ]
            loops = recorded.loops + invented
            yield judged_row(f"KITTI {name}", recorded._replace(loops=loops), path, RIGHT_OF_KITTI)


_UP = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
"""Camera from body: x ahead, z up."""


def judged_row(
    name: str, recorded: Recorded, path: Floats, limits: tuple[float, float]
) -> list[str]:
    odometry, _ = solve(recorded._replace(loops=[]))
    solution, seconds = solve(recorded)
    ends = np.array([[each.a, each.b] for each in recorded.loops])
    off = inverse(np.array([each.pose for each in recorded.loops])) @ (
        inverse(path[ends[:, 0]]) @ path[ends[:, 1]]
    )
    right = np.array([np.all(np.array(motion_size(each)) <= limits) for each in off])
    trusted = believed_loops(recorded, solution)
    counts = [str(recorded.nodes), str(right.sum()), str((~right).sum())]
    ates = [f"{ate(poses, path):.3g}" for poses in (odometry.poses, solution.poses)]
    shown = [str((trusted & right).sum()), str((trusted & ~right).sum())]
    return [name, *counts, *ates, *shown, f"{seconds:.2f}"]


def optimum_row(folder: Path, name: str) -> list[str]:
    """The error of our poses beside that of GTSAM's best poses for all edges that we believe."""
    recorded = read_graph(folder / f"{name}.g2o.gz")
    solution, seconds = solve(recorded)
    trusted = believed_loops(recorded, solution)
    kept = [each for each, is_kept in zip(recorded.loops, trusted, strict=True) if is_kept]
    graph = gtsam.NonlinearFactorGraph()
    values = gtsam.Values()
    for each in recorded.odometry + kept:
        noise = gtsam.noiseModel.Gaussian.Covariance(each.covariance[np.ix_(_OURS, _OURS)])
        graph.add(gtsam.BetweenFactorPose3(each.a, each.b, gtsam.Pose3(each.pose), noise))
    for node, pose in enumerate(solution.poses):
        values.insert(node, gtsam.Pose3(pose))
    hold = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(solution.poses[0]), hold))
    initial = gtsam.InitializePose3.initialize(graph)  # from the edges alone, not from our poses
    best = gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
    ratio = graph.error(values) / graph.error(best)
    counts = [str(recorded.nodes), str(len(recorded.loops)), str(len(kept))]
    shown = name.removeprefix("input_").removesuffix("_g2o")
    return [shown, *counts, f"{ratio:.4f}", f"{seconds:.2f}"]


def solve(recorded: Recorded) -> tuple[Solution, float]:
    """The solution, and the processor time that it took, seconds."""
    graph = PoseGraph()
    for _ in range(recorded.nodes):
        graph.add_node()
    for each in recorded.odometry:
        graph.add_edge(*each, "odometry")
    for each in recorded.loops:
        graph.add_edge(*each, "loop")
    started = time.process_time()
    return graph.solve(), time.process_time() - started


def believed_loops(recorded: Recorded, solution: Solution) -> Integers:
    """Of each loop, whether it is believed: bool (n,)."""
    first = len(recorded.odometry)
    trusted = np.zeros(len(recorded.loops), bool)
    trusted[[edge.number - first for edge in solution.believed]] = True
    return trusted


def read_graph(path: Path) -> Recorded:
    """Read a g2o file by GTSAM; edges of the plane are lifted into space.

    Odometry is the tree of the shortest edges by numbers of nodes (Kruskal 1956).
    """
    with tempfile.NamedTemporaryFile("w+", suffix=".g2o") as file:
        text = gzip.decompress(path.read_bytes()).decode()
        file.write(text)
        file.flush()
        is_spatial = "EDGE_SE3" in text
        graph, _ = gtsam.readG2o(file.name, is_spatial)
    edges = []
    for k in range(graph.size()):
        factor: Any = graph.at(k)
        a, b = factor.keys()
        covariance = factor.noiseModel().covariance()
        if is_spatial:
            pose = factor.measured().matrix()
            covariance = covariance[np.ix_(_OURS, _OURS)]
        else:
            pose, planar = lift(factor.measured()), covariance
            covariance = np.eye(6) * OUT_OF_PLANE**2
            covariance[np.ix_([0, 1, 5], [0, 1, 5])] = planar
        edges.append(Measured(a, b, pose, covariance))
    edges.sort(key=lambda each: (abs(each.a - each.b), max(each.a, each.b)))
    nodes = DisjointSet(range(1 + max(max(each.a, each.b) for each in edges)))
    odometry: list[Measured] = []
    loops: list[Measured] = []
    for each in edges:
        (odometry if nodes.merge(each.a, each.b) else loops).append(each)
    odometry.sort(key=lambda each: max(each.a, each.b))
    return Recorded(len(nodes), odometry, loops)


def lift(pose: gtsam.Pose2) -> Matrix:
    matrix: Matrix = gtsam.Pose3(pose).matrix()
    return matrix


if __name__ == "__main__":
    main()
