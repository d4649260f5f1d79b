# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How well do fixes of a satellite receiver place a graph of drifting odometry? A Markdown table.

    python -m benchmarks.accuracy.satellites [--write]

A drive of 2 km through streets at 5 m/s, three times, with the simulator's receiver 1 m before and
0.5 m beside the robot's centre. Errors are those of the nodes' horizontal positions in UTM against
the truth, of ten seeds. "alone" is odometry that is placed by the truth of its first 50 m.
"""

import argparse
from typing import Any

import numpy as np
from pyproj import Transformer

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.base.arrays import Floats
from fusionslam.geometry.globe import MapOrigin, geographic
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping.config import DriftModel
from fusionslam.mapping.pose_graph import PoseGraph
from fusionslam.mapping.satellites import Position
from fusionslam.sim.gnss import simulate_gnss
from fusionslam.sim.robot import GnssMount

PAGE = ROOT / "docs" / "stages" / "mapping.md"
WORLD = MapOrigin(latitude=49.0, longitude=8.4, altitude=110.0)
SPEED = 5.0
ARM = np.array([1.0, 0.5, 1.5])
DRIFT = DriftModel()
LOOP_SD = np.array([0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
WHITE: dict[str, Any] = {"noise_m": 2.0, "multipath_m": 0.0}
HARD: dict[str, Any] = {"outliers": 0.1, "gap_every_s": 120.0}
RECEIVERS: dict[str, dict[str, Any]] = {
    "2 m of noise": WHITE,
    "and 10 % outliers of 50 m, gaps of 60 s": WHITE | HARD,
    "multipath of 2 m within 30 s, outliers, gaps": {"noise_m": 0.5, "multipath_m": 2.0} | HARD,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    rows = []
    for name, values in RECEIVERS.items():
        for loops in (False, True):
            found = np.array([drive_errors(GnssMount(**values), seed, loops) for seed in range(10)])
            cells = [f"{value:.2f}" for value in (*np.median(found, axis=0), found[:, 1].max())]
            rows.append([name, "yes" if loops else "no", *cells])
    head = ["receiver", "loops", "alone, RMSE, m", "with fixes, RMSE, m", "of the worst drive"]
    text = table(head, rows)
    print(text)
    if arguments.write:
        write_between(PAGE, "satellites", text)


def drive_errors(mount: GnssMount, seed: int, loops: bool) -> tuple[float, float]:
    """Horizontal RMSE in UTM of a drive's nodes, without and with fixes."""
    rng = np.random.default_rng(seed)
    true = streets()
    graph = drift(true, rng)
    if loops:
        lap = len(true) // 3
        for k in range(lap, len(true), 10):
            pose = inverse(true[k - lap]) @ true[k] @ exp(rng.normal(size=6) * LOOP_SD)
            graph.add_edge(k - lap, k, pose, np.diag(LOOP_SD**2), "loop")
    alone = graph.solve().poses
    graph.set_positions(measure(true, mount, rng))
    solution = graph.solve()
    assert solution.origin is not None, solution.unplaced
    known = utm(geographic(true[:, :3, 3], WORLD))
    first = slice(0, 50)
    shift = known[first] - alone[first, :2, 3]
    ends = alone[:, :2, 3] + shift.mean(axis=0)
    placed = utm(geographic(solution.poses[:, :3, 3], solution.origin))
    return rmse(ends - known), rmse(placed - known)


def streets() -> Floats:
    """A node each metre: three laps of 667 m round two blocks, over a hill."""
    turns = np.zeros(667)
    for corner, sign in ((60, 1), (190, 1), (260, 1), (330, -1), (400, 1), (470, 1), (560, 1)):
        turns[corner : corner + 10] = sign * np.pi / 20
    turns[630:650] = (2 * np.pi - turns.sum()) / 20
    heading = np.cumsum(np.tile(turns, 3))
    poses = np.tile(np.eye(4), (len(heading), 1, 1))
    cos, sin = np.cos(heading), np.sin(heading)
    poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = cos, -sin, sin, cos
    step = np.stack([cos, sin, 0 * cos], axis=1)
    gap = step.reshape(3, 667, 3).mean(axis=1)[0]  # each lap ends where it began
    poses[1:, :3, 3] = np.cumsum(step - gap, axis=0)[:-1]
    poses[:, 2, 3] = 3 * np.sin(np.arange(len(heading)) * 2 * np.pi / 667)
    return poses


def drift(true: Floats, rng: np.random.Generator) -> PoseGraph:
    """Odometry of a path, with the errors that ``DriftModel`` states."""
    graph = PoseGraph()
    graph.add_node(true[0])
    for step in inverse(true[:-1]) @ true[1:]:
        node = graph.add_node()
        covariance = DRIFT.covariance(step) + np.diag(np.repeat([1e-5, 1e-7], 3))
        moved = step @ exp(rng.multivariate_normal(np.zeros(6), covariance))
        graph.add_edge(node - 1, node, moved, covariance, "odometry")
    return graph


def measure(true: Floats, mount: GnssMount, rng: np.random.Generator) -> list[Position]:
    """Fixes of a drive, one for each node."""
    antenna = true[:, :3, 3] + true[:, :3, :3] @ ARM
    mount = mount.model_copy(update={"rate_hz": SPEED})
    track = simulate_gnss(antenna, mount, np.arange(len(true)) / SPEED, WORLD, rng)
    return [
        Position(node, ARM, track.positions[node], track.covariance)
        for node in np.flatnonzero(track.known).tolist()
    ]


def utm(places: Floats) -> Floats:
    """East and north in zone 32 of longitude and latitude."""
    return np.stack(Transformer.from_crs(4979, 32632).transform(places[:, 1], places[:, 0]), axis=1)


def rmse(errors: Floats) -> float:
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


if __name__ == "__main__":
    main()
