# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pose graphs: what they believe, and where they put the nodes."""

import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.pose_graphs import add_loop, ate, believed, build, make_drive
from error_codes import has_code
from fusionslam import PoseGraph
from fusionslam.base.arrays import Floats
from fusionslam.datasets.pose_files import read_poses_kitti
from fusionslam.errors import ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping import pose_graph
from refusals import refuses
from rows import rows

gtsam = pytest.importorskip("gtsam", exc_type=ImportError)

LAP = 20
STEP = exp(np.array([1.0, 0, 0, 0, 0, 2 * np.pi / LAP]))
ODOMETRY = np.array([0.02, 0.02, 0.02, 0.003, 0.003, 0.003])
LOOP = np.full(6, 0.01)
STEP_SD = np.array([0.01, 0.01, 0.01, 0.001, 0.001, 0.001])
AGAINST = "contradicts-steps"


def drive(graph: PoseGraph, rng: np.random.Generator, nodes: int) -> tuple[int, Floats]:
    """Add laps of a circle: the first node and the true poses."""
    first = graph.add_node()
    true = [np.eye(4)]
    for _ in range(1, nodes):
        step_on(graph, rng)
        true.append(true[-1] @ STEP)
    return first, np.array(true)


def step_on(graph: PoseGraph, rng: np.random.Generator, noise: float = 1, stated: float = 1) -> int:
    """Add a node, and odometry to it; deviations are multiples of the usual ones."""
    node = graph.add_node()
    measured = STEP @ exp(rng.normal(size=6) * ODOMETRY * noise)
    graph.add_edge(node - 1, node, measured, np.diag((ODOMETRY * stated) ** 2), "odometry")
    return node


def measure(graph: PoseGraph, rng: np.random.Generator, node: int, stated: Floats = STEP_SD) -> int:
    """Add the step to a node as clouds measured it."""
    measured = STEP @ exp(rng.normal(size=6) * STEP_SD)
    return graph.add_edge(node - 1, node, measured, np.diag(stated**2), "loop").number


def close(graph: PoseGraph, rng: np.random.Generator, a: int, b: int, kind: str = "loop") -> int:
    """Add a right loop between nodes at one place."""
    return graph.add_edge(a, b, exp(rng.normal(size=6) * LOOP), np.diag(LOOP**2), kind).number


def errors_m(poses: Floats, true: Floats) -> Floats:
    return np.asarray(np.linalg.norm(poses[:, :3, 3] - true[:, :3, 3], axis=1))


def test_right_loops_are_believed_and_false_ones_refused() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(1)
    _, true = drive(graph, rng, 2 * LAP)
    alone = graph.solve()
    right = [close(graph, rng, k - LAP, k) for k in range(LAP, 2 * LAP)]
    far = graph.add_edge(3, 30, np.eye(4), np.diag(LOOP**2), "loop").number
    aside = exp(np.array([0.2, 0, 0, 0, 0, 0]))
    near = graph.add_edge(4, LAP + 4, aside, np.diag(LOOP**2), "loop").number
    solution = graph.solve()
    assert [edge.number for edge in solution.believed] == right
    codes = {edge.number: edge.reason.code for edge in solution.refused}
    assert codes == {far: "contradicts-odometry", near: "contradicts-graph"}
    assert graph.edges[far].state == "refused" and graph.edges[right[0]].state == "believed"
    assert errors_m(solution.poses, true).max() < 0.5 * errors_m(alone.poses, true).max()


def test_a_refused_loop_is_asked_again() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(2)
    drive(graph, rng, LAP)
    other = graph.add_node(exp(np.array([0, 5.0, 0, 0, 0, 0])))
    waits = close(graph, rng, 0, other)
    assert [edge.reason.code for edge in graph.solve().refused] == ["few-merges"]
    assert graph.edges[waits].state == "refused"
    graph.add_edge(LAP - 1, other, STEP, np.diag(ODOMETRY**2), "odometry")
    assert [edge.number for edge in graph.solve().believed] == [waits]


def test_sessions_are_joined_by_three_edges_that_agree() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(3)
    drive(graph, rng, LAP)
    start, true = drive(graph, rng, LAP)
    merges = [close(graph, rng, k, start + k, "merge") for k in (2, 9)]
    apart = graph.solve()
    assert set(apart.parts) == {0, start}
    assert [edge.number for edge in apart.refused] == merges
    assert np.array_equal(apart.poses[start], np.eye(4))
    wrong = graph.add_edge(5, start + 15, np.eye(4), np.diag(LOOP**2), "merge").number
    assert len(graph.solve().believed) == 0
    merges.append(close(graph, rng, 15, start + 15, "merge"))
    joined = graph.solve()
    assert set(joined.parts) == {0}
    assert [edge.number for edge in joined.believed] == merges
    assert [edge.number for edge in joined.refused] == [wrong]
    assert errors_m(joined.poses[start:], true).max() < 0.4


