# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""People and cars: never in a wall or in the robot's way, each scan says what is on them."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from error_codes import has_code
from fusionslam.config import merged
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sensors.messages import Scan
from fusionslam.sim import SimulationConfig, simulate
from fusionslam.sim.motion.occupancy import OccupancyMap, occupancy_of
from fusionslam.sim.movers import Mover
from fusionslam.sim.town.layout import ROAD_M, TownConfig, make_town
from fusionslam.sim.town.route import lanes_around_blocks
from fusionslam.sim.traffic import MoversConfig, plan_movers
from fusionslam.sim.world import World, scene_of
from worlds import EVEN, PLAIN, bare_robot, block, floor, hall, straight

RADIUS_M = 0.22
PEOPLE = MoversConfig(people=4)
Movers = tuple[Mover, ...]


def people(seed: int) -> Movers:
    world = hall()
    grid = occupancy_of(world.visual)
    return plan_movers(PEOPLE, world, grid, straight(12.0), RADIUS_M, seed, 12.0)


def corners(mover: Mover, seconds: float) -> np.ndarray:
    (pose,) = mover.poses(np.array([seconds]))
    return mover.mesh.triangles.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]


def test_people_keep_clear_of_walls_furniture_each_other_and_the_robot() -> None:
    found = people(1)
    assert len(found) == 4
    for seconds in np.linspace(0, 12, 61):
        robot = np.array(straight(12.0).places(seconds)[:2])
        for person in found:
            x, y, z = corners(person, seconds).T
            assert np.abs(x).max() < 6 and np.abs(y).max() < 4
            assert z.min() == pytest.approx(0, abs=0.05) and 1.5 < z.max() < 1.95
            red = (x > 2) & (x < 3) & (np.abs(y) < 0.5)
            blue = (x > -3) & (x < -2) & (y > 2) & (y < 3)
            assert not (red | blue).any()
            assert np.hypot(x - robot[0], y - robot[1]).min() > RADIUS_M
    for first, second in combinations(found, 2):
        apart = np.linalg.norm(first.track.places - second.track.places, axis=1)
        assert apart.min() > 0.6


def test_people_walk_at_their_speed_and_look_where_they_go() -> None:
    for person in people(1):
        moves = np.diff(person.track.places, axis=0)
        lengths = np.linalg.norm(moves, axis=1)
        speed = lengths / np.diff(person.seconds)
        assert 0.8 * 1.2 < speed.max() < 1.2 * 1.2 and speed.mean() > 0.6
        yaw = person.track.yaw[:-1][lengths > 0]
        ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        np.testing.assert_allclose(ahead, moves[lengths > 0] / lengths[lengths > 0][:, None])


def test_the_same_seed_plans_the_same_people() -> None:
    first, again, other = (people(seed) for seed in (1, 1, 2))
    for a, b, c in zip(first, again, other, strict=True):
        assert np.array_equal(a.track.places, b.track.places)
        assert np.array_equal(a.mesh.triangles, b.mesh.triangles)
        assert not np.array_equal(a.track.places, c.track.places)


def test_a_scan_among_people_is_that_of_the_empty_hall_where_nobody_stands() -> None:
    robot = bare_robot(
        rings=8, azimuths=180, noise_m=0.02, dropout=0.1, scan_motion=True, fields=("moving", "t")
    )
    config = SimulationConfig(seed=3, seconds=1.0)
    crowded = merged(config, {"movers": {"people": 4}})
    alone, among = (
        [e.message for e in simulate(hall(), robot, straight(), each) if e.topic == "/points"]
        for each in (config, crowded)
    )
    hidden = 0
    for empty, full in zip(alone, among, strict=True):
        assert isinstance(empty, Scan) and isinstance(full, Scan)
        moving = full.fields["moving"].astype(bool)
        hidden += moving.sum()
        assert not empty.fields["moving"].any()
        there = set(map(bytes, empty.points))
        assert all(bytes(point) in there for point in full.points[~moving])
        assert not any(bytes(point) in there for point in full.points[moving])
    assert hidden > 50


