# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps judged against the truth: little ones made by hand, whose figures are obvious."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from error_codes import has_code
from fusionslam import DataError, ShapeError
from fusionslam.errors import ConfigError
from fusionslam.evaluation import MapReport, ViewRule, judge_map, judge_views, pose_errors
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.geometry.rigid import RigidMotion, fit_rigid
from maps import CORNERS, little_run, matrix, square_run
from rows import rows


def noisy(seed: int, count: int = 50) -> tuple[Any, Any]:
    """A path, and the same turned, shifted and shaken."""
    rng = np.random.default_rng(seed)
    truth = np.column_stack([np.cumsum(rng.normal(0, 1, (count, 2)), 0), rng.uniform(-3, 3, count)])
    shaken = truth + rng.normal(0, 0.3, truth.shape)
    return RigidMotion(3.0, -7.0, rng.uniform(-3, 3)).apply(shaken), truth


@rows("seed", range(5))
def test_alignment_is_scipys(seed: int) -> None:
    poses, truth = noisy(seed)
    flat = [np.pad(p[:, :2] - p[:, :2].mean(0), ((0, 0), (0, 1))) for p in (truth, poses)]
    wanted, distance = Rotation.align_vectors(*flat)
    found = pose_errors(poses, truth)
    turn = wanted.as_rotvec()[2]
    assert np.abs(np.exp(1j * turn) - np.exp(1j * found.motion.turn)) < 1e-9
    assert found.rmse_m == pytest.approx(distance / np.sqrt(len(truth)), abs=1e-9)


@rows("seed", range(3))
def test_figures_are_those_of_kabsch_by_singular_values(seed: int) -> None:
    poses, truth = noisy(seed)
    here, there = poses[:, :2].mean(0), truth[:, :2].mean(0)
    u, _, vt = np.linalg.svd((poses[:, :2] - here).T @ (truth[:, :2] - there))
    mirror = np.diag([1, np.sign(np.linalg.det(vt.T @ u.T))])
    turned = vt.T @ mirror @ u.T
    apart = np.linalg.norm((poses[:, :2] - here) @ turned.T + there - truth[:, :2], axis=1)
    angles = Rotation.from_rotvec(np.pad(truth[:, 2:], ((0, 0), (2, 0)))).inv()
    angles *= Rotation.from_rotvec([0, 0, np.arctan2(turned[1, 0], turned[0, 0])])
    angles *= Rotation.from_rotvec(np.pad(poses[:, 2:], ((0, 0), (2, 0))))
    found = pose_errors(poses, truth)
    assert found.rmse_m == pytest.approx(np.sqrt((apart**2).mean()), rel=1e-9)
    assert (found.mean_m, found.max_m) == pytest.approx((apart.mean(), apart.max()), rel=1e-9)
    heading = np.degrees(np.sqrt((angles.magnitude() ** 2).mean()))
    assert found.heading_rmse_deg == pytest.approx(heading, rel=1e-9)


def test_no_other_motion_comes_nearer() -> None:
    poses, truth = noisy(7)

    def rmse(motion: Any) -> float:
        moved = RigidMotion(*motion).apply(poses)
        return float(np.sqrt(((moved - truth)[:, :2] ** 2).sum(1).mean()))

    found = pose_errors(poses, truth)
    starts = [(0.0, 0.0, turn) for turn in np.linspace(-3, 3, 7)]
    best = min(minimize(rmse, start, method="BFGS").fun for start in starts)
    assert found.rmse_m == pytest.approx(best, abs=1e-6)


def test_alignment_turns_and_shifts_but_does_not_scale() -> None:
    truth = matrix([(-1, 0, 0), (1, 0, 0)], 3)
    found = pose_errors(truth * [2, 2, 1], truth)
    assert (found.rmse_m, found.max_m, found.mean_m) == pytest.approx((1, 1, 1))
    # A robot that stands still is aligned by its heading.
    still = pose_errors(matrix([(5, 5, -0.7)] * 4, 3), matrix([(1, 2, 0.5)] * 4, 3))
    assert still.motion.turn == pytest.approx(1.2)
    assert (still.rmse_m, still.heading_rmse_deg) == pytest.approx((0, 0), abs=1e-9)
    # Errors of the heading are those left after alignment.
    square = matrix([(0, 0, 3.1), (1, 0, 3.1), (1, 1, 3.1), (0, 1, 3.1)], 3)
    turned = square + np.array([0, 0, np.radians(10)])
    assert pose_errors(turned, square).heading_rmse_deg == pytest.approx(10)


