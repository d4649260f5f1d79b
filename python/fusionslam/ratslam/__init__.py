# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""RatSLAM: from place ids and odometry to a map (Milford & Wyeth 2004, Ball et al. 2013).

cells = PoseCells(preset="openratslam")    # where the robot is, as activity on a wrapped sheet
graph = ExperienceMap(preset="openratslam")
cells.on_view(0)                           # a view, by its id
cells.on_odometry(v, w, dt)
graph.on_odometry(v, w, dt)
graph.apply(cells.action())                # nodes and links
graph.relax()
"""

from fusionslam._core import ActionKind
from fusionslam.geometry.odometry_calibration import LoopCheck
from fusionslam.ratslam.attractor import Place
from fusionslam.ratslam.event_order import OrderConfig, StampOrder
from fusionslam.ratslam.events import Look, Motion, Sighting
from fusionslam.ratslam.experience_map import (
    Action,
    ExperienceMap,
    ExperienceMapConfig,
    Relaxation,
    Route,
)
from fusionslam.ratslam.external_views import GivenView, GivenViews
from fusionslam.ratslam.map_snapshot import LiveMap
from fusionslam.ratslam.online import OnlineRatSlam, OnlineRatSlamConfig
from fusionslam.ratslam.pose_cells import PoseCells, PoseCellsConfig
from fusionslam.ratslam.slam import RatSlam, RatSlamConfig, Step
from fusionslam.ratslam.view_sources import MatcherSource, TemplateSource, ViewSource
from fusionslam.ratslam.visual_odometry import VisualOdometry, VisualOdometryConfig, VisualSpeed

__all__ = [
    "Action",
    "ActionKind",
    "ExperienceMap",
    "ExperienceMapConfig",
    "GivenView",
    "GivenViews",
    "LiveMap",
    "Look",
    "LoopCheck",
    "MatcherSource",
    "Motion",
    "OnlineRatSlam",
    "OnlineRatSlamConfig",
    "OrderConfig",
    "Place",
    "PoseCells",
    "PoseCellsConfig",
    "RatSlam",
    "RatSlamConfig",
    "Relaxation",
    "Route",
    "Sighting",
    "StampOrder",
    "Step",
    "TemplateSource",
    "ViewSource",
    "VisualOdometry",
    "VisualOdometryConfig",
    "VisualSpeed",
]
