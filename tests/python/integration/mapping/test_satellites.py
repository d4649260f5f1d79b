# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fixes of a satellite receiver put maps on the globe, and hold odometry that drifts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.geometry.globe import MapOrigin, utm_code, utm_poses
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping.map_file import StoredKeyframe
from fusionslam.registration import Refusal
from fusionslam.sensors.messages import Fix
from rows import rows

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")
pytest.importorskip("pyproj", reason="positions on the globe are an extra")

from pyproj import Transformer

from benchmarks.accuracy.satellites import RECEIVERS, drive_errors
from fusionslam.mapping.fixes import tie_fixes
from fusionslam.mapping.pose_graph import PoseGraph, Solution
from fusionslam.mapping.satellites import Position
from fusionslam.sim.robot import GnssMount

SECOND = 10**9
ARM = np.array([1.0, -0.5, 2.0])
ZONE = Transformer.from_crs(4979, 32632)  # UTM, of latitude and longitude
EAST, NORTH = 456_000.0, 5_428_000.0
SD = np.diag([0.02] * 3 + [0.002] * 3) ** 2


def circle(nodes: int = 60) -> Floats:
    """True poses in UTM, about (EAST, NORTH): a circle of 30 m that climbs by 3 m."""
    steps = exp(np.tile([np.pi, 0, 0.05, 0, 0, np.pi / 30], (nodes, 1)))
    poses = [np.eye(4)]
    for step in steps[1:]:
        poses.append(poses[-1] @ step)
    return np.array(poses)


def geodetic(places: Floats) -> Floats:
    """Latitude, longitude and height of positions in UTM, by pyproj alone."""
    found = ZONE.transform(
        places[:, 0] + EAST, places[:, 1] + NORTH, places[:, 2] + 100, direction="INVERSE"
    )
    return np.stack(found, axis=1)


def measure(true: Floats, sd_m: float = 0.01, seed: int = 0) -> list[Position]:
    antennas = true[:, :3, 3] + true[:, :3, :3] @ ARM
    noise = np.random.default_rng(seed).normal(0, sd_m, antennas.shape)
    covariance = np.eye(3) * sd_m**2
    places = geodetic(antennas + noise)
    return [Position(node, ARM, place, covariance) for node, place in enumerate(places)]


def solved(true: Floats, positions: list[Position], first: Floats | None = None) -> Solution:
    """A graph with true odometry, whose map begins anywhere."""
    graph = PoseGraph()
    graph.add_node(exp(np.array([5.0, 7, 1, 0, 0, 2.0])) if first is None else first)
    for step in inverse(true[:-1]) @ true[1:]:
        node = graph.add_node()
        graph.add_edge(node - 1, node, step, SD, "odometry")
    graph.set_positions(positions)
    return graph.solve()


def utm_of(solution: Solution) -> Floats:
    """Where the solution has its nodes, by pyproj's topocentric coordinates."""
    origin = solution.origin
    assert origin is not None
    angle = np.radians(origin.heading)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x, y, z = solution.poses[:, :3, 3].T
    way = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 "
        f"+lat_0={origin.latitude} +lon_0={origin.longitude} +h_0={origin.altitude} "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=utm +zone=32 +ellps=WGS84"
    )
    east, north, up = way.transform(*(turn @ [x, y]), z)
    return np.stack([east - EAST, north - NORTH, up - 100], axis=1)


def test_a_graph_lies_where_its_fixes_say_and_its_first_node_stays() -> None:
    true = circle()
    solution = solved(true, measure(true))
    np.testing.assert_allclose(utm_of(solution), true[:, :3, 3], atol=0.05)  # UTM's scale: .9996
    np.testing.assert_allclose(solution.poses[0], exp(np.array([5.0, 7, 1, 0, 0, 2.0])), atol=2e-3)


