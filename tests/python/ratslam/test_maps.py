# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of the robust preset hold against drifting odometry, and against false loops."""

import numpy as np
import pytest

from fusionslam.config import merged
from fusionslam.evaluation import MapReport
from fusionslam.ratslam import ExperienceMap, RatSlam, RatSlamConfig, Sighting, StampOrder
from fusionslam.ratslam.events import Event
from little_courses import LittleCourse, laps

ROBUST = RatSlamConfig(preset="robust")
ORIGINAL = RatSlamConfig(preset="openratslam")
UNCHECKED = merged(ROBUST, {"map": {"sigmas": 1e6}})


def metres(report: MapReport) -> tuple[float, float]:
    """RMSE of the nodes on the map, and by dead reckoning."""
    assert report.nodes is not None
    assert report.nodes_by_odometry is not None
    return report.nodes.rmse_m, report.nodes_by_odometry.rmse_m


@pytest.mark.parametrize("measured", [True, False])
@pytest.mark.parametrize("times", [1, 2])
def test_a_map_beats_the_drift_and_the_original(times: int, measured: bool) -> None:
    course = laps(measured=measured).drifting(times)
    found, reckoned = metres(course.judged(ROBUST))
    original, _ = metres(course.judged(ORIGINAL))
    assert found < 0.75 * reckoned
    assert found < 0.9 * original


def test_views_that_say_where_they_are_leave_exact_odometry_exact() -> None:
    found, reckoned = metres(laps().judged(ROBUST))
    assert reckoned < 0.001
    assert found < 0.02


def test_views_that_only_say_what_they_are_cost_exact_odometry_centimetres() -> None:
    found, _ = metres(laps(measured=False).judged(ROBUST))
    assert found < 0.08


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_false_loops_do_not_fold_the_map(share: float) -> None:
    course = laps().drifting().misled(share)
    report = course.judged(ROBUST)
    found, reckoned = metres(report)
    assert report.false_loops == 0
    assert found < 0.5 * reckoned


def test_it_is_the_check_that_keeps_the_map_from_folding() -> None:
    course = laps().drifting().misled(0.2)
    report = course.judged(ROBUST)
    assert report.refused > 0
    unchecked, _ = metres(course.judged(UNCHECKED))
    original, _ = metres(course.judged(ORIGINAL))
    assert min(unchecked, original) > 5 * metres(report)[0]


def test_rooms_that_all_look_alike_do_not_fold_the_map() -> None:
    # A corridor whose second half looks like the first, in the same order: the loops agree.
    course = twins(laps(1))
    found, _ = metres(course.judged(ROBUST))
    assert found < 0.1
    assert metres(course.judged(ORIGINAL))[0] > 5 * found


def twins(course: LittleCourse) -> LittleCourse:
    """The second half of a lap, views in the same order as in the first."""
    half = len(course.sightings) // 2
    told = [
        Sighting(one.stamp_ns, course.sightings[i % half].view_id)
        for i, one in enumerate(course.sightings)
    ]
    return LittleCourse(course.speeds, course.poses, told)


def test_the_map_is_the_same_however_late_views_arrive() -> None:
    course = laps(2).drifting().misled(0.1)
    at_once = mapped(course, delay_s=0.0)
    late = mapped(course, delay_s=0.4)
    assert np.array_equal(at_once.nodes, late.nodes)
    assert np.array_equal(at_once.links, late.links)


def mapped(course: LittleCourse, delay_s: float) -> ExperienceMap:
    """What comes of events that arrive in another order than that of their stamps."""
    arriving: list[tuple[float, Event]] = [(motion.stamp_ns, motion) for motion in course.motions]
    arriving += [(view.stamp_ns + delay_s * 1e9, view) for view in course.sightings]
    slam, order = RatSlam(ROBUST), StampOrder(wait=0.5)
    for _, event in sorted(arriving, key=lambda pair: pair[0]):
        for ready in order.add(event):
            slam.step(ready)
    for ready in order.flush():
        slam.step(ready)
    return slam.map
