# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps made of the poses that loops prove."""

from fusionslam.mapping.edge import Edge
from fusionslam.mapping.pose_graph import PoseGraph, Solution

__all__ = ["Edge", "PoseGraph", "Solution"]