def test_parts_that_nothing_joins_lie_where_their_fixes_say() -> None:
    """Two drives, and a third one of which no fix tells."""
    ways, graph, positions = [circle(), circle(40), circle(5)], PoseGraph(), []
    for way, measured in zip(ways, (measure(ways[0]), measure(ways[1], seed=1), []), strict=True):
        first = len(graph)
        graph.add_node(exp(np.array([first, 7.0, 1, 0, 0, 2.0])))
        for step in inverse(way[:-1]) @ way[1:]:
            node = graph.add_node()
            graph.add_edge(node - 1, node, step, SD, "odometry")
        positions += [replace(each, node=each.node + first) for each in measured]
    graph.set_positions(positions)
    solution = graph.solve()
    assert solution.places.keys() == {0, 60}
    for part, way in zip((0, 60), ways, strict=False):
        here = Solution(solution.poses[solution.parts == part], np.zeros(len(way), int), (), ())
        here = replace(here, places={0: solution.places[part]})
        np.testing.assert_allclose(utm_of(here), way[:, :3, 3], atol=0.05)
    np.testing.assert_allclose(solution.poses[100], exp(np.array([100, 7.0, 1, 0, 0, 2.0])))


def test_poses_in_utm_look_where_the_projection_has_what_is_ahead() -> None:
    origin = MapOrigin(latitude=49.0, longitude=8.1, altitude=100.0, heading=25.0)
    poses = circle() @ exp(np.array([300.0, 0, 0, 0, 0, 0]))
    placed = utm_poses(poses, origin, utm_code(origin))
    angle = np.radians(25.0)
    ahead = poses[:, :3, 3] + 10 * poses[:, :3, 0]
    x, y = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ ahead.T[:2]
    way = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0=49 +lon_0=8.1 +h_0=100 "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=utm +zone=32 +ellps=WGS84"
    )
    found = np.stack(way.transform(x, y, ahead[:, 2]), axis=1)
    np.testing.assert_allclose(found - placed[:, :3, 3], 10 * placed[:, :3, 0], atol=5e-3)
    for place, code in (((0, -180), 32601), ((-33, 151.2), 32756), ((50, 180), 32660)):
        assert utm_code(MapOrigin(latitude=place[0], longitude=place[1])) == code
    with pytest.raises(DataError, match="84"):
        utm_code(MapOrigin(latitude=85, longitude=0))


def test_fixes_that_are_far_off_do_not_count() -> None:
    true = circle()
    positions = measure(true, 0.3)
    for k in (3, 20, 21, 22, 47):
        wrong = true[[k], :3, 3] + [[40.0, -30.0, 5.0]]
        positions[k] = replace(positions[k], place=geodetic(wrong)[0])
    off = utm_of(solved(true, positions)) - true[:, :3, 3]
    assert np.linalg.norm(off, axis=1).max() < 0.3


def test_fixes_that_claim_too_much_bend_no_odometry() -> None:
    """They err by 2 m and state 1 cm: odometry, which knows the steps, says so."""
    true = circle()
    positions = [replace(p, covariance=np.eye(3) * 1e-4) for p in measure(true, 2.0)]
    solution = solved(true, positions)
    steps = inverse(solution.poses[:-1]) @ solution.poses[1:]
    off = steps[:, :3, 3] - (inverse(true[:-1]) @ true[1:])[:, :3, 3]
    assert solution.origin is not None and np.abs(off).max() < 0.05


@rows(
    "nodes, kept, sd_m, code",
    [(60, 9, 0.1, "few-fixes"), (12, 12, 10.0, "no-heading"), (60, 60, 0.1, "fixes-disagree")],
)
def test_a_graph_stays_where_it_is_if_its_fixes_do_not_tell(
    nodes: int, kept: int, sd_m: float, code: str
) -> None:
    true = circle(nodes)
    positions = measure(true, sd_m)[:kept]
    if code == "fixes-disagree":  # the receiver of another robot, which turns the other way
        places = geodetic(true[:, :3, 3] * [1, -1, 1])
        positions = [replace(p, place=q) for p, q in zip(positions, places, strict=True)]
    solution, alone = solved(true, positions), solved(true, [])
    assert solution.origin is None and isinstance(solution.unplaced, Refusal)
    assert solution.unplaced.code == code
    np.testing.assert_array_equal(solution.poses, alone.poses)


