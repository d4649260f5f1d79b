# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How sure the graph of a map is of the poses of its keyframes."""

from dataclasses import replace

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.mapping.gtsam_extra import Solver
from fusionslam.mapping.map_content import MapContent


def keyframe_covariances(content: MapContent) -> Floats:
    """Marginal covariances of the poses of a map's keyframes, by the edges that are believed.

    That of the first keyframe of each part is zero: the others are against it. They are as good as
    the covariances of the edges. Fixes of satellites do not count.

    Returns:
        float64 (n, 6, 6), in the rows of ``content.keyframes``: x, y, z in metres, rotations about
        x, y, z in radians, as small motions in the frame of the cloud.

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
    first = np.unique([row[part] for part in content.parts])
    covariances = Solver(content.poses, edges, first).covariances()
    covariances[first] = 0
    return covariances
