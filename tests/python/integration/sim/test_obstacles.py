# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Moving boxes: never in a wall, never in the robot's way, seen by every sensor."""

from itertools import combinations

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from error_codes import has_code
from fusionslam.errors import DataError
from fusionslam.sim.lidar import LidarMount, lidar_rays, scan
from fusionslam.sim.motion.occupancy import OccupancyMap, occupancy_of
from fusionslam.sim.movers import Body, Crowd, Mover
from fusionslam.sim.obstacles import ObstacleConfig, plan_obstacles, speckles
from fusionslam.sim.scene import RayCaster
from worlds import block, hall, straight

THREE = ObstacleConfig(number=3)
Boxes = tuple[Mover, ...]


@pytest.fixture(scope="module")
def grid() -> OccupancyMap:
    return occupancy_of(hall().visual)


@pytest.fixture(scope="module")
def obstacles(grid: OccupancyMap) -> Boxes:
    return plan_obstacles(THREE, grid, straight(10.0), 0.22, seed=1)


def corners(obstacle: Mover, seconds: float) -> np.ndarray:
    (pose,) = obstacle.poses(np.array([seconds]))
    return obstacle.mesh.triangles.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]


def gap(place: np.ndarray, obstacle: Mover, seconds: float) -> float:
    """Distance of a place on the ground to a box: both seen from the box's middle."""
    low, high = (edge(corners(obstacle, seconds)[:, :2], axis=0) for edge in (np.min, np.max))
    x, y = place - (low + high) / 2
    c, s = np.cos(obstacle.track.yaw[0]), np.sin(obstacle.track.yaw[0])
    half = np.abs(obstacle.mesh.triangles[..., :2]).max(axis=(0, 1))
    beyond = np.abs([c * x + s * y, c * y - s * x]) - half
    return float(np.linalg.norm(beyond.clip(min=0)))


def test_boxes_keep_clear_of_walls_furniture_and_each_other(obstacles: Boxes) -> None:
    for first, second in combinations(obstacles, 2):
        apart = np.linalg.norm(first.track.places - second.track.places, axis=1)
        assert apart.min() > first.track.radius_m + second.track.radius_m
    for obstacle in obstacles:
        for seconds in np.linspace(0, 10, 41):
            x, y, _ = corners(obstacle, seconds).T
            assert np.abs(x).max() < 6 and np.abs(y).max() < 4
            red = (x > 2) & (x < 3) & (np.abs(y) < 0.5)
            blue = (x > -3) & (x < -2) & (y > 2) & (y < 3)
            assert not (red | blue).any()


def test_boxes_move_at_their_speed_and_keep_their_distance_from_the_robot(obstacles: Boxes) -> None:
    way = straight(10.0)
    for seconds in np.linspace(0, 10, 301):
        x, y, _ = way.places(seconds)
        for obstacle in obstacles:
            apart = gap(np.array([x, y]), obstacle, seconds)
            assert apart > 0.22 + THREE.distance_m - 1e-6
    for obstacle in obstacles:
        moves = np.diff(obstacle.track.places, axis=0)
        speed = np.linalg.norm(moves, axis=1) / np.diff(obstacle.seconds)
        assert speed.max() < THREE.speed_m_s * 1.01
        assert speed.mean() > THREE.speed_m_s / 2
        along = moves @ (np.cos(obstacle.track.yaw[0]), np.sin(obstacle.track.yaw[0]))
        assert np.allclose(np.abs(along), np.linalg.norm(moves, axis=1))


def test_a_box_waits_or_turns_back_where_the_robot_comes(grid: OccupancyMap) -> None:
    way, gave_way = straight(10.0), 0
    for seed in range(12):
        (box,) = plan_obstacles(ObstacleConfig(number=1), grid, way, 0.22, seed)
        x, y, _ = way.places(box.seconds)
        apart = np.linalg.norm(box.track.places - np.stack([x, y], axis=1), axis=1)
        assert apart.min() > box.track.radius_m + 0.22 + THREE.distance_m
        along = box.track.places @ (np.cos(box.track.yaw[0]), np.sin(box.track.yaw[0]))
        moves = np.diff(along)
        ahead = moves[:-1] * moves[1:] > 1e-9
        inside = (along > along.min() + 0.06) & (along < along.max() - 0.06)
        # Between the ends of what it drives, it stops or turns for the robot alone.
        stops = inside[1:-1] & ~ahead
        gave_way += bool(stops.any())
        assert not stops.any() or apart[1:-1][stops].min() < 2.5
    assert gave_way >= 2


def test_the_same_seed_plans_the_same_boxes(grid: OccupancyMap) -> None:
    first, again, other = (
        plan_obstacles(THREE, grid, straight(10.0), 0.22, seed=seed) for seed in (1, 1, 2)
    )
    for a, b, c in zip(first, again, other, strict=True):
        assert np.array_equal(a.track.places, b.track.places)
        assert np.array_equal(a.mesh.triangles, b.mesh.triangles)
        assert not np.array_equal(a.track.places, c.track.places)


def test_an_error_says_for_how_many_boxes_there_is_room(grid: OccupancyMap) -> None:
    config = ObstacleConfig(number=25, size_m=(1.5, 1.5, 1.0))
    with pytest.raises(DataError, match=r"obstacles\.number", check=has_code("no-room", 25)):
        plan_obstacles(config, grid, straight(10.0), 0.22, seed=1)


def test_sensors_see_whatever_is_nearer_and_know_its_number() -> None:
    scene = hall().visual
    rest = RayCaster(scene)
    front = block("box", (0.5, -0.3, 0), (1.0, 0.3, 1.2)).mesh
    hidden = block("box", (2.2, -0.3, 0), (2.8, 0.3, 1.0)).mesh  # in the red pillar
    bodies = [Body(mesh, [speckles()], scene.light) for mesh in (hidden, front)]
    crowd = Crowd(rest, scene, bodies, [np.eye(4)[None]] * 2)
    config = LidarMount(rings=1, top_deg=0, bottom_deg=0, azimuths=360)
    place = np.eye(4)
    place[2, 3] = 0.5
    rays = lidar_rays(config)
    hits = crowd.cast(place[:3, 3].astype(np.float32), rays)
    alone = rest.cast(place[:3, 3].astype(np.float32), rays)
    boxed = (rays[:, 0] > 0) & (np.abs(rays[:, 1] / rays[:, 0]) < 0.3 / 0.5 - 1e-6)
    assert np.allclose(hits.distance[boxed], 0.5 / rays[boxed, 0], atol=1e-5)
    assert np.array_equal(hits.distance[~boxed], alone.distance[~boxed])
    number = crowd.objects(hits)
    assert set(number[boxed]) == {len(scene.names) + 2}
    assert np.array_equal(number[~boxed], rest.part_of(alone)[~boxed] + 1)
    for values in (lambda c, h: c.brightness(h), lambda c, h: c.incidence(h, rays)):
        assert np.array_equal(values(crowd, hits)[~boxed], values(rest, alone)[~boxed])
    both = [caster.colors(found, rays, 0.01) for caster, found in ((crowd, hits), (rest, alone))]
    assert np.array_equal(both[0][~boxed], both[1][~boxed])
    assert not np.allclose(both[0][boxed], both[1][boxed], atol=0.05)
    assert len(scan(crowd, config, place, np.random.default_rng(0)).points) > 300
