# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of whole courses, simulated and recorded, and the paths that they follow."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.ratslam_courses import Course, with_false_matches
from drives import LittleCourse, lap_course
from fusionslam.config import merged
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig
from fusionslam.pipelines.drives import open_drive
from fusionslam.pipelines.maps import run_ratslam
from fusionslam.ratslam import RatSlamConfig, Sighting
from rows import rows

ROBUST = RatSlamConfig(preset="robust")
ORIGINAL = RatSlamConfig(preset="openratslam")
UNCHECKED = merged(ROBUST, {"map": {"sigmas": 1e6}})


def metres(report: MapReport) -> tuple[float, float]:
    """RMSE of the nodes on the map, and by dead reckoning."""
    return report.nodes.rmse_m, report.nodes_by_odometry.rmse_m


@cache
def little_course(measured: bool = True) -> LittleCourse:
    return lap_course(2, measured=measured)


@pytest.mark.parametrize(
    ("measured", "times"), [(True, 2), pytest.param(False, 1, marks=pytest.mark.nightly)]
)
def test_a_map_beats_the_drift_and_the_original(times: int, measured: bool) -> None:
    course = little_course(measured).add_drift(times)
    found, reckoned = metres(course.judge(ROBUST))
    original, _ = metres(course.judge(ORIGINAL))
    assert found < 0.75 * reckoned and found < 0.9 * original


@rows("measured, limit_m", [(True, 0.02), (False, 0.08)])
def test_views_leave_exact_odometry_exact(measured: bool, limit_m: float) -> None:
    # Views that tell only their id cost centimetres.
    found, reckoned = metres(little_course(measured).judge(ROBUST))
    assert reckoned < 0.001
    assert found < limit_m


def check_false_loops(share: float) -> None:
    course = little_course().add_drift().mislead(share)
    report = course.judge(ROBUST)
    found, reckoned = metres(report)
    assert report.false_loops == 0 < report.refused
    assert found < 0.5 * reckoned
    unchecked, original = (metres(course.judge(config))[0] for config in (UNCHECKED, ORIGINAL))
    assert min(unchecked, original) > 5 * found


@pytest.mark.slow
def test_false_loops_do_not_fold_the_map_because_they_are_checked() -> None:
    check_false_loops(0.5)


@pytest.mark.nightly
def test_few_false_loops_do_not_fold_the_map_either() -> None:
    check_false_loops(0.2)


def test_rooms_that_all_look_alike_do_not_fold_the_map() -> None:
    # A corridor whose second half looks like the first, in the same order: the loops agree.
    course = lap_course(1)
    half = len(course.sightings) // 2
    alike = [course.sightings[i % half].view_id for i in range(len(course.sightings))]
    told = [Sighting(one.stamp_ns, id) for one, id in zip(course.sightings, alike, strict=True)]
    twins = replace(course, sightings=told)
    found, _ = metres(twins.judge(ROBUST))
    assert found < 0.1
    assert metres(twins.judge(ORIGINAL))[0] > 5 * found


@pytest.fixture(scope="module")
def warehouse(test_data: Path) -> Course:
    return Course(open_drive(test_data / "recordings" / "warehouse.npz"), "objects")


def errors_of(report: MapReport) -> tuple[float, float, float]:
    """RMSE of the nodes, of dead reckoning at the same moments, and of the final trajectory."""
    return *metres(report), report.trajectory.rmse_m


@pytest.mark.nightly
def test_the_map_of_the_warehouse_beats_its_odometry_and_the_original(
    warehouse: Course, test_data: Path
) -> None:
    run = warehouse.run(ROBUST, DRIFT)
    recording = test_data / "recordings" / "warehouse.npz"
    again = run_ratslam(recording, "objects", "truth+noise", ROBUST, errors=DRIFT)
    for name in ("nodes", "links", "final_poses"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    report = judge_map(run)
    nodes, reckoned, trajectory = errors_of(report)
    assert nodes < 0.6 * reckoned
    assert trajectory < 0.6 * reckoned
    assert report.false_loops == 0 and report.linked_revisits > 0.8 * report.revisits
    assert nodes < 0.6 * errors_of(judge_map(warehouse.run(ORIGINAL, DRIFT)))[0]
    # Odometry without errors suffers little.
    nodes, reckoned, _ = errors_of(judge_map(warehouse.run(ROBUST, OdometryConfig())))
    assert reckoned < 0.01
    assert nodes < 0.1


@pytest.mark.nightly
def test_wrong_views_in_the_warehouse_do_not_fold_its_map(warehouse: Course) -> None:
    told, wrong = with_false_matches(warehouse, 0.2)
    assert wrong > 50
    report = judge_map(warehouse.run(ROBUST, DRIFT, told))
    nodes, reckoned, _ = errors_of(report)
    assert nodes < 0.75 * reckoned
    # A loop within the uncertainty of odometry is accepted.
    assert report.false_loops < 0.05 * wrong