def test_a_session_may_be_joined_backwards_and_keeps_its_measurement() -> None:
    graph, turned = PoseGraph(), PoseGraph()
    for each in (graph, turned):
        rng = np.random.default_rng(3)
        drive(each, rng, LAP)
        start, _ = drive(each, rng, LAP)
    covariance = np.diag(LOOP**2)
    for k in (2, 9, 15):
        error = exp(rng.normal(size=6) * LOOP)
        graph.add_edge(k, start + k, error, covariance, "merge")
        turned.add_edge(start + k, k, inverse(error), covariance, "merge")
    one, other = graph.solve(), turned.solve()
    assert len(one.believed) == len(other.believed) == 3
    assert np.abs(one.poses - other.poses).max() < 1e-3


def test_the_optimum_is_that_of_gtsams_own_graph() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(4)
    drive(graph, rng, 2 * LAP)
    for k in range(LAP, 2 * LAP):
        close(graph, rng, k - LAP, k)
    solution = graph.solve()
    theirs = gtsam.NonlinearFactorGraph()
    theirs.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)))
    values = gtsam.Values()
    for node in range(len(graph)):
        values.insert(node, gtsam.Pose3(solution.poses[node]))
    for edge in graph.edges:
        sd = np.sqrt(np.diag(edge.covariance))
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.concatenate([sd[3:], sd[:3]]))
        theirs.add(gtsam.BetweenFactorPose3(edge.a, edge.b, gtsam.Pose3(edge.pose), noise))
    best = gtsam.GaussNewtonOptimizer(theirs, values).optimize()
    assert len(solution.believed) == LAP
    for node in range(len(graph)):
        assert np.abs(best.atPose3(node).matrix() - solution.poses[node]).max() < 1e-4


def test_odometry_in_any_order_and_direction_gives_the_same_poses() -> None:
    rng = np.random.default_rng(5)
    steps = [STEP @ exp(rng.normal(size=6) * ODOMETRY) for _ in range(9)]
    plain, turned = PoseGraph(), PoseGraph()
    for graph in (plain, turned):
        for _ in range(10):
            graph.add_node()
    covariance = np.diag(ODOMETRY**2)
    for k, step in enumerate(steps):
        plain.add_edge(k, k + 1, step, covariance, "odometry")
    for k in (8, 0, 5, 2, 3, 1, 7, 4, 6):
        turned.add_edge(k + 1, k, inverse(steps[k]), covariance, "odometry")
    assert np.allclose(plain.solve().poses, turned.solve().poses, atol=1e-9)


def test_without_gtsam_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with refuses("missing-extra", "map", error=FusionSlamError):
        PoseGraph()


INDEFINITE = "not-positive-definite"


@rows(
    "change, error, code, field",
    [
        ({"a": 7}, DataError, "unknown-node", "a"),
        ({"b": -1}, DataError, "unknown-node", "b"),
        ({"b": 0.5}, DataError, "unknown-node", "b"),
        ({"a": "0"}, DataError, "unknown-node", "a"),
        ({"b": 0}, DataError, "same-node", "b"),
        ({"pose": np.full((4, 4), np.nan)}, DataError, "not-finite", "pose"),
        ({"pose": np.diag([1.0, 1, -1, 1])}, DataError, "not-a-rotation", "pose"),
        ({"pose": np.eye(3)}, ShapeError, "shape", "pose"),
        ({"covariance": np.zeros((6, 6))}, DataError, INDEFINITE, "covariance"),
        ({"covariance": np.diag([1.0, 1, 1, 1, 1, -1])}, DataError, INDEFINITE, "covariance"),
        ({"covariance": np.tri(6)}, DataError, INDEFINITE, "covariance"),
        ({"covariance": np.full((6, 6), np.inf)}, DataError, "not-finite", "covariance"),
        ({"covariance": np.eye(3)}, ShapeError, "shape", "covariance"),
        ({"kind": "guess"}, ConfigError, "unknown-kind", "kind"),
    ],
)
def test_wrong_edges_are_refused(
    change: dict[str, object], error: type[FusionSlamError], code: str, field: str
) -> None:
    graph = PoseGraph()
    graph.add_node()
    graph.add_node()
    values = {"a": 0, "b": 1, "pose": np.eye(4), "covariance": np.eye(6), "kind": "odometry"}
    with pytest.raises(error, check=has_code(code, field)):
        graph.add_edge(**values | change)
    assert graph.edges == ()