def test_a_perfect_map_has_no_errors_and_every_revisit_linked() -> None:
    report = judge_map(square_run())
    for name in ("nodes", "trajectory", "live", "dead_reckoning"):
        assert getattr(report, name).rmse_m == pytest.approx(0, abs=1e-12)
    assert (report.near_links, report.judged_links) == (4, 4)
    assert (report.near_loop_links, report.loop_links) == (1, 1)
    assert (report.loops, report.false_loops) == (4, 0)
    assert (report.linked_revisits, report.revisits) == (4, 4)
    assert report.linked_revisit_share == 1


def test_a_car_that_comes_back_beside_its_track_is_told_of_its_rule() -> None:
    run = square_run()
    # The second lap is 3 m further out, along both axes.
    half = run.stamps_ns > run.stamps_ns[-1] // 2
    away = replace(run, truth=run.truth + 3.0 * np.outer(half, [1, 1, 0]))
    paper, car = judge_map(away), judge_map(away, rule="car")
    assert paper.revisits == 0 and car.revisits
    (said,) = paper.unjudged
    assert "0.5 m" in said and f"--rule car), by which {car.revisits} do" in said
    assert car.unjudged == () and car.rule.loop_distance == 10


@rows("known", [True, False])
def test_few_loops_of_a_car_are_explained_with_the_cure(known: bool) -> None:
    """20 m at a time, 5 s each; the second lap meets nothing, or is refused."""
    laps = [(20.0 * x, 0.0, 0.0) for x in [*range(10), *range(10)]]
    made = [(1, max(k - 1, 0), k) for k in range(20)]
    links = [(k, k + 1) for k in range(19)]
    seconds = [5.0 * k for k in range(20)]
    refused = [(50.0, 10, 0), (55.0, 11, 1)]
    run = little_run(laps, made, laps, links, seconds=seconds, refused=refused)
    said = judge_map(run if known else replace(run, truth=None), rule="car").unjudged[-1]
    assert "20 looks showed a new view, 2 loops did not fit" in said
    assert "--views m2dp --set ratslam.map.place_m=4" in said
    slow = replace(run, stamps_ns=run.stamps_ns * 10, node_stamps_ns=run.node_stamps_ns * 10)
    wide = replace(run, config={"map": {"place_m": 4.0}})
    away = replace(run, truth=run.truth + np.arange(20)[:, None] * [0.0, 20.0, 0.0])
    for other in (slow, wide, away):
        assert not any("place_m" in remark for remark in judge_map(other, rule="car").unjudged)


def test_nodes_and_final_trajectory_are_judged_apart_from_the_live_one() -> None:
    run = square_run()
    moved = run.nodes.copy()
    moved[:, 0] *= 1.2  # 2 m longer along x: each corner 1 m off once aligned
    report = judge_map(replace(run, nodes=moved, dead_reckoning=run.poses * [1, 1.4, 1]))
    assert report.nodes.n == 4
    assert report.nodes.rmse_m == report.trajectory.rmse_m == pytest.approx(1.0)
    assert report.live.rmse_m == pytest.approx(0, abs=1e-12)
    assert report.dead_reckoning.rmse_m == pytest.approx(2.0)
    by_odometry = judge_map(replace(run, nodes=moved)).nodes_by_odometry
    assert by_odometry.rmse_m == pytest.approx(0, abs=1e-12)


def test_maps_of_one_node_or_without_loops_are_judged() -> None:
    places = [(3.0, 4.0, 0.5), (3.5, 4.0, 0.5)]
    report = judge_map(little_run(places, [(1, 0, 0), (0, 0, 0)], [(0.0, 0.0, 0.0)], []))
    assert (report.nodes.n, report.nodes.rmse_m, report.nodes.heading_rmse_deg) == (1, 0, 0)
    assert report.live.rmse_m == pytest.approx(0, abs=1e-12)
    assert (report.judged_links, report.near_link_share, report.loops) == (0, None, 0)
    assert (report.revisits, report.linked_revisits, report.false_loop_share) == (1, 1, None)
    assert str(report)
    corners, made = CORNERS * 2, [(1, max(k - 1, 0), k) for k in range(8)]
    report = judge_map(little_run(corners, made, corners, [(k, k + 1) for k in range(7)]))
    assert (report.loops, report.false_loops, report.loop_links) == (0, 0, 0)
    assert (report.linked_revisits, report.revisits) == (0, 4)
    assert report.near_loop_link_share is None


