# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Writes pose graphs for optimisers: the g2o format, in the plane and in space."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.base.files import PathLike, write_file

_TAGS = {3: "SE2", 7: "SE3:QUAT"}
# Errors of rotation are those of the vector of a quaternion: half of the angle.
_HALVES = np.repeat([1.0, 0.5], 3)


class GraphNode(NamedTuple):
    """A node: x, y in metres and heading in radians, or x, y, z and a quaternion x, y, z, w."""

    number: int
    values: Sequence[float] | Floats


class GraphEdge(NamedTuple):
    """A measured pose of node b in the frame of node a.

    Attributes:
        a, b: numbers of the nodes.
        values: as those of nodes.
        information: float64 (3, 3) of x, y and heading, or (6, 6) of x, y, z and the vector of the
            quaternion, in the frame of b.
    """

    a: int
    b: int
    values: Sequence[float] | Floats
    information: Floats


def node_of_pose(number: int, pose: Matrix) -> GraphNode:
    """A node in space with a pose, float64 (4, 4)."""
    return GraphNode(number, _values(pose))


def edge_of_pose(a: int, b: int, pose: Matrix, covariance: Floats) -> GraphEdge:
    """An edge in space of a_from_b, float64 (4, 4), and its covariance as in ``Registration``."""
    information = np.linalg.inv(covariance) / _HALVES / _HALVES[:, None]
    return GraphEdge(a, b, _values(pose), information)


def write_g2o(
    path: PathLike,
    nodes: Iterable[GraphNode],
    edges: Iterable[GraphEdge],
    fixed: Iterable[int] = (),
) -> None:
    """Write VERTEX, FIX and EDGE lines, with all digits.

    Raises:
        DataError: the file cannot be written.
    """
    lines = [f"VERTEX_{_tag(node.values)} {node.number} {_text(node.values)}" for node in nodes]
    lines += [f"FIX {number}" for number in fixed]
    for edge in edges:
        upper = edge.information[np.triu_indices(len(edge.information))]
        numbers = f"{_text(edge.values)} {_text(upper)}"
        lines.append(f"EDGE_{_tag(edge.values)} {edge.a} {edge.b} {numbers}")
    write_file(path, "".join(line + "\n" for line in lines))


def _values(pose: Matrix) -> Floats:
    turn = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return np.concatenate([pose[:3, 3], turn])


def _tag(values: Sequence[float] | Floats) -> str:
    return _TAGS[len(values)]


def _text(values: Sequence[float] | Floats) -> str:
    return " ".join(f"{value:.17g}" for value in values)
