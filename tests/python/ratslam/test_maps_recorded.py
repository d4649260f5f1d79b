# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of recorded worlds, whose views are recognised by what sees them quickly."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.ratslam_courses import Course, with_false_matches
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig
from fusionslam.pipelines.maps import run_ratslam
from fusionslam.pipelines.tours import open_tour
from fusionslam.ratslam import RatSlamConfig

ROBUST = RatSlamConfig(preset="robust")


@pytest.fixture(scope="module")
def warehouse(test_data: Path) -> Course:
    return Course(open_tour(test_data / "recordings" / "warehouse.npz"), "objects")


def errors_of(report: MapReport) -> tuple[float, float, float]:
    """RMSE of the nodes, of dead reckoning at the same moments, and of the final trajectory."""
    assert report.nodes is not None
    assert report.nodes_by_odometry is not None
    assert report.trajectory is not None
    return report.nodes.rmse_m, report.nodes_by_odometry.rmse_m, report.trajectory.rmse_m


def test_views_that_are_looked_at_once_give_the_map_of_a_run(
    warehouse: Course, test_data: Path
) -> None:
    recording = test_data / "recordings" / "warehouse.npz"
    again = run_ratslam(recording, "objects", "truth+noise", ROBUST, errors=DRIFT)
    once = warehouse.drive(ROBUST, DRIFT)
    assert np.array_equal(again.nodes, once.nodes)
    assert np.array_equal(again.links, once.links)
    assert np.array_equal(again.final_poses, once.final_poses)


def test_the_map_of_the_warehouse_beats_its_odometry_and_the_original(warehouse: Course) -> None:
    report = judge_map(warehouse.drive(ROBUST, DRIFT))
    nodes, reckoned, trajectory = errors_of(report)
    assert nodes < 0.6 * reckoned
    assert trajectory < 0.6 * reckoned
    assert report.false_loops == 0
    assert report.linked_revisits > 0.8 * report.revisits
    original = judge_map(warehouse.drive(RatSlamConfig(preset="openratslam"), DRIFT))
    assert nodes < 0.6 * errors_of(original)[0]


def test_odometry_without_errors_suffers_little(warehouse: Course) -> None:
    nodes, reckoned, _ = errors_of(judge_map(warehouse.drive(ROBUST, OdometryConfig())))
    assert reckoned < 0.01
    assert nodes < 0.1


def test_wrong_views_in_the_warehouse_do_not_fold_its_map(warehouse: Course) -> None:
    told, wrong = with_false_matches(warehouse, 0.2)
    assert wrong > 50
    report = judge_map(warehouse.drive(ROBUST, DRIFT, told))
    nodes, reckoned, _ = errors_of(report)
    assert nodes < 0.75 * reckoned
    # One that is no farther off than odometry may be is believed.
    assert report.false_loops < 0.05 * wrong