def test_a_new_node_that_gets_a_link_to_the_old_one_counts_as_linked() -> None:
    places = [(0.0, 0.0, 0.0), (9.0, 0.0, 0.0), (0.1, 0.0, 0.0)]
    actions = [(1, 0, 0), (1, 0, 1), (1, 1, 2)]
    for links, linked in (([(0, 1), (1, 2)], 0), ([(0, 1), (1, 2), (2, 0)], 1)):
        report = judge_map(little_run(places, actions, places, links))
        assert (report.linked_revisits, report.revisits) == (linked, 1)


def back_at_the_start(there: tuple[float, float, float]) -> RatSlamRun:
    """Takes a place for its first one, 5 m behind the second."""
    places = [(0.0, 0.0, 0.0), (5.0, 0.0, 0.0), there]
    return little_run(places, [(1, 0, 0), (1, 0, 1), (2, 1, 0)], places[:2], [(0, 1), (1, 0)])


def test_a_false_loop_is_counted_and_its_link_is_not_near() -> None:
    report = judge_map(back_at_the_start((9.0, 0.0, 0.0)))
    assert (report.loops, report.false_loops, report.false_loop_share) == (1, 1, 1)
    assert (report.near_links, report.judged_links) == (1, 2)
    assert (report.near_loop_links, report.loop_links) == (0, 1)


@rows("there, false", [((0.79, 0, 0), 0), ((0.81, 0, 0), 1), ((0, 0, 0.39), 0), ((0, 0, -0.41), 1)])
def test_a_loop_is_false_beyond_the_view_radius(there: Any, false: int) -> None:
    assert judge_map(back_at_the_start(there)).false_loops == false


def test_another_rule_has_another_view_radius() -> None:
    run = back_at_the_start((1.5, 0.0, 0.0))
    assert judge_map(run, rule=ViewRule(loop_distance=2.0)).false_loops == 0
    with pytest.raises(ConfigError, check=has_code("unknown-rule")):
        judge_map(run, rule="papr")


def test_refused_loops_are_told_apart_by_the_truth_and_by_later_links() -> None:
    run = square_run(refused=[(120.0, 3, 0), (120.0, 3, 2), (150.0, 0, 3)])
    report = judge_map(run)
    assert (report.refused, report.judged_refused, report.refused_true) == (3, 3, 1)
    links = [(0, 1), (1, 2), (2, 3)]
    report = judge_map(square_run(refused=[(120.0, 3, 0), (150.0, 0, 1)], links=links))
    assert (report.refused_true, report.refused_linked) == (2, 1)
    assert "1 of 2 wrongly refused, 1 linked later" in str(report)


def test_revisits_are_those_of_the_judge_of_views() -> None:
    rng = np.random.default_rng(2)
    truth = np.column_stack([rng.uniform(0, 3, (300, 2)), rng.uniform(-3, 3, 300)])
    stamps = np.arange(300) * 0.5
    actions = [(1, 0, 0), *[(0, 0, 0)] * 299]
    run = little_run(list(map(tuple, truth)), actions, [tuple(truth[0])], [], seconds=stamps)
    wanted = judge_views(np.arange(300), truth, stamps).revisits
    assert 0 < wanted < 300
    assert judge_map(run).revisits == wanted


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3), st.booleans())
@settings(max_examples=30, deadline=None)
def test_moving_map_or_truth_changes_nothing(x: float, y: float, turn: float, of_map: bool) -> None:
    run = square_run(refused=[(120.0, 3, 0)])
    rng = np.random.default_rng(1)
    run = replace(run, nodes=run.nodes + rng.normal(0, 0.2, run.nodes.shape))
    motion = RigidMotion(x, y, turn)
    moved = (
        {"nodes": motion.apply(run.nodes), "poses": motion.apply(run.poses)}
        if of_map
        else {"truth": motion.apply(run.truth)}
    )
    one, other = judge_map(run), judge_map(replace(run, **moved))
    for field in fields(MapReport):
        here, there = getattr(one, field.name), getattr(other, field.name)
        if hasattr(here, "motion"):
            for name in ("rmse_m", "max_m", "mean_m", "heading_rmse_deg"):
                assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-7)
        else:
            assert here == there, field.name


def test_a_run_without_truth_or_node_says_what_cannot_be_judged() -> None:
    report = judge_map(square_run(truth=None))
    assert (report.loops, report.node_count, report.nodes) == (4, 4, None)
    assert "no true poses" in str(report) and report.linked_revisit_share is None
    report = judge_map(little_run([(0.0, 0.0, 0.0)], [(0, 0, 0)], [], []))
    assert report.unjudged == ("not judged: the map has no node",)
    assert str(judge_map(little_run([], [], [], [])))


