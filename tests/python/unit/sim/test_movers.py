# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Things that move are where they should be at each ray's own time, and look as standing ones."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sim.lidar import LidarMount, column_seconds, scan
from fusionslam.sim.mesh import join_meshes
from fusionslam.sim.motion.giving_way import Track, choose_moves, find_meetings
from fusionslam.sim.movers import Body, Crowd, Mover
from fusionslam.sim.obstacles import speckles
from fusionslam.sim.scene import Light, RayCaster, Scene
from rows import rows
from worlds import PLAIN, block, hall

HALF = np.array([1.0, 0.5, 0.8])
BOX = block("box", (-1.0, -0.5, 0.0), (1.0, 0.5, 1.6), (0.9, 0.4, 0.2)).mesh


def driving(speed: float, turn: float) -> Mover:
    """A box on a line from (-3, 2.5) along x, which turns on the spot meanwhile."""
    seconds = np.arange(0.0, 2.01, 0.1)
    places = np.stack([-3 + speed * seconds, np.full(len(seconds), 2.5)], axis=1)
    return Mover(BOX, [PLAIN], seconds, Track(places, turn * seconds, 1.2), 0.1 * seconds)


def test_a_mover_is_where_its_speed_takes_it_and_stands_before_and_after() -> None:
    mover = driving(2.0, 0.5)
    times = np.array([-1.0, 0.0, 0.333, 1.75, 2.0, 5.0])
    within = times.clip(0, 2)
    expected = ground_poses(-3 + 2 * within, np.full(6, 2.5), 0.5 * within)
    expected[:, 2, 3] = 0.1 * within
    np.testing.assert_allclose(mover.poses(times), expected, atol=1e-12)


def test_points_lie_on_the_mover_at_their_own_time() -> None:
    mover, scene = driving(8.0, 3.0), hall().visual
    clear = {"noise_m": 0.0, "dropout": 0.0, "grazing_dropout": 0.0, "far_dropout": 0.0}
    config = LidarMount(**clear, rings=16, azimuths=360, scan_motion=True)
    times = column_seconds(config)
    lidar = ground_poses(0.4 * times, -0.1 * times, 0.8 * times)
    lidar[:, 2, 3] = 1.0
    poses = mover.poses(times)
    crowd = Crowd(RayCaster(scene), scene, [Body(mover.mesh, [PLAIN], scene.light)], [poses])
    sweep = scan(crowd, config, lidar, np.random.default_rng(0))
    moving = crowd.moving(sweep.hits)
    assert 100 < moving.sum() < len(moving) / 2
    assert np.array_equal(moving, crowd.objects(sweep.hits) == len(scene.names) + 1)
    column = sweep.ray[moving] % 360

    def outside(then: np.ndarray) -> np.ndarray:
        """How far points are from the box's surface where it is in these poses."""
        at = lidar[column]
        world = np.einsum("nij,nj->ni", at[:, :3, :3], sweep.points[moving]) + at[:, :3, 3]
        own = np.einsum("nji,nj->ni", then[:, :3, :3], world - then[:, :3, 3])
        beyond = np.abs(own - (0, 0, 0.8)) - HALF
        return np.abs(beyond.max(axis=1))

    assert outside(poses[column]).max() < 1e-4
    assert outside(np.broadcast_to(poses[0], (len(column), 4, 4))).max() > 0.1
    assert np.abs(mover.poses(times)[column, 0, 3] + 3).max() > 0.1


@rows("yaw, sun", [(0.7, (0.6, 0.0, 0.8)), (-2.4, (0.0, -0.8, 0.6))])
def test_a_mover_looks_as_a_part_of_the_world_would(yaw: float, sun: tuple[float, ...]) -> None:
    light = Light(sun_direction=(sun[0], sun[1], sun[2]))
    scene = replace(hall().visual, textures=[speckles()], light=light)
    pose = ground_poses(np.array([-1.0]), np.array([2.0]), np.array([yaw]))
    crowd = Crowd(RayCaster(scene), scene, [Body(BOX, [speckles()], light)], [pose])
    whole = RayCaster(
        Scene(join_meshes([scene.mesh, BOX.move((-1.0, 2.0, 0.0), yaw)]), [speckles()], light)
    )
    rays = np.random.default_rng(3).standard_normal((12000, 3)).astype(np.float32)
    origin = np.array([1.0, -1.0, 0.9], np.float32)
    hits, expected = crowd.cast(origin, rays), whole.cast(origin, rays)
    on_box = expected.triangle >= len(scene.mesh)
    assert on_box.sum() > 100
    # At edges, rounding decides which surface a ray hits.
    same = crowd.moving(hits) == on_box
    assert same.mean() > 0.999
    np.testing.assert_allclose(hits.distance[same], expected.distance[same], rtol=1e-4)
    values = [
        (caster.incidence(found, rays), caster.colors(found, rays, 0.01))
        for caster, found in ((crowd, hits), (whole, expected))
    ]
    for mine, its in zip(*values, strict=True):
        assert np.abs(mine - its)[same].max(initial=0) < 0.02


def test_lines_of_discs_meet_where_the_lines_come_near() -> None:
    rng = np.random.default_rng(5)
    # At one place, so that no step makes the lines longer.
    path = Track(np.zeros((60, 2)), rng.uniform(-3, 3, 60), 0.6, 1.5)
    still = [
        Track(np.tile([x, y], (3, 1)), np.full(3, yaw), 0.5, 2.0)
        for x, y, yaw in rng.uniform(-3, 3, (2, 3))
    ]

    def gap(one: Track, k: int, other: Track) -> float:
        """Between two line segments, sampled densely."""
        ends = []
        for track, row in ((one, k), (other, 0)):
            along = np.linspace(-track.half_m, track.half_m, 81)[:, None]
            ahead = (np.cos(track.yaw[row]), np.sin(track.yaw[row]))
            ends.append(track.places[row] + along * np.array(ahead))
        return float(np.linalg.norm(ends[0][:, None] - ends[1][None], axis=2).min())

    meets = find_meetings(path, still)
    gaps = np.array([min(gap(path, k, other) for other in still) for k in range(60)])
    assert meets.any() and not meets.all()
    assert not (meets & (gaps > 1.1)).any()
    # Between two discs, which are up to 1 m apart, lines may come nearer: by half of that each.
    assert (meets | (gaps > 1.1 - np.hypot(0.5, 0.5))).all()


@rows("closed", [False, True])
def test_moves_never_meet_and_never_jump(closed: bool) -> None:
    rng = np.random.default_rng(2)
    meets = np.zeros((80, 30), bool)
    for start in (5, 35, 60):
        # One crosses the path at three places, 8 steps long each.
        meets[start : start + 8, rng.integers(30) :][:, :3] = True
    moves = choose_moves(meets, np.random.default_rng(0), closed=closed)
    assert moves is not None
    assert not meets[np.arange(80), moves].any()
    steps = np.diff(moves)
    steps = (steps + 15) % 30 - 15 if closed else steps
    assert set(steps.tolist()) <= ({0, 1} if closed else {-1, 0, 1})
    assert (steps != 0).mean() > 0.5
    assert choose_moves(np.ones((80, 30), bool), rng, closed=closed) is None