@rows(
    "changes, code",
    [
        ({"arm": np.full(3, np.nan)}, "not-finite"),
        ({"place": np.zeros(2)}, "shape"),
        ({"covariance": np.zeros((3, 3))}, "not-positive-definite"),
    ],
)
def test_positions_that_cannot_be_are_named(changes: dict[str, Any], code: str) -> None:
    with pytest.raises(FusionSlamError) as error:
        replace(measure(circle(1))[0], **changes)
    assert error.value.code == code


@pytest.mark.slow
@rows("loops, bound_m", [(False, 1.0), (True, 0.5)])
def test_two_kilometres_of_drifting_odometry_are_held(loops: bool, bound_m: float) -> None:
    mount = GnssMount(**RECEIVERS["and 10 % outliers of 50 m, gaps of 60 s"])
    alone, placed = drive_errors(mount, 1, loops)
    assert placed <= bound_m < alone


def keyframes(count: int = 5) -> list[StoredKeyframe]:
    """At 1 m/s along x, a second apart; the cloud is 0.5 m above the robot's centre."""
    mount = exp(np.array([0, 0, 0.5, 0, 0, 0]))
    poses = [exp(np.array([float(k), 0, 0, 0, 0, 0])) for k in range(count)]
    return [StoredKeyframe(k, 1, k, k * SECOND, p @ mount, mount) for k, p in enumerate(poses)]


def fix(seconds: float, **changes: Any) -> Fix:
    values = {"position": np.array([49.0, 8.4, 100.0]), "covariance": np.eye(3)} | changes
    return Fix(stamp_ns=round(seconds * SECOND), frame_id="gps", **values)


ANTENNA = exp(np.array([*ARM, 0, 0, 0]))
ONE_STRETCH = dict.fromkeys(range(5), 0)


def test_fixes_are_tied_to_the_keyframe_before_them_by_odometry() -> None:
    tied = tie_fixes([fix(2.25), fix(0.0)], keyframes(), ONE_STRETCH, ANTENNA)
    assert [each.node for each in tied] == [0, 2]
    np.testing.assert_allclose(tied[0].arm, ARM - np.array([0, 0, 0.5]), atol=1e-12)
    np.testing.assert_allclose(tied[1].arm, ARM + np.array([0.25, 0, -0.5]), atol=1e-12)


def test_fixes_tell_nothing_without_a_position_or_odometry_or_soon_after_another() -> None:
    told = [fix(0.5), fix(0.6), fix(1.2, position=None), fix(2.5), fix(3.5), fix(99.0)]
    broken = {0: 0, 1: 0, 2: 0, 3: 3, 4: 3}
    assert [p.node for p in tie_fixes(told, keyframes(), broken, ANTENNA)] == [0, 3]


def test_a_fix_that_states_no_covariance_counts_as_a_rough_one() -> None:
    (tied,) = tie_fixes([fix(0.5, covariance=None)], keyframes(), ONE_STRETCH, ANTENNA)
    np.testing.assert_array_equal(tied.covariance, np.diag([9, 9, 36]))


@rows(
    "fixes, code",
    [
        ([], "no-fixes"),
        ([fix(1.0, position=None)], "no-fixes"),
        ([fix(3601.0), fix(3602.0)], "other-clock"),
    ],
)
def test_fixes_that_place_no_map_are_named(fixes: list[Fix], code: str) -> None:
    with pytest.raises(DataError) as error:
        tie_fixes(fixes, keyframes(), ONE_STRETCH, ANTENNA)
    assert error.value.code == code
    assert error.value.fields == (() if code == "no-fixes" else ("3601.000",))
