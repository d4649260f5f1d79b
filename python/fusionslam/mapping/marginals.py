# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How sure the graph of a map is of the poses of its keyframes."""

from dataclasses import replace

import numpy as np

from fusionslam.base.arrays import Floats, Integers
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.gtsam_extra import Uncertainty
from fusionslam.mapping.map_content import MapContent


def measure_uncertainty(content: MapContent) -> tuple[list[Edge], Uncertainty]:
    """Return the believed edges within parts, between rows, and what errors they leave.

    Fixes of satellites do not count.

    Raises:
        FusionSlamError: GTSAM is not installed (code "missing-extra"), or the edges do not
            determine the poses in float64 ("not-solvable"), as of 50,000 keyframes without a loop.
    """
    row = content.row
    edges = [
        replace(edge, a=row[edge.a], b=row[edge.b])
        for edge in content.edges.values()
        if edge.state == "believed" and content.part(edge.a) == content.part(edge.b)
    ]
    return edges, Uncertainty(content.poses, edges, _first_rows(content))


def keyframe_covariances(content: MapContent) -> Floats:
    """Marginal covariances of the poses of a map's keyframes, by the edges that are believed.

    That of the first keyframe of each part is zero: the others are against it. They are as good as
    the covariances of the edges.

    Returns:
        float64 (n, 6, 6), in the rows of ``content.keyframes``: x, y, z in metres, rotations about
        x, y, z in radians, as small motions in the frame of the cloud.

    Raises:
        FusionSlamError: as of ``measure_uncertainty``.
    """
    _, errors = measure_uncertainty(content)
    covariances = np.array([errors.covariance(row) for row in range(len(content.poses))])
    covariances[_first_rows(content)] = 0
    return covariances


def _first_rows(content: MapContent) -> Integers:
    return np.unique([content.row[part] for part in content.parts])