@rows("sigmas", [0.0, -1.0, np.nan, np.inf])
def test_a_gate_of_no_width_is_refused(sigmas: float) -> None:
    with pytest.raises(ConfigError, check=lambda error: error.fields[0] == "sigmas"):
        PoseGraph(sigmas=sigmas)


def test_an_isolated_node_is_named() -> None:
    graph = PoseGraph()
    for _ in range(3):
        graph.add_node()
    graph.add_edge(0, 1, np.eye(4), np.eye(6), "odometry")
    with refuses("isolated-node", "node", "2"):
        graph.solve()


def test_an_empty_graph_has_no_poses() -> None:
    assert PoseGraph().solve().poses.shape == (0, 4, 4)
    assert PoseGraph().update().pose is None


@rows("factor", [1.0, 10.0])
def test_overconfident_odometry_is_named_with_its_factor(factor: float) -> None:
    """Many laps, loops at each place; the stated deviations are divided by the factor."""
    graph, rng = PoseGraph(), np.random.default_rng(6)
    graph.add_node()
    for _ in range(1, 10 * LAP):
        node = step_on(graph, rng, stated=1 / factor)
        if node >= LAP:
            close(graph, rng, node % LAP, node)
    solution = graph.solve()
    if factor == 1:
        assert solution.reason is None
    else:
        assert solution.reason.code == "overconfident-odometry"
        assert solution.reason.number == pytest.approx(factor, rel=0.3)
        assert len(solution.refused) > len(solution.believed)


