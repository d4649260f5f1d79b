# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The map of the reference run, judged: 0.494 m by dead reckoning, 0.175 m on the map.

The first figure is over all 3,840 steps, the second over the 136 nodes against the truth when each
was made, both after rigid alignment. At the steps that made the nodes, all on the first lap, dead
reckoning is off by 0.193 m: that is what 0.175 m has to be held against.
"""

import csv
import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusionslam.evaluation import MapReport, judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam import ExperienceMap, PoseCells
from little_maps import little_run


def table(path: Path) -> Any:
    with gzip.open(path, "rt") as file:
        return list(csv.DictReader(file))


def seen_from(node: Any, pose: Any) -> list[float]:
    """A pose in the frame of a node."""
    dx, dy, heading = pose[0] - node[0], pose[1] - node[1], node[2]
    c, s = np.cos(heading), np.sin(heading)
    return [c * dx + s * dy, c * dy - s * dx, pose[2] - heading]


@pytest.fixture(scope="module")
def run(ratslam_reference: Path) -> RatSlamRun:
    cells, graph = (
        PoseCells(preset="openratslam"),
        ExperienceMap(preset="openratslam", initial_heading=np.radians(140)),
    )
    actions: list[tuple[int, int, int]] = []
    poses, offsets, reckoned, pose = [], [], [], np.zeros(3)
    for row in table(ratslam_reference / "pc_input.csv.gz"):
        v, w, dt = (float(row[name]) for name in ("vtrans", "vrot", "dt"))
        cells.on_view(int(row["vt_id"]), float(row["vt_rad"]))
        cells.on_odometry(v, w, dt)
        action = cells.action()
        graph.on_odometry(v, w, dt)
        graph.apply(action)
        if action.kind:
            graph.relax()
        heading = pose[2] + w * dt
        pose = pose + np.array([v * dt * np.cos(heading), v * dt * np.sin(heading), w * dt])
        actions.append(action[:3])
        poses.append(graph.pose)
        offsets.append(seen_from(graph.nodes[graph.current], graph.pose))
        reckoned.append(pose)
    rows = table(ratslam_reference / "pc_groundtruth.csv.gz")
    truth = [(float(row["x"]), float(row["y"]), float(row["th"])) for row in rows]
    made = little_run(truth, actions, graph.nodes, [], seconds=np.arange(len(truth)) * 0.1)
    return replace(
        made,
        links=graph.links,
        poses=np.array(poses),
        offsets=np.array(offsets),
        dead_reckoning=np.array(reckoned),
    )


@pytest.fixture(scope="module")
def report(run: RatSlamRun) -> MapReport:
    return judge_map(run)


def test_the_reference_map_has_the_published_errors(report: MapReport) -> None:
    assert report.nodes is not None and report.dead_reckoning is not None
    assert (report.nodes.n, report.dead_reckoning.n) == (136, 3840)
    assert report.nodes.rmse_m == pytest.approx(0.175, abs=0.0005)
    assert report.dead_reckoning.rmse_m == pytest.approx(0.494, abs=0.0005)


def test_dead_reckoning_at_the_same_steps_is_little_worse_than_the_map(report: MapReport) -> None:
    assert report.nodes_by_odometry is not None
    assert report.nodes_by_odometry.rmse_m == pytest.approx(0.193, abs=0.0005)


def test_the_whole_trajectory_is_better_on_the_map_than_by_dead_reckoning(
    report: MapReport,
) -> None:
    assert report.trajectory is not None and report.dead_reckoning is not None
    assert report.trajectory.rmse_m < 0.5 * report.dead_reckoning.rmse_m


def test_scipy_finds_the_same_errors(run: RatSlamRun, report: MapReport) -> None:
    made = np.searchsorted(run.stamps_ns, run.node_stamps_ns)
    assert run.truth is not None
    for errors, poses, truth in (
        (report.nodes, run.nodes, run.truth[made]),
        (report.trajectory, run.final_poses, run.truth),
        (report.live, run.poses, run.truth),
        (report.dead_reckoning, run.dead_reckoning, run.truth),
    ):
        flat = [np.pad(p[:, :2] - p[:, :2].mean(0), ((0, 0), (0, 1))) for p in (truth, poses)]
        distance = Rotation.align_vectors(*flat)[1]
        assert errors is not None
        assert errors.rmse_m == pytest.approx(distance / np.sqrt(len(truth)), abs=1e-9)


def test_every_loop_of_the_reference_is_true(report: MapReport) -> None:
    assert (report.node_count, report.link_count) == (136, 136)
    assert (report.loops, report.loop_links) == (272, 1)
    assert report.false_loops == 0
    assert report.linked_revisit_share is not None and report.linked_revisit_share > 0.9