@pytest.fixture(scope="module")
def crossing() -> tuple[World, OccupancyMap, Trajectory]:
    """A field with a square lane, which a robot crosses twice."""
    lane = lanes_around_blocks((1, 1), 44.0)[0]
    scene = scene_of([floor(60.0), block("post", (20, 20, 0), (21, 21, 2))], [PLAIN], EVEN)
    world = World(name="field", visual=scene, collision=scene, lanes=[lane])
    grid = OccupancyMap(np.zeros((240, 240), bool), np.ones((240, 240), bool), 0.5, (-60.0, -60.0))
    times = np.array([0.0, 40.0])
    return world, grid, Trajectory(times, -20 + 2.0 * times, np.full(2, 15.0), np.zeros(2))


def test_cars_drive_on_their_lane_and_wait_for_the_robot_and_each_other(
    crossing: tuple[World, OccupancyMap, Trajectory],
) -> None:
    world, grid, way = crossing
    cars = plan_movers(MoversConfig(cars=3), world, grid, way, 1.0, 2, 40.0)
    lane = world.lanes[0]
    waited = 0
    for car in cars:
        apart = np.linalg.norm(car.track.places[:, None] - lane[None], axis=2).min(axis=1)
        assert apart.max() < 0.1
        moves = np.diff(car.track.places, axis=0)
        speed = np.linalg.norm(moves, axis=1) / np.diff(car.seconds)
        assert 0.75 * 8 < speed.max() < 1.2 * 8 * 1.01
        waited += int((speed < 0.1).sum())
        yaw = car.track.yaw[:-1][speed > 1]
        ahead = np.einsum("ij,ij->i", moves[speed > 1], np.stack([np.cos(yaw), np.sin(yaw)], 1))
        assert (ahead > 0.95 * np.linalg.norm(moves[speed > 1], axis=1)).all()
    assert waited
    for seconds in np.linspace(0, 40, 101):
        robot = np.array(way.places(seconds)[:2])
        outlines = [np.unique(corners(car, seconds)[:, :2], axis=0) for car in cars]
        assert min(np.hypot(*(each - robot).T).min() for each in outlines) > 1.0
        for one, other in combinations(outlines, 2):
            if np.abs(one[0] - other[0]).max() < 8:
                assert np.linalg.norm(one[:, None] - other[None], axis=2).min() > 0.2


@pytest.mark.slow
def test_lanes_keep_to_the_right_of_their_streets_and_off_parked_cars() -> None:
    config = TownConfig(blocks=(1, 1), block_m=44.0, parked_cars=1.0)
    grid = occupancy_of(
        make_town(config), low_m=0.2, high_m=2.0, resolution_m=0.25, start=(0.0, 0.0)
    )
    lanes = lanes_around_blocks(config.blocks, config.block_m)
    assert len(lanes) == 2
    for lane in lanes:
        ahead = np.roll(lane, -1, axis=0) - lane
        assert np.linalg.norm(ahead, axis=1).max() < 0.2
        # Straight parts are within a lane of the right half of a street.
        for axis in (0, 1):
            along = np.abs(ahead[:, axis]) > 0.999 * np.linalg.norm(ahead, axis=1)
            off = (lane[along, 1 - axis] + ROAD_M) % config.block_m - ROAD_M
            right = -off if axis == 0 else off
            right = right * np.sign(ahead[along, axis])
            assert (right > 1.0).all() and (right < ROAD_M / 2 - 0.9).all()
        row, column, inside = grid.cells(*lane.T)
        assert inside.all() and grid.clearance()[row, column].min() > 0.9


def test_an_error_says_that_there_is_no_room_or_no_lane() -> None:
    world, way = hall(), straight(10.0)
    grid = occupancy_of(world.visual)
    with pytest.raises(DataError, match=r"movers\.cars", check=has_code("no-room", "cars")):
        plan_movers(MoversConfig(cars=1), world, grid, way, RADIUS_M, 1, 10.0)
    nowhere = replace(grid, reachable=np.zeros_like(grid.reachable))
    with pytest.raises(
        DataError, match=r"movers\.people is 2", check=has_code("no-room", "people")
    ):
        plan_movers(MoversConfig(people=2), world, nowhere, way, RADIUS_M, 1, 10.0)