def test_nodes_and_steps_from_before_are_left_out_and_named() -> None:
    run = square_run()
    old = np.concatenate([[-5], run.node_stamps_ns[1:]])
    report = judge_map(replace(run, node_stamps_ns=old))
    assert report.nodes is not None and report.nodes.n == 3
    assert (report.judged_links, report.judged_loops) == (3, 3)
    assert "1 of 4 nodes" in report.unjudged[0]
    truth = [(50.0, 50.0, 2.0), (0.0, 0.0, 0.0), (5.0, 0.0, 0.0)]
    run = little_run(truth, [(0, 0, 0), (1, 0, 0), (1, 0, 1)], truth[1:], [(0, 1)])
    report = judge_map(run)
    assert report.steps == 2 and report.trajectory is not None
    assert report.trajectory.n == 2


def test_steps_whose_truth_is_unknown_are_left_out_and_counted() -> None:
    run = square_run(refused=[(0.0, 0, 1), (210.0, 0, 3)])
    run.truth[[0, 7]] = np.nan
    report = judge_map(run)
    assert (report.nodes.n, report.trajectory.n, report.steps) == (3, 6, 6)
    assert (report.judged_links, report.judged_loops, report.judged_refused) == (3, 2, 0)
    assert (report.revisits, report.linked_revisits) == (2, 2)
    assert "2 of 8 steps" in report.unjudged[0] and "1 of 4 nodes" in report.unjudged[1]
    run.truth[:] = np.nan
    assert judge_map(run).unjudged == ("not judged: the run has no true poses",)


def test_broken_runs_are_refused() -> None:
    run = square_run()

    def changed(name: str, row: Any, value: float) -> RatSlamRun:
        values = getattr(run, name).copy()
        values[row] = value
        return replace(run, **{name: values})

    for broken, code in (
        (changed("truth", (3, 1), np.nan), has_code("not-finite", "truth", 3)),
        (changed("truth", (3, 1), np.inf), has_code("not-finite", "truth", 3)),
        (changed("nodes", 2, np.nan), has_code("not-finite", "nodes", 2)),
        (changed("actions", (5, 2), 9), has_code("unknown-node", "actions", 9)),
        (replace(run, stamps_ns=run.stamps_ns[::-1].copy()), has_code("stamps-decrease", 1)),
    ):
        with pytest.raises(DataError, check=code):
            judge_map(broken)
    with pytest.raises(ShapeError, match="truth"):
        replace(run, truth=np.zeros((3, 3)))


def test_points_that_cannot_be_fitted_are_refused() -> None:
    with pytest.raises(ShapeError):
        fit_rigid(np.zeros((2, 3)), np.zeros((3, 3)))
    for wrong in (["a"], None, [[1, 2], [3]], [0, 0, 0]):
        with pytest.raises(ShapeError):
            fit_rigid(wrong, np.zeros((1, 3)))
    assert fit_rigid([[0, 0, 0]], [[1, 2, 0]]).x == 1


def test_a_report_is_read_back_as_it_was_saved(tmp_path: Path) -> None:
    for run in (square_run(refused=[(120.0, 3, 0)]), square_run(truth=None)):
        report = judge_map(run)
        report.save(tmp_path / "map.json")
        assert MapReport.load(tmp_path / "map.json") == report


@rows("content", ["", "{", "[]", '{"format": "other"}', "half"])
def test_other_files_are_no_report(tmp_path: Path, content: str) -> None:
    path = tmp_path / "map.json"
    if content == "half":
        judge_map(square_run()).save(path)
        content = path.read_text()[:300]
    path.write_text(content)
    with pytest.raises(DataError, match=r"map\.json"):
        MapReport.load(path)
    with pytest.raises(DataError, match=r"none\.json"):
        MapReport.load(tmp_path / "none.json")


def test_odometry_that_is_the_truth_is_said_beside_its_errors() -> None:
    exact = judge_map(square_run(odometry="truth"))
    assert exact.unjudged == () and "truth+noise" in exact.remarks[0]
    assert exact.remarks[0] in str(exact)
    for odometry in ("truth with errors (scale 1.02)", "topic /odom"):
        assert judge_map(square_run(odometry=odometry)).remarks == ()
    assert judge_map(square_run(odometry="truth", truth=None)).remarks == (
        "not judged: the run has no true poses",
    )
