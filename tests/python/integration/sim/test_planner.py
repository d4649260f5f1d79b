# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drives: within a robot's limits, within the free space, through all of it and back."""

from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.accuracy.drives import exceeds, measure_coverage, revisits
from error_codes import has_code
from fusionslam.config import merged
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.indoor import INDOOR_WORLDS, make_indoor
from fusionslam.sim.motion.clearance import check_trajectory
from fusionslam.sim.motion.occupancy import OccupancyMap, largest_part
from fusionslam.sim.motion.path_following import DriveLimits, drive
from fusionslam.sim.motion.planner import PlanConfig, plan_trajectory
from fusionslam.sim.motion.routes import RouteFinder, round_trip, tour_cost
from fusionslam.sim.motion.smoothing import resample_path, smooth_path
from rows import rows

Array = NDArray[np.float64]
CELL = 0.1


def grid_of(occupied: NDArray[np.bool_]) -> OccupancyMap:
    return OccupancyMap(occupied, largest_part(~occupied), CELL, (0.0, 0.0))


def two_rooms() -> OccupancyMap:
    """10 m x 6 m with walls around, and one between x = 5.0 and 5.1 with a door at y = 2 .. 3.2."""
    occupied = np.zeros((60, 100), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[:, 50] = True
    occupied[20:32, 50] = False
    return grid_of(occupied)


def sideways(trajectory: Trajectory) -> Array:
    """Metres of each step across the heading in its middle, and forwards, (2, N - 1)."""
    yaw = (trajectory.yaw[1:] + trajectory.yaw[:-1]) / 2
    dx, dy = np.diff(trajectory.x), np.diff(trajectory.y)
    across: Array = np.stack(
        [np.cos(yaw) * dy - np.sin(yaw) * dx, np.cos(yaw) * dx + np.sin(yaw) * dy]
    )
    return across


@given(
    st.integers(0, 2**32 - 1),
    st.integers(2, 8),
    st.sampled_from([0.1, 0.5, 2.0]),
    st.tuples(st.floats(0.2, 3), st.floats(0.3, 4), st.floats(0.2, 3), st.floats(0.5, 6)),
)
@settings(max_examples=60, deadline=None)
def test_any_path_is_driven_forwards_within_the_limits(
    seed: int, count: int, size: float, most: tuple[float, float, float, float]
) -> None:
    steps = np.random.default_rng(seed).uniform(-size, size, (count, 2))
    points = np.cumsum(steps, axis=0)
    names = ("max_speed_m_s", "max_turn_rad_s", "max_acceleration_m_s2")
    limits = DriveLimits(**dict(zip((*names, "max_turn_acceleration_rad_s2"), most, strict=True)))
    found = drive([points, points[::-1]], limits)
    assert max(exceeds(found, limits).values()) < 1 + 1e-6, exceeds(found, limits)
    assert np.allclose([found.x[0], found.y[0]], points[0])
    assert np.allclose([found.x[-1], found.y[-1]], points[0], atol=1e-6)
    across, forwards = sideways(found)
    assert forwards.min() > -1e-6
    assert np.abs(across).max() < 1e-3


def test_drives_take_the_time_of_a_trapezoid_and_turn_on_the_spot() -> None:
    limits = DriveLimits(max_speed_m_s=0.5, max_acceleration_m_s2=0.25, rate_hz=100.0)
    found = drive([[(0, 0), (5, 0)]], limits)
    # 2 s and 0.5 m to speed up, as much to slow down, 4 m at 0.5 m/s; 2 % of caution.
    assert found.duration_s == pytest.approx(12.0, rel=0.02)
    assert found.x[np.searchsorted(found.seconds, 6.0)] == pytest.approx(2.5, abs=0.05)
    assert not np.ptp(found.y)
    # Between paths the robot turns the shorter way.
    found = drive([[(0, 0), (1, 0)], [(1, 0), (1, -1)], [(1, -1), (1, 0)]], DriveLimits())
    resting = np.hypot(np.diff(found.x), np.diff(found.y)) < 1e-9
    turned = np.diff(found.yaw)[resting]
    # To the right by a quarter, then half round: what is turned on the way is on the spot.
    assert turned.sum() == pytest.approx(found.yaw[-1] - found.yaw[0], abs=0.02)
    assert abs(found.yaw[-1] - found.yaw[0] + np.pi / 2) == pytest.approx(np.pi, abs=1e-6)
    assert np.cos(found.yaw[-1] - np.pi / 2) == pytest.approx(1)


@given(arrays(np.bool_, (7, 8)))
@settings(max_examples=40, deadline=None)
def test_ways_are_the_cheapest_of_all(occupied: NDArray[np.bool_]) -> None:
    occupied[3, 3:5] = False
    grid = grid_of(occupied)
    finder = RouteFinder(grid, 0.05)
    rows, columns = np.nonzero(grid.reachable)
    weight = 1 + 3 * (1 - np.minimum(grid.clearance()[rows, columns] / 0.5, 1))
    apart = np.hypot(rows[:, None] - rows, columns[:, None] - columns) * CELL
    step = np.where(apart < 1.5 * CELL, apart * (weight[:, None] + weight) / 2, np.inf)
    best = step.copy()
    for middle in range(len(rows)):  # Floyd and Warshall
        best = np.minimum(best, best[:, [middle]] + best[[middle]])
    assert np.allclose(finder.costs(0), best[0])
    for end in range(len(rows)):
        way = finder.way(0, end)
        assert (way[0], way[-1]) == (0, end)
        assert step[way[:-1], way[1:]].sum() == pytest.approx(best[0, end])


def way_between(grid: OccupancyMap, places: list[tuple[float, float]], clearance: float) -> Array:
    """The cells' middles, (N, 2), on the way past some places."""
    finder = RouteFinder(grid, clearance)
    legs = [finder.way(finder.cell(a), finder.cell(b)) for a, b in pairwise(places)]
    chain = np.concatenate([legs[0][:1], *(leg[1:] for leg in legs)])
    return np.stack([finder.x[chain], finder.y[chain]], axis=1)


def test_routes_go_through_the_middle_of_doors_where_a_robot_can_be() -> None:
    route = way_between(two_rooms(), [(1.0, 5.0), (9.0, 5.0), (9.0, 1.0)], 0.3)
    assert np.allclose(route[[0, -1]], [(1.05, 5.05), (9.05, 1.05)])
    assert np.abs(np.diff(route, axis=0)).max() <= CELL + 1e-9
    at_door = route[np.abs(route[:, 0] - 5.05) < 0.06]
    assert np.abs(at_door[:, 1] - 2.6).max() <= 0.1
    # In the wall, and behind a door that is too narrow.
    for end, clearance in (((5.05, 5.0), 0.3), ((9.0, 5.0), 0.7)):
        with pytest.raises(DataError) as error:
            way_between(two_rooms(), [(1.0, 5.0), end], clearance)
        assert error.value.code == "unreachable"
        assert tuple(map(float, error.value.fields)) == end
    with pytest.raises(DataError, check=has_code("no-room")):
        way_between(two_rooms(), [(1.0, 5.0), (2.0, 5.0)], 4.0)


@rows("widths", [(0, 0), (2, 4)])
def test_a_smoothed_path_stays_within_its_bounds_however_narrow(widths: tuple[int, int]) -> None:
    corridor = np.zeros((80, 80), bool)
    corridor[40, 10:41] = corridor[40:70, 40] = True
    room, bounds = (
        grid_of(~(ndimage.binary_dilation(corridor, iterations=w) if w else corridor))
        for w in widths
    )
    path = np.array([(1.05, 4.05), (4.05, 4.05), (4.05, 6.95)])
    found = smooth_path(path, room, bounds, 0.3, np.random.default_rng(1))
    assert np.array_equal(found[[0, -1]], path[[0, -1]])
    assert bounds.is_free(*resample_path(found, 0.01).T).all()
    assert np.linalg.norm(np.diff(found, axis=0), axis=1).max() < 0.1


@rows("seed", range(5))
def test_a_round_trip_is_hardly_longer_than_the_shortest(seed: int) -> None:
    places = np.random.default_rng(seed).uniform(0, 10, (8, 2))
    costs = np.linalg.norm(places[:, None] - places, axis=2)
    found = round_trip(costs, np.inf)
    assert sorted(found) == list(range(8))
    orders = np.array([(0, *rest) for rest in permutations(range(1, 8))])
    best = costs[orders, np.roll(orders, -1, axis=1)].sum(axis=1).min()
    assert tour_cost(found, costs) <= 1.05 * best
    short = round_trip(costs, best / 2, start=3)
    assert 2 <= len(short) < 8
    assert tour_cost(short, costs) <= best / 2 or len(short) == 2


@rows("seed", [0, 1])
def test_a_planned_drive_sees_all_rooms_and_comes_back_in_both_directions(seed: int) -> None:
    grid, config = two_rooms(), PlanConfig(seed=seed, spacing_m=2.0)
    found = plan_trajectory(grid, config)
    check_trajectory(found, grid, config.clearance_m)
    assert max(exceeds(found, config.limits).values()) < 1 + 1e-6
    assert measure_coverage(found, grid.inflate(config.clearance_m), within_m=1.5) > 0.9
    assert min(revisits(found)) > 0.25


def test_a_seed_decides_a_drive_to_the_last_bit() -> None:
    one, again, other = (
        plan_trajectory(two_rooms(), PlanConfig(seed=seed, length_m=30.0)) for seed in (1, 1, 2)
    )
    for name in ("seconds", "x", "y", "yaw"):
        assert np.array_equal(getattr(one, name), getattr(again, name))
    assert len(one) != len(other) or not np.array_equal(one.x, other.x)
    assert [one.length_m, other.length_m] == pytest.approx([30.0] * 2, abs=0.2)


def test_plans_without_room_or_sense_are_refused() -> None:
    for values, code in (({"clearance_m": 3.0}, "no-room"), ({"spacing_m": 50.0}, "no-tour")):
        with pytest.raises(DataError, check=has_code(code)):
            plan_trajectory(two_rooms(), PlanConfig(**values))
    with pytest.raises(ConfigError, match="again"):
        merged(PlanConfig(), {"again": 0.7, "back": 0.7})
    with pytest.raises(ConfigError, match=r"limits\.max_speed_m_s"):
        merged(PlanConfig(), {"limits": {"max_speed_m_s": 0.0}})


@pytest.mark.parametrize(
    ("name", "shares"),
    [("house", 0.3), pytest.param("warehouse", 0.25, marks=pytest.mark.nightly)],
)
@pytest.mark.slow
def test_drives_through_furnished_worlds_keep_clear_and_come_back(name: str, shares: float) -> None:
    grid = make_indoor(INDOOR_WORLDS[name].config()).map
    config = PlanConfig(length_m=150.0)
    found = plan_trajectory(grid, config)
    check_trajectory(found, grid, config.clearance_m)
    assert max(exceeds(found, config.limits).values()) < 1 + 1e-6
    assert min(revisits(found)) > shares
