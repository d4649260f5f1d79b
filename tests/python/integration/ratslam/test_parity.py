# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The reference run of OpenRatSLAM, step by step, and its map under both presets.

Odometry with twice the errors: what it said, plus once more what it said beyond the true motion,
which the true poses give.
"""

import csv
import gzip
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drives import rmse
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam import Action, ActionKind, ExperienceMap, PoseCells
from maps import little_run, reference_table
from worlds import seen_from


class Run(NamedTuple):
    """The reference run through our cells and map."""

    actions: list[Action]
    decoded: NDArray[np.float64]
    graph: ExperienceMap
    poses: NDArray[np.float64]
    offsets: NDArray[np.float64]
    dead_reckoning: NDArray[np.float64]


@pytest.fixture(scope="module")
def cells_at(ratslam_reference: Path) -> dict[int, NDArray[np.float64]]:
    with gzip.open(ratslam_reference / "pc_cells.csv.gz", "rt") as file:
        return {int(row[0]): np.array(row[1:], np.float64) for row in csv.reader(file)}


@pytest.fixture(scope="module")
def run(ratslam_reference: Path, cells_at: dict[int, NDArray[np.float64]]) -> Run:
    cells = PoseCells(preset="openratslam")
    graph = ExperienceMap(preset="openratslam", initial_heading=np.radians(140))
    rows: list[tuple[Any, ...]] = []
    pose = np.zeros(3)
    for step, row in enumerate(reference_table(ratslam_reference / "pc_input.csv.gz")):
        v, w, dt = row["vtrans"], row["vrot"], row["dt"]
        cells.on_view(int(row["vt_id"]), row["vt_rad"])
        cells.on_odometry(v, w, dt)
        action = cells.action()
        graph.on_odometry(v, w, dt)
        graph.apply(action)
        if action.kind:
            graph.relax()
        if step in cells_at:
            np.testing.assert_allclose(cells.activity.ravel(), cells_at[step], rtol=0, atol=1e-9)
        heading = pose[2] + w * dt
        pose = pose + np.array([v * dt * np.cos(heading), v * dt * np.sin(heading), w * dt])
        offset = seen_from(graph.nodes[graph.current], graph.pose)
        rows.append((action, cells.best, graph.pose, offset, pose))
    actions, decoded, poses, offsets, reckoned = zip(*rows, strict=True)
    arrays = (np.array(values) for values in (poses, offsets, reckoned))
    return Run(list(actions), np.array(decoded), graph, *arrays)


def test_every_action_is_the_references(run: Run, ratslam_reference: Path) -> None:
    expected = reference_table(ratslam_reference / "pc_output.csv.gz")
    assert len(run.actions) == 3840
    found = [(a.kind, a.source, a.target) if a.kind else (0, 0, 0) for a in run.actions]
    kinds = expected["action"] > 0
    wanted = np.stack([expected[name] * kinds for name in ("action", "src_exp", "dest_exp")], 1)
    np.testing.assert_array_equal(np.array(found), wanted)


def test_every_decoded_pose_is_the_references(run: Run, ratslam_reference: Path) -> None:
    expected = reference_table(ratslam_reference / "pc_output.csv.gz")
    wanted = np.stack([expected[f"best_{axis}"] for axis in ("x", "y", "th")], 1)
    period = np.array([20, 20, 36])
    error = (run.decoded - wanted + period / 2) % period - period / 2
    assert np.abs(error).max() < 1e-9


def test_the_map_is_the_references(run: Run, ratslam_reference: Path) -> None:
    wanted = json.loads((ratslam_reference / "em_output.json").read_text())
    assert (len(run.graph.nodes), len(run.graph.links)) == (136, 136)
    nodes = np.array([[node[name] for name in ("x", "y", "th")] for node in wanted["nodes"]])
    np.testing.assert_allclose(run.graph.nodes, nodes, rtol=0, atol=1e-9)
    for ours, theirs in (
        ("source", "from"),
        ("target", "to"),
        ("distance", "d"),
        ("heading", "heading_rad"),
        ("facing", "facing_rad"),
        ("duration", "delta_time_s"),
    ):
        given = [link[theirs] for link in wanted["links"]]
        np.testing.assert_allclose(run.graph.links[ours], given, rtol=0, atol=1e-9)


class Reference:
    """The input and the truth of the run."""

    def __init__(self, folder: Path) -> None:
        self.rows = reference_table(folder / "pc_input.csv.gz")
        truth = reference_table(folder / "pc_groundtruth.csv.gz")
        self.truth = np.stack([truth[name] for name in ("x", "y", "th")], axis=1)

    def odometry(self, errors: float) -> Any:
        """float64 (n, 2): speed and turn rate with so many times their errors."""
        said = np.stack([self.rows["vtrans"], self.rows["vrot"]], axis=1)
        steps, dt = np.diff(self.truth, axis=0), self.rows["dt"][1:]
        turns = np.angle(np.exp(1j * steps[:, 2]))
        true = np.stack([np.hypot(steps[:, 0], steps[:, 1]) / dt, turns / dt], axis=1)
        true = np.vstack([true[:1], true])
        return true + errors * (said - true)

    @cache  # noqa: B019
    def actions(self, errors: float, cells_preset: str) -> list[Action]:
        """Actions of the cells, which do not depend on the map if all loops are accepted."""
        cells, said = PoseCells(preset=cells_preset), []
        for row, (v, w) in zip(self.rows, self.odometry(errors), strict=True):
            cells.on_view(int(row["vt_id"]), row["vt_rad"])
            cells.on_odometry(v, w, row["dt"])
            said.append(cells.action())
        return said

    def build_map(
        self, preset: str, errors: float, cells_preset: str = "openratslam"
    ) -> tuple[float, float]:
        """RMSE of all steps by odometry alone, and of the map's nodes."""
        graph = ExperienceMap(preset=preset, initial_heading=np.radians(140))
        alone, poses, made = ExperienceMap(preset=preset), [], []
        steps = zip(
            self.actions(errors, cells_preset), self.odometry(errors), self.rows["dt"], strict=True
        )
        for step, (action, (v, w), dt) in enumerate(steps):
            graph.on_odometry(v, w, dt)
            alone.on_odometry(v, w, dt)
            poses.append(alone.pose)
            if action.kind == ActionKind.CREATE_NODE:
                made.append(step)
            assert graph.check(action).accepted
            graph.apply(action)
            if action.kind:
                graph.relax()
        return rmse(poses, self.truth), rmse(graph.nodes, self.truth[made])


