# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluate descriptors, view ids and maps against ground truth.

    curve = precision_recall(descriptors, positions, protocol="revisit", radius=10.0)
    print(curve)
    curve.save("curve.json")

``Evaluation`` joins such curves with the cost of the run; the report shows them.

    print(judge_views(ids, poses, stamps))

judges the view ids of a place recognition that stores scenes as it goes. ``RunningViews`` does the
same while the robot drives.

    print(judge_map(run))

judges the map that RatSLAM made from them.
"""

from fusionslam.evaluation.loops.descriptor_run import DescriptorRun
from fusionslam.evaluation.loops.evaluation import (
    AcceptedLoops,
    Costs,
    DirectionFigures,
    Evaluation,
    StageCost,
    evaluate,
    evaluate_verified,
    summarise_costs,
)
from fusionslam.evaluation.loops.judge import evaluate_matches, precision_recall
from fusionslam.evaluation.loops.nearest_matches import Matches, find_matches
from fusionslam.evaluation.loops.pairs import Pairs, evaluate_pairs, sample_pairs
from fusionslam.evaluation.loops.precision_recall import RANKS, PrecisionRecall
from fusionslam.evaluation.loops.protocols import (
    COMMON_RULES,
    PROTOCOLS,
    USUAL_PROTOCOLS,
    EvaluationConfig,
    PairRule,
    Protocol,
    find_protocol,
)
from fusionslam.evaluation.loops.published import (
    CITATION,
    PEERS,
    PeerFigures,
    kitti_sequence,
    peer_figures,
    published_figures,
)
from fusionslam.evaluation.loops.revisits import DIRECTIONS, Visit, visits
from fusionslam.evaluation.loops.verified_run import REJECTED, LoopRun, VerifiedRun
from fusionslam.evaluation.maps.judge import judge_map, pose_errors, trajectory_error
from fusionslam.evaluation.maps.report import MapReport, PoseErrors
from fusionslam.evaluation.maps.run import REFUSED, RatSlamRun
from fusionslam.evaluation.views.curve import (
    THRESHOLDS,
    ViewCurve,
    ids_from_pairs,
    sweep_pairs,
    sweep_views,
)
from fusionslam.evaluation.views.judge import (
    ViewJudge,
    always_new,
    baselines,
    every_kth,
    judge_views,
)
from fusionslam.evaluation.views.online import JudgedView, RunningViews
from fusionslam.evaluation.views.published import (
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
from fusionslam.evaluation.views.report import ViewReport
from fusionslam.evaluation.views.rules import VIEW_RULES, ViewRule
from fusionslam.evaluation.views.run import ViewRun

__all__ = [
    "CITATION",
    "COMMON_RULES",
    "DIRECTIONS",
    "PEERS",
    "PROTOCOLS",
    "PUBLISHED_VIEWS",
    "RANKS",
    "REFUSED",
    "REJECTED",
    "RERUN_CITATION",
    "RERUN_DESCRIPTORS",
    "RERUN_VIEWS",
    "THRESHOLDS",
    "USUAL_PROTOCOLS",
    "VIEW_CITATION",
    "VIEW_RULES",
    "AcceptedLoops",
    "Costs",
    "DescriptorRun",
    "DirectionFigures",
    "Evaluation",
    "EvaluationConfig",
    "JudgedView",
    "LoopRun",
    "MapReport",
    "Matches",
    "PairRule",
    "Pairs",
    "PeerFigures",
    "PoseErrors",
    "PrecisionRecall",
    "Protocol",
    "PublishedViews",
    "RatSlamRun",
    "RerunDescriptor",
    "RerunViews",
    "RunningViews",
    "StageCost",
    "VerifiedRun",
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
    "evaluate_pairs",
    "evaluate_verified",
    "every_kth",
    "find_matches",
    "find_protocol",
    "ids_from_pairs",
    "judge_map",
    "judge_views",
    "kitti_sequence",
    "peer_figures",
    "pose_errors",
    "precision_recall",
    "published_figures",
    "published_views",
    "rerun_descriptors",
    "rerun_views",
    "sample_pairs",
    "summarise_costs",
    "sweep_pairs",
    "sweep_views",
    "trajectory_error",
    "visits",
]
