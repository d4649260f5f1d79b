# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Exports solved pose graphs to standard formats: g2o, TUM, KITTI."""

from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.base.files import PathLike
from fusionslam.datasets.graph_files import edge_of_pose, node_of_pose, write_g2o
from fusionslam.datasets.pose_files import write_poses_kitti, write_poses_tum
from fusionslam.errors import DataError, ShapeError
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.pose_graph import PoseGraph, Solution


@checked
def export_graph(
    folder: PathLike, graph: PoseGraph, solution: Solution, stamps_ns: Any = None
) -> list[Path]:
    """Write a solved graph into a folder.

    ``graph.g2o`` has all nodes and the edges that are believed; the first node of each part is
    fixed. Parts that are not connected have trajectories of their own: ``trajectory.txt`` (TUM, if
    there are stamps) and ``poses.txt`` (KITTI) are those of the part of node 0, and
    ``trajectory_17.txt`` and ``poses_17.txt`` those of the part that begins with node 17.

    Args:
        folder: made if it does not exist.
        graph: the graph.
        solution: its last one.
        stamps_ns: int64 (n), of the nodes; None for no trajectories in TUM format.

    Returns:
        The files.

    Raises:
        ShapeError: there is not one stamp for each node (field "stamps_ns").
        DataError: the solution is of another graph, or has fewer nodes than this one (code
            "other-graph"); or a file cannot be written.
    """
    count = len(solution.poses)
    if count != len(graph):
        raise DataError(
            f"the solution has {count} nodes, the graph {len(graph)}: solve it again",
            code="other-graph",
            fields=("solution", str(count), str(len(graph))),
        )
    stamps = None if stamps_ns is None else np.asarray(stamps_ns)
    if stamps is not None and (stamps.shape != (count,) or stamps.dtype.kind not in "iu"):
        raise ShapeError(
            f"stamps_ns has shape {stamps.shape} and dtype {stamps.dtype}, expected int64 "
            f"({count},)",
            fields=("stamps_ns",),
        )
    base = Path(folder)
    edges = [edge for edge in graph.edges if edge.state == "believed"]
    first = np.unique(solution.parts).tolist()
    files = [base / "graph.g2o"]
    write_g2o(
        files[0],
        [node_of_pose(node, pose) for node, pose in enumerate(solution.poses)],
        [edge_of_pose(edge.a, edge.b, edge.pose, edge.covariance) for edge in edges],
        fixed=first,
    )
    for node in first:
        members = np.flatnonzero(solution.parts == node)
        name = f"_{node}" if node else ""
        files.append(base / f"poses{name}.txt")
        write_poses_kitti(files[-1], solution.poses[members])
        if stamps is not None:
            files.append(base / f"trajectory{name}.txt")
            write_poses_tum(files[-1], stamps[members], solution.poses[members])
    return files


def write_map_graph(path: PathLike, content: MapContent) -> None:
    """Write the first part of a map as g2o: keyframes by their numbers, the first one fixed.

    Poses are map_from_cloud. Edges are odometry, and what is believed of loops and steps.

    Raises:
        DataError: the file cannot be written.
    """
    numbers = content.first_part()
    poses, members = content.poses_of(numbers), {*numbers}
    write_g2o(
        path,
        [node_of_pose(number, pose) for number, pose in zip(numbers, poses, strict=True)],
        [
            edge_of_pose(edge.a, edge.b, edge.pose, edge.covariance)
            for edge in content.edges.values()
            if edge.state == "believed" and {edge.a, edge.b} <= members
        ],
        fixed=numbers[:1],
    )
