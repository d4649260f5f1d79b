# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How good is a descriptor at telling revisited places, and what does it cost?

    curve = precision_recall(descriptors, positions, protocol="revisit", radius=10.0)
    print(curve)
    curve.save("curve.json")

``Evaluation`` joins such curves with what the run cost; the report shows them.

    print(judge_views(ids, poses, stamps))

judges the view ids of a place recognition that stores scenes as it goes, ``RunningViews`` does so
while the robot drives, and

    print(judge_map(run))

the map that RatSLAM made of them.
"""

from fusionslam.evaluation.costs import Costs, StageCost, summarise_costs
from fusionslam.evaluation.curve import PrecisionRecall
from fusionslam.evaluation.judgement import Evaluation, evaluate
from fusionslam.evaluation.map_report import MapReport, PoseErrors
from fusionslam.evaluation.maps import judge_map, pose_errors
from fusionslam.evaluation.matches import Matches, find_matches
from fusionslam.evaluation.protocols import (
    COMMON_RULES,
    PROTOCOLS,
    EvaluationConfig,
    Protocol,
    protocol_named,
)
from fusionslam.evaluation.published import CITATION, kitti_sequence, published_figures
from fusionslam.evaluation.rigid import RigidMotion, fit_rigid
from fusionslam.evaluation.running_views import JudgedView, RunningViews
from fusionslam.evaluation.runs import DescriptorRun
from fusionslam.evaluation.sweep import RANKS, evaluate_matches, precision_recall
from fusionslam.evaluation.view_baselines import always_new, baselines, every_kth
from fusionslam.evaluation.view_curve import (
    THRESHOLDS,
    ViewCurve,
    ids_from_pairs,
    sweep_pairs,
    sweep_views,
)
from fusionslam.evaluation.view_published import (
    PUBLISHED_VIEWS,
    RERUN_CITATION,
    RERUN_DESCRIPTORS,
    RERUN_VIEWS,
    VIEW_CITATION,
    PublishedViews,
    RerunDescriptor,
    RerunViews,
    published_views,
    rerun_descriptors,
    rerun_views,
)
from fusionslam.evaluation.view_report import ViewReport
from fusionslam.evaluation.view_rules import VIEW_RULES, ViewRule
from fusionslam.evaluation.view_runs import ViewRun
from fusionslam.evaluation.views import ViewJudge, judge_views
from fusionslam.evaluation.visits import DIRECTIONS, Visit, visits

__all__ = [
    "CITATION",
    "COMMON_RULES",
    "DIRECTIONS",
    "PROTOCOLS",
    "PUBLISHED_VIEWS",
    "RANKS",
    "RERUN_CITATION",
    "RERUN_DESCRIPTORS",
    "RERUN_VIEWS",
    "THRESHOLDS",
    "VIEW_CITATION",
    "VIEW_RULES",
    "Costs",
    "DescriptorRun",
    "Evaluation",
    "EvaluationConfig",
    "JudgedView",
    "MapReport",
    "Matches",
    "PoseErrors",
    "PrecisionRecall",
    "Protocol",
    "PublishedViews",
    "RerunDescriptor",
    "RerunViews",
    "RigidMotion",
    "RunningViews",
    "StageCost",
    "ViewCurve",
    "ViewJudge",
    "ViewReport",
    "ViewRule",
    "ViewRun",
    "Visit",
    "always_new",
    "baselines",
    "evaluate",
    "evaluate_matches",
    "every_kth",
    "find_matches",
    "fit_rigid",
    "ids_from_pairs",
    "judge_map",
    "judge_views",
    "kitti_sequence",
    "pose_errors",
    "precision_recall",
    "protocol_named",
    "published_figures",
    "published_views",
    "rerun_descriptors",
    "rerun_views",
    "summarise_costs",
    "sweep_pairs",
    "sweep_views",
    "visits",
]
