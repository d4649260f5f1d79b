# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The drift of odometry in space: against sampling, and against RatSLAM's check of loops."""

from collections.abc import Sequence

import numpy as np
import pytest

from fusionslam._core import OdometryTree
from fusionslam.base.arrays import Floats
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.se3 import adjoint, exp, inverse, log
from fusionslam.mapping import DriftModel
from fusionslam.ratslam import Action, ActionKind, ExperienceMap
from fusionslam.ratslam.map_export import link_offsets
from rows import rows


def random_steps(rng: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """Motions (n, 4, 4) in all directions, and covariances (n, 6, 6) with correlations."""
    steps = exp(rng.normal(size=(count, 6)) * [1, 1, 1, 0.3, 0.3, 0.3])
    roots = rng.normal(size=(count, 6, 6)) * 0.003
    return steps, roots @ roots.transpose(0, 2, 1) + 1e-6 * np.eye(6)


def chain(
    steps: Floats, covariances: Floats, root: Sequence[float] = (100, -50, 3, 0.2, 0.1, 2)
) -> OdometryTree:
    tree = OdometryTree()
    tree.add_root(exp(np.array(root, float)))
    for parent, (step, covariance) in enumerate(zip(steps, covariances, strict=True)):
        tree.add(parent, step, covariance)
    return tree


def test_drift_is_the_covariance_of_sampled_odometry() -> None:
    rng = np.random.default_rng(1)
    steps, covariances = random_steps(rng, 12)
    tree = chain(steps, covariances)
    roots = np.linalg.cholesky(covariances)
    drawn, true = np.tile(np.eye(4), (4000, 1, 1)), np.eye(4)
    for k in range(3, 10):
        noise = exp(rng.normal(size=(4000, 6)) @ roots[k].T)
        drawn, true = drawn @ steps[k] @ noise, true @ steps[k]
    errors = log(inverse(true) @ drawn)
    expected, found = np.cov(errors.T), tree.drift(3, 10)
    assert np.abs(found - expected).max() < 0.08 * np.abs(expected).max()


def test_drift_adds_up_along_the_way_between_nodes_of_a_tree() -> None:
    rng = np.random.default_rng(2)
    steps, covariances = random_steps(rng, 3)
    tree = chain(steps[:1], covariances[:1])
    left = tree.add(1, steps[1], covariances[1])
    right = tree.add(1, inverse(steps[2]), covariances[2], backwards=True)
    # From the left to the fork backwards, and on to the right; a step's error is at its own end.
    back, on = inverse(steps[1]), steps[2]
    carry = adjoint(inverse(on))
    at_fork = carry @ adjoint(steps[1]) @ covariances[1] @ (carry @ adjoint(steps[1])).T
    at_right = carry @ covariances[2] @ carry.T
    assert np.allclose(inverse(tree.pose(left)) @ tree.pose(right), back @ on)
    assert np.allclose(tree.drift(left, right), at_fork + at_right, atol=1e-12)


def test_the_drift_of_long_ways_is_exact() -> None:
    rng = np.random.default_rng(3)
    steps, covariances = random_steps(rng, 700)
    tree = chain(steps, covariances)
    total, pose = np.zeros((6, 6)), np.eye(4)
    for k in range(123, 700):
        carry = adjoint(inverse(steps[k]))
        total = carry @ total @ carry.T + covariances[k]
        pose = pose @ steps[k]
    assert np.allclose(tree.drift(123, 700), total, rtol=1e-6, atol=1e-7)
    there = adjoint(pose)
    assert np.allclose(tree.drift(700, 123), there @ total @ there.T, rtol=1e-6, atol=1e-6)


def test_drift_is_the_same_far_from_the_origin() -> None:
    steps, covariances = random_steps(np.random.default_rng(4), 500)
    near = chain(steps, covariances, np.zeros(6).tolist())
    far = chain(steps, covariances, (5e5, 5e6, 100, 0, 0, 0))
    assert np.allclose(near.drift(490, 500), far.drift(490, 500), rtol=1e-6, atol=1e-8)


def test_a_loop_in_the_plane_is_judged_as_ratslam_judges_it() -> None:
    """Same drive, same deviations: same errors, same allowance."""
    options = {"drift_m": 0.05, "drift_turn": 0.02, "drift_heading": 0.01}
    place_m, place_rad = 0.4, 0.2
    ratslam = ExperienceMap(**options, place_m=place_m, place_rad=place_rad)
    model = DriftModel(**options, drift_height=1e-4, drift_tilt=1e-5)
    tree = OdometryTree()
    tree.add_root(np.eye(4))
    ratslam.apply(Action(ActionKind.CREATE_NODE))
    turns = [0.3, -0.2, 0.5, 0.7, 0.1, -0.9]
    for node, turn in enumerate(turns):
        ratslam.on_odometry(2.0, turn, 1.0)
        ratslam.apply(Action(ActionKind.CREATE_NODE, node, node + 1))
        # RatSLAM turns first; its drift counts the error of the rotation from the step's end on.
        step = exp(np.array([0, 0, 0, 0, 0, turn])) @ exp(np.array([2.0, 0, 0, 0, 0, 0]))
        tree.add(node, step, model.covariance(step))
    claimed = exp(np.array([0, 0, 0, 0, 0, 0.4])).copy()
    claimed[:2, 3] = 1.5, -0.7
    action = Action(ActionKind.CREATE_EDGE, len(turns), 0, 0.4, (1.5, -0.7))
    expected = ratslam.check(action)
    least = 1e-6  # that RatSLAM adds to each variance
    measured = np.diag([place_m**2 + least] * 2 + [least] * 3 + [place_rad**2 + least])
    odometry = tree.pose(len(turns))
    # In axes of the node, as small translation and rotation.
    error = np.zeros(6)
    error[:3] = odometry[:3, :3].T @ (claimed[:3, 3] - odometry[:3, 3])
    error[5] = log(inverse(odometry) @ claimed)[5]
    found = tree.fit(0, len(turns), error, measured, 3.0)
    values = expected.error_m, expected.error_rad, expected.allowed_m, expected.allowed_rad
    assert found == pytest.approx(values, rel=1e-6)


def test_a_model_states_the_deviations_of_a_motion() -> None:
    along = {"drift_m": 0.1, "drift_height": 0.2, "drift_heading": 0.03, "drift_tilt": 0.04}
    model = DriftModel(**along, drift_turn=0.05)
    motion = exp(np.array([0, 0, 0, 0, 0, 0.5])).copy()
    motion[:3, 3] = 0, 4, 0
    tilt, heading = (0.05**2 * 0.5 + sd**2 * 4 for sd in (0.04, 0.03))
    # A rotation that grows on the way moves the end: by 4 m / sqrt(3) times its deviation.
    flat, height = 0.1**2 * 4 + heading * 16 / 3, 0.2**2 * 4 + tilt * 16 / 3
    expected = np.diag([flat, flat, height, tilt, tilt, heading])
    assert np.allclose(model.covariance(motion), expected, atol=1.1e-6)
    assert np.linalg.eigvalsh(model.covariance(np.eye(4)))[0] > 0


def test_wrong_models_motions_and_nodes_are_refused() -> None:
    with pytest.raises(ConfigError):
        DriftModel(drift_m=-1)
    with pytest.raises(DataError, check=lambda error: error.fields == ("motion",)):
        DriftModel().covariance(np.full((4, 4), np.nan))
    tree = OdometryTree()
    tree.add_root(np.eye(4))
    tree.add_root(np.eye(4))
    for a, b in ((0, 1), (0, 2), (-1, 0)):
        with pytest.raises(DataError):
            tree.drift(a, b)


@rows("seed", range(3))
def test_relaxation_finds_gtsams_optimum(seed: int) -> None:
    """Three laps of a noisy circle; loops close each place of the later ones with the first.

    GTSAM's error is the logarithm of a pose, RatSLAM's the pose itself: they differ by a part of
    the rotation's error, so that errors must be small.
    """
    gtsam = pytest.importorskip("gtsam", exc_type=ImportError)
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
            back, turn = node % lap, rng.normal() * 0.01
            graph.apply(Action(ActionKind.CREATE_EDGE, node, back, turn, place))
            graph.apply(Action(ActionKind.CREATE_EDGE, back, node, 0.0, (0.0, 0.0)))
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
