# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Exports of pose graphs, read back by GTSAM and by our own readers."""

from pathlib import Path

import numpy as np
import pytest

from fusionslam import PoseGraph, Solution
from fusionslam.datasets.graph_files import GraphEdge, GraphNode, edge_of_pose, write_g2o
from fusionslam.datasets.pose_files import read_poses_kitti, read_poses_tum
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.se3 import exp
from fusionslam.mapping import export_graph

gtsam = pytest.importorskip("gtsam", exc_type=ImportError)


@pytest.fixture
def solved() -> tuple[PoseGraph, Solution]:
    """A session of five nodes with a loop, and one of two; a loop that is refused."""
    rng = np.random.default_rng(1)
    graph = PoseGraph()
    for node in range(7):
        graph.add_node()
        if node not in (0, 5):
            step = exp(np.array([1, 0.2, 0.1, 0.1, -0.2, 1.2]) + 0.01 * rng.normal(size=6))
            covariance = np.diag(rng.uniform(0.01, 0.02, 6) ** 2)
            covariance[0, 4] = covariance[4, 0] = 2e-5
            graph.add_edge(node - 1, node, step, covariance, "odometry")
    pose = np.linalg.inv(graph.solve().poses[0]) @ graph.solve().poses[4]
    graph.add_edge(0, 4, pose, np.eye(6) * 1e-4, "loop")
    graph.add_edge(4, 1, exp(np.full(6, 2.0)), np.eye(6) * 1e-4, "loop")
    return graph, graph.solve()


def test_gtsam_reads_the_graph(solved: tuple[PoseGraph, Solution], tmp_path: Path) -> None:
    graph, solution = solved
    export_graph(tmp_path, graph, solution)
    factors, values = gtsam.readG2o(str(tmp_path / "graph.g2o"), True)
    assert values.size() == 7
    for node, pose in enumerate(solution.poses):
        assert np.allclose(values.atPose3(node).matrix(), pose, atol=1e-12)
    kept = [edge for edge in graph.edges if edge.state == "believed"]
    assert factors.size() == len(kept) == len(graph.edges) - 1
    # GTSAM takes errors of the vector of the quaternion, half of the angle, for those of the angle,
    # and has rotations first.
    ours, halves = [3, 4, 5, 0, 1, 2], np.repeat([1.0, 0.5], 3)
    for k, edge in enumerate(kept):
        factor = factors.at(k)
        assert list(factor.keys()) == [edge.a, edge.b]
        assert np.allclose(factor.measured().matrix(), edge.pose, atol=1e-12)
        information = factor.noiseModel().information()[np.ix_(ours, ours)]
        found = np.linalg.inv(information) / np.outer(halves, halves)
        assert np.allclose(found, edge.covariance, rtol=1e-6, atol=1e-9)


def test_each_part_has_a_trajectory(solved: tuple[PoseGraph, Solution], tmp_path: Path) -> None:
    graph, solution = solved
    stamps = np.arange(7) * 100_000_000 + 1_700_000_000_123_456_789
    files = export_graph(tmp_path, graph, solution, stamps)
    names = ["graph", "poses", "trajectory", "poses_5", "trajectory_5"]
    assert [file.stem for file in files] == names
    fixed = [line for line in files[0].read_text().splitlines() if line.startswith("FIX")]
    assert fixed == ["FIX 0", "FIX 5"]
    for file, nodes in zip(files[1:], (slice(5), slice(5), slice(5, 7), slice(5, 7)), strict=True):
        if file.stem.startswith("poses"):
            assert np.array_equal(read_poses_kitti(file), solution.poses[nodes])
        else:
            times, poses = read_poses_tum(file)
            assert np.array_equal(times, stamps[nodes])
            assert np.allclose(poses, solution.poses[nodes], atol=1e-12)


def test_lines_are_those_of_the_published_format(tmp_path: Path) -> None:
    """VERTEX_SE2 id x y theta; EDGE_SE2 a b dx dy dtheta I11 I12 I13 I22 I23 I33, and in space."""
    path = tmp_path / "x.g2o"
    flat = GraphEdge(3, 4, [1, 2, 0.5], np.array([[4.0, 1, 2], [1, 5, 3], [2, 3, 6]]))
    quarter = exp(np.array([0, 0, 0, 0, 0, np.pi / 2]))
    space = edge_of_pose(0, 1, quarter, np.diag([0.25, 1, 1, 1, 1, 0.25]))
    write_g2o(path, [GraphNode(3, [0, 0, 1])], [flat, space], fixed=[3])
    lines = [line.split() for line in path.read_text().splitlines()]
    assert lines[:3] == [
        ["VERTEX_SE2", "3", "0", "0", "1"],
        ["FIX", "3"],
        ["EDGE_SE2", "3", "4", "1", "2", "0.5", "4", "1", "2", "5", "3", "6"],
    ]
    assert lines[3][:3] == ["EDGE_SE3:QUAT", "0", "1"]
    root = np.sqrt(0.5)
    # A variance of 1 rad^2 is one of 1/4 of the quaternion's vector.
    upper = np.diag([4.0, 1, 1, 4, 4, 16])[np.triu_indices(6)]
    assert np.allclose(np.array(lines[3][3:], float), [0, 0, 0, 0, 0, root, root, *upper])


def test_wrong_stamps_and_graphs_are_refused(
    solved: tuple[PoseGraph, Solution], tmp_path: Path
) -> None:
    graph, solution = solved
    for stamps in (np.arange(6), np.arange(7.0)):
        with pytest.raises(ShapeError) as wrong:
            export_graph(tmp_path, graph, solution, stamps)
        assert wrong.value.fields == ("stamps_ns",)
    graph.add_node(np.eye(4))
    with pytest.raises(DataError) as old:
        export_graph(tmp_path, graph, solution)
    assert old.value.code == "other-graph"
    assert list(tmp_path.iterdir()) == []
