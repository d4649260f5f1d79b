# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps made of the poses that loops prove."""

from fusionslam.mapping.config import DriftModel, MapConfig
from fusionslam.mapping.corrections import Correction, Corrections
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.graph_export import export_graph
from fusionslam.mapping.localization import Localization
from fusionslam.mapping.map_writer import MapStep
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.mapping.pose_graph import PoseGraph, Solution, Update
from fusionslam.mapping.quality import MapQuality, judge_map

__all__ = [
    "Correction",
    "Corrections",
    "DriftModel",
    "Edge",
    "Localization",
    "MapConfig",
    "MapQuality",
    "MapStep",
    "PlaceMap",
    "PoseGraph",
    "Solution",
    "Update",
    "export_graph",
    "judge_map",
]