@rows("margin", [1.0, 30.0])
def test_the_factor_is_right_of_few_loops_that_are_better_than_stated(margin: float) -> None:
    """There and back along a street: clouds measure each step, too, and close eight loops."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        graph, factor, ahead = PoseGraph(), 10.0, exp(np.array([6.0, 0, 0, 0, 0, 0]))
        for node in range(18):
            graph.add_node()
            if not node:
                continue
            step = exp(np.array([0, 0, 0, 0, 0, np.pi])) if node == 9 else ahead
            driven = step @ exp(rng.normal(size=6) * 5 * ODOMETRY)
            stated = np.diag((5 * ODOMETRY / factor) ** 2)
            graph.add_edge(node - 1, node, driven, stated, "odometry")
            measured = step @ exp(rng.normal(size=6) * LOOP / margin)
            graph.add_edge(node - 1, node, measured, np.diag(LOOP**2), "loop")
            if node > 9:
                back = exp(np.array([0, 0, 0, 0, 0, np.pi]))
                measured = back @ exp(rng.normal(size=6) * LOOP / margin)
                graph.add_edge(17 - node, node, measured, np.diag(LOOP**2), "loop")
        reason = graph.solve().reason
        assert reason is not None and reason.code == "overconfident-odometry"
        assert reason.number == pytest.approx(factor, rel=0.3)


def test_false_loops_alone_do_not_make_odometry_overconfident() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(7)
    drive(graph, rng, 4 * LAP)
    for a, b in rng.integers(0, 4 * LAP, (40, 2)).tolist():
        if a != b:
            anywhere = exp(rng.uniform(-20, 20, 6) * [1, 1, 1, 0.1, 0.1, 0.1])
            graph.add_edge(a, b, anywhere, np.diag(LOOP**2), "loop")
    solution = graph.solve()
    assert (len(solution.believed), solution.reason) == (0, None)


@pytest.mark.parametrize("is_guarded", [True, False])
def test_false_loops_that_agree_do_not_bend_odometry_that_steps_confirm(
    is_guarded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not is_guarded:  # what the other beliefs make of them
        monkeypatch.setattr(pose_graph, "oppose_loops", lambda *_: {})
    graph, rng = PoseGraph(), np.random.default_rng(1)
    graph.add_node()
    true = [np.eye(4)]
    for _ in range(1, 3 * LAP):
        measure(graph, rng, step_on(graph, rng, noise=0.1))
        true.append(true[-1] @ STEP)
    alone = graph.solve()
    off, covariance = exp(np.array([0.25, 0.1, 0, 0, 0, 0.03])), np.diag(LOOP**2)
    planted = {
        graph.add_edge(k, k + LAP, off @ exp(rng.normal(size=6) * LOOP), covariance, "loop").number
        for k in range(5, 15)
    }
    solution = graph.solve()
    errors = [errors_m(each.poses, np.array(true)).max() for each in (alone, solution)]
    codes = {edge.reason.code for edge in solution.refused if edge.reason is not None}
    if is_guarded:
        assert errors[1] == pytest.approx(errors[0], rel=1e-3) and AGAINST in codes
        assert not {edge.number for edge in solution.believed} & planted
        assert solution.reason is not None and solution.reason.code == AGAINST
        assert solution.reason.number >= 8
    else:
        assert errors[1] > 2 * errors[0] and solution.reason is None


@pytest.mark.parametrize(
    ("noise", "scale", "stated"),
    [
        pytest.param(1.0, 1.0, STEP_SD, id="odometry that drifts as it states"),
        pytest.param(0.1, 1.02, STEP_SD, id="odometry that is too long"),
        pytest.param(0.1, 1.02, np.where(np.arange(6) == 0, 10.0, STEP_SD), id="a corridor"),
    ],
)
def test_steps_speak_against_no_right_loop(noise: float, scale: float, stated: Floats) -> None:
    for seed in range(3):
        graph, rng = PoseGraph(), np.random.default_rng(seed)
        graph.add_node()
        for _ in range(1, 3 * LAP):
            node = graph.add_node()
            step = STEP @ exp(rng.normal(size=6) * ODOMETRY * noise)
            step[:3, 3] *= scale
            graph.add_edge(node - 1, node, step, np.diag(ODOMETRY**2), "odometry")
            if stated[0] < 1:
                measure(graph, rng, node, stated)
            else:  # clouds leave what is along it as odometry has it
                graph.add_edge(node - 1, node, step, np.diag(stated**2), "loop")
        for k in range(LAP, 3 * LAP, 4):
            close(graph, rng, k - LAP, k)
        solution = graph.solve()
        assert AGAINST not in {edge.reason.code for edge in solution.refused if edge.reason}
        assert len(solution.believed) > 3 * LAP and solution.reason is None


def test_odometry_that_loops_confirm_counts_for_more_than_it_states() -> None:
    errors = []
    for loops in (9, 10):  # ten tell how good it is
        graph, rng = PoseGraph(), np.random.default_rng(3)
        graph.add_node()
        true = [np.eye(4)]
        for _ in range(1, 2 * LAP):
            node = step_on(graph, rng, noise=0.01)
            measured = STEP @ exp(np.array([0.01, 0, 0, 0, 0, 0.002]))  # all are off alike
            graph.add_edge(node - 1, node, measured, np.diag((2 * STEP_SD) ** 2), "loop")
            true.append(true[-1] @ STEP)
        for k in range(loops):
            graph.add_edge(k, k + LAP, np.eye(4), np.diag((LOOP / 10) ** 2), "loop")
        errors.append(errors_m(graph.solve().poses, np.array(true)).max())
    assert errors[1] < errors[0] / 3


def test_poses_follow_loops_while_driving() -> None:
    rng, first = np.random.default_rng(8), np.random.default_rng(8)
    graph, alone = PoseGraph(), PoseGraph()
    _, true = drive(alone, first, 6 * LAP)
    odometry = alone.solve().poses
    graph.add_node()
    states, live = [], [np.eye(4)]
    for edge in alone.edges:
        graph.add_node()
        graph.add_edge(edge.a, edge.b, edge.pose, edge.covariance, "odometry")
        if edge.b >= LAP:
            close(graph, rng, edge.b % LAP, edge.b)
        update = graph.update()
        states += [each.state for each in update.edges]
        live.append(update.pose)
    assert states.count("believed") > 0.95 * len(states) == 0.95 * 5 * LAP
    last = errors_m(np.array(live), true)[-LAP:].max()
    assert last < 0.6 * errors_m(odometry, true)[-LAP:].max()
    assert np.allclose(graph.poses[-1], live[-1])
    solution = graph.solve()
    assert np.allclose(graph.poses, solution.poses)
    assert errors_m(solution.poses, true).max() < 0.3


def test_a_false_loop_does_not_move_the_nodes_while_driving() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(9)
    drive(graph, rng, LAP)
    before = graph.update().pose
    graph.add_edge(3, LAP - 1, np.eye(4), np.diag(LOOP**2), "loop")
    update = graph.update()
    assert [edge.state for edge in update.edges] == ["refused"]
    assert update.edges[0].reason.code == "contradicts-odometry"
    assert np.array_equal(update.pose, before)


def test_a_later_session_is_led_by_the_sessions_it_is_joined_with() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(10)
    drive(graph, rng, LAP)
    start, _ = drive(graph, rng, LAP // 2)
    for k in (1, 4, 8):
        close(graph, rng, k, start + k, "merge")
    assert {edge.state for edge in graph.update().edges} == {"pending"}
    assert set(graph.solve().parts) == {0}
    for _ in range(LAP // 2, LAP):
        node = step_on(graph, rng, noise=3, stated=3)
        close(graph, rng, node - start, node, "merge")
        update = graph.update()
    assert [edge.state for edge in update.edges] == ["believed"]
    here = graph.poses[node - start]
    assert np.linalg.norm(update.pose[:3, 3] - here[:3, 3]) < 0.1


def test_measured_steps_correct_odometry_while_driving() -> None:
    rng = np.random.default_rng(11)
    graph, true = PoseGraph(), [np.eye(4)]
    graph.add_node()
    odometry = np.diag(ODOMETRY**2)
    for k in range(LAP // 2):
        node = step_on(graph, rng)
        ends, measured = (node - 1, node), STEP @ exp(rng.normal(size=6) * ODOMETRY / 10)
        if k % 2:  # in either direction
            ends, measured = (node, node - 1), inverse(measured)
        graph.add_edge(*ends, measured, odometry / 100, "loop")
        update = graph.update()
        assert [edge.state for edge in update.edges] == ["believed"]
        true.append(true[-1] @ STEP)
    node = graph.add_node()
    graph.add_edge(node - 1, node, STEP, odometry, "odometry")
    false = STEP @ exp(np.array([0.08, 0, 0, 0, 0, 0.012]))  # odometry does not exclude it
    graph.add_edge(node - 1, node, false, odometry / 1000, "loop")
    assert [edge.state for edge in graph.update().edges] == ["pending"]
    true.append(true[-1] @ STEP)
    live = errors_m(graph.poses, np.array(true)).max()
    assert live < 2 * errors_m(graph.solve().poses, np.array(true)).max() + 0.02


def test_loops_of_the_last_solution_hold_against_a_new_one() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(12)
    _, true = drive(graph, rng, 2 * LAP)
    for k in range(LAP, 2 * LAP - 1):
        close(graph, rng, k - LAP, k)
    before = graph.solve().poses[LAP + 5 :]
    aside = exp(np.array([0.1, 0, 0, 0, 0, 0]))
    graph.add_edge(LAP - 1, 2 * LAP - 1, aside, np.diag((3 * LOOP) ** 2), "loop")
    graph.update()
    moved = errors_m(graph.poses[LAP + 5 :], before)
    assert moved[:-1].max() < 0.05
    assert errors_m(graph.poses, true).max() < 0.3


def test_a_session_goes_on_after_another_one_began() -> None:
    graph, rng = PoseGraph(), np.random.default_rng(13)
    first, true = drive(graph, rng, LAP + 1)
    start, _ = drive(graph, rng, 3)
    graph.update()
    close(graph, rng, first, LAP)
    close(graph, rng, start, start + 1)
    graph.solve()
    other = graph.poses[start : start + 3]
    node = LAP
    for k in range(1, 4):
        before, node = node, graph.add_node()
        graph.add_edge(before, node, STEP, np.diag(ODOMETRY**2), "odometry")
        close(graph, rng, k, node)
        assert [edge.state for edge in graph.update().edges] == ["believed"]
        assert np.linalg.norm(graph.pose(node)[:3, 3] - graph.pose(k)[:3, 3]) < 0.03
    assert np.array_equal(graph.poses[start : start + 3], other)
    assert errors_m(graph.poses[: LAP + 1], true).max() < 0.3


@pytest.mark.nightly
@rows("odometry", ["good", "rough"])
def test_true_loops_are_kept_and_false_ones_are_not(test_data: Path, odometry: str) -> None:
    path = read_poses_kitti(test_data / "kitti/poses/00.txt")
    drive = make_drive(path, odometry, 1.0)
    graph = build(drive)
    alone = graph.solve()
    for loop in drive.loops + drive.false:
        add_loop(graph, *loop)
    solution = graph.solve()
    true, false = believed(drive, solution)
    assert (len(drive.loops), len(drive.false)) == (790, 790)
    assert true >= 0.99 * 790 and false == 0
    assert ate(solution.poses, path) < 0.25 * ate(alone.poses, path)
    assert solution.reason is None
    assert np.array_equal(graph.solve().poses, solution.poses)