@pytest.fixture(scope="module")
def reference(ratslam_reference: Path) -> Reference:
    return Reference(ratslam_reference)


@pytest.mark.slow
def test_both_presets_are_as_good_as_published_with_the_odometry_of_the_run(
    reference: Reference,
) -> None:
    alone, theirs = reference.build_map("openratslam", 1)
    assert (alone, theirs) == (pytest.approx(0.494, abs=0.0005), pytest.approx(0.175, abs=0.0005))
    assert reference.build_map("robust", 1)[1] <= theirs
    assert reference.build_map("robust", 1, "robust")[1] <= theirs


def test_the_robust_map_is_better_than_the_references_with_twice_the_errors(
    reference: Reference,
) -> None:
    alone, theirs = reference.build_map("openratslam", 2)
    assert alone == pytest.approx(0.99, abs=0.01)
    assert reference.build_map("robust", 2)[1] < theirs
    assert reference.build_map("robust", 2, "robust")[1] < theirs


def test_without_errors_the_odometry_is_the_truth(reference: Reference) -> None:
    alone, mapped = reference.build_map("robust", 0)
    assert alone < 0.02 and mapped < 0.02


@pytest.fixture(scope="module")
def map_run(run: Run, reference: Reference) -> RatSlamRun:
    actions = [action[:3] for action in run.actions]
    seconds = np.arange(len(reference.truth)) * 0.1
    little = little_run(reference.truth, actions, run.graph.nodes, [], seconds=seconds)
    return replace(
        little,
        links=run.graph.links,
        poses=run.poses,
        offsets=run.offsets,
        dead_reckoning=run.dead_reckoning,
    )


@pytest.fixture(scope="module")
def report(map_run: RatSlamRun) -> MapReport:
    return judge_map(map_run)


def test_the_reference_map_has_the_published_errors(report: MapReport) -> None:
    assert (report.nodes.n, report.dead_reckoning.n) == (136, 3840)
    assert report.nodes.rmse_m == pytest.approx(0.175, abs=0.0005)
    assert report.dead_reckoning.rmse_m == pytest.approx(0.494, abs=0.0005)
    # At the moments when nodes were made, dead reckoning is little worse; over all steps it is.
    assert report.nodes_by_odometry.rmse_m == pytest.approx(0.193, abs=0.0005)
    assert report.trajectory.rmse_m < 0.5 * report.dead_reckoning.rmse_m


def test_scipy_finds_the_same_errors(map_run: RatSlamRun, report: MapReport) -> None:
    made = np.searchsorted(map_run.stamps_ns, map_run.node_stamps_ns)
    for errors, poses, truth in (
        (report.nodes, map_run.nodes, map_run.truth[made]),
        (report.trajectory, map_run.final_poses, map_run.truth),
        (report.live, map_run.poses, map_run.truth),
        (report.dead_reckoning, map_run.dead_reckoning, map_run.truth),
    ):
        flat = [np.pad(p[:, :2] - p[:, :2].mean(0), ((0, 0), (0, 1))) for p in (truth, poses)]
        distance = Rotation.align_vectors(*flat)[1]
        assert errors.rmse_m == pytest.approx(distance / np.sqrt(len(truth)), abs=1e-9)


def test_every_loop_of_the_reference_is_true(report: MapReport) -> None:
    assert (report.node_count, report.link_count) == (136, 136)
    assert (report.loops, report.loop_links) == (272, 1) and report.false_loops == 0
    assert report.linked_revisit_share > 0.9
