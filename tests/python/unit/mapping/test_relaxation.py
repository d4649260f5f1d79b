# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""RatSLAM's relaxation against GTSAM's optimum of the same graph in the plane."""

import numpy as np
import pytest

from fusionslam.ratslam import Action, ActionKind, ExperienceMap
from fusionslam.ratslam.map_export import link_offsets

gtsam = pytest.importorskip("gtsam", exc_type=ImportError)


@pytest.mark.parametrize("seed", range(3))
def test_relaxation_finds_gtsams_optimum(seed: int) -> None:
    """Three laps of a noisy circle; loops close each place of the later ones with the first.

    GTSAM's error is the logarithm of a pose, RatSLAM's the pose itself: they differ by a part of
    the rotation's error, so that errors must be small.
    """
    rng = np.random.default_rng(seed)
    graph = ExperienceMap(outlier=1e6, sigmas=1e6, tolerance=1e-9)
    lap = 30
    graph.apply(Action(ActionKind.CREATE_NODE))
    for node in range(1, 3 * lap):
        turn = 2 * np.pi / lap + rng.normal() * 0.01
        graph.on_odometry(1.0 + rng.normal() * 0.05, turn, 1.0)
        graph.apply(Action(ActionKind.CREATE_NODE, node - 1, node))
        if node >= lap and node % 3 == 0:
            place = tuple(rng.normal(size=2) * 0.05)
            graph.apply(
                Action(ActionKind.CREATE_EDGE, node, node % lap, rng.normal() * 0.01, place)
            )
            graph.apply(Action(ActionKind.CREATE_EDGE, node % lap, node, 0.0, (0.0, 0.0)))
    for _ in range(20):
        graph.relax(whole=True)
    theirs, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    fixed = gtsam.noiseModel.Isotropic.Sigma(3, 1e-8)
    theirs.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*graph.nodes[0]), fixed))
    for node, pose in enumerate(graph.nodes):
        values.insert(node, gtsam.Pose2(*pose))
    for link, way in zip(graph.links, link_offsets(graph.links), strict=True):
        sds = np.array([link["sd_m"], link["sd_m"], link["sd_rad"]])
        noise = gtsam.noiseModel.Diagonal.Sigmas(sds)
        ends = int(link["source"]), int(link["target"])
        theirs.add(gtsam.BetweenFactorPose2(*ends, gtsam.Pose2(*way), noise))
    moved = gtsam.Values(values)
    for node in range(len(graph.nodes)):
        noisy = graph.nodes[node] + rng.normal(size=3) * 0.05 * (node > 0)
        moved.update(node, gtsam.Pose2(*noisy))
    exact = gtsam.LevenbergMarquardtParams()
    exact.setRelativeErrorTol(1e-14)
    exact.setAbsoluteErrorTol(1e-14)
    best = gtsam.LevenbergMarquardtOptimizer(theirs, moved, exact).optimize()
    found = gtsam.utilities.extractPose2(best)
    assert len(graph.links) > len(graph.nodes) + 15
    assert np.abs(found[:, :2] - graph.nodes[:, :2]).max() < 1e-4
