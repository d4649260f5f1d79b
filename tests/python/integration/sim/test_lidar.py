# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated LiDAR: where its rays go, what comes back, and when."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from benchmarks.accuracy.recordings import SHAPES, range_errors, rays_apart
from fusionslam.errors import ConfigError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.messages import Scan
from fusionslam.sim.lidar import LidarMount, Sweep, column_seconds, lidar_rays, point_fields, scan
from fusionslam.sim.robot import base_from, robot_named
from fusionslam.sim.scene import RayCaster
from rows import rows
from worlds import hall

CALM = {"noise_m": 0.0, "dropout": 0.0, "grazing_dropout": 0.0, "far_dropout": 0.0}


@pytest.fixture(scope="module")
def caster() -> RayCaster:
    return RayCaster(hall().collision)


def pose(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, z: float = 0.5) -> np.ndarray:
    placed = ground_poses(np.array([x]), np.array([y]), np.array([yaw]))[0]
    placed[2, 3] = z
    return placed


def swept(caster: RayCaster, poses: np.ndarray, seed: int = 0, **values: object) -> Sweep:
    config = LidarMount(**(CALM | {"rings": 3, "top_deg": 10, "bottom_deg": -20} | values))
    return scan(caster, config, poses, np.random.default_rng(seed))


def hall_ranges(place: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Ranges to floor, walls and red pillar of the hall by slabs, without a ray caster."""
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = (np.array([(-6.0, -4.0), (6.0, 4.0)])[:, None] - place[:2]) / rays[:, :2]
        walls = np.where(sides > 0, sides, np.inf).min(axis=(0, 2))
        floor = np.where(rays[:, 2] < 0, -place[2] / rays[:, 2], np.inf)
        slabs = (np.array([(2, -0.5, 0), (3, 0.5, 1.5)])[:, None] - place) / rays
        enter, leave = slabs.min(axis=0).max(axis=1), slabs.max(axis=0).min(axis=1)
    pillar = np.where((enter < leave) & (enter > 0), enter, np.inf)
    return np.minimum(np.minimum(walls, floor), pillar)


def test_ranges_are_those_of_a_hall_worked_out_by_hand(caster: RayCaster) -> None:
    config = LidarMount(**CALM, rings=8, azimuths=360, top_deg=5, bottom_deg=-30)
    place = pose(-1.3, 0.7, 0.4)
    rays = lidar_rays(config) @ place[:3, :3].T
    expected = hall_ranges(place[:3, 3], rays)
    sweep = scan(caster, config, place, np.random.default_rng(0))
    found = np.full(len(rays), np.inf)
    found[sweep.ray] = np.linalg.norm(sweep.points, axis=1)
    # Above 2 m the walls end; where they do, rays fly out or on.
    below = place[2, 3] + rays[:, 2] * expected < 1.99
    assert below.mean() > 0.9
    assert np.allclose(found[below], expected[below], atol=1e-4)


def test_the_sector_is_that_of_the_independent_recordings(test_data: Path) -> None:
    robot = robot_named("turtlebot3_waffle_pi")
    (config,) = robot.lidars.values()
    with np.load(test_data / "recordings" / "warehouse.npz") as recorded:
        place = recorded["lidar_xyz"]
    assert rays_apart(test_data, "warehouse") < 1e-6
    assert np.allclose(base_from(robot, config.frame_id)[:3, 3], place, atol=1e-9)


def test_a_vlp16_has_sixteen_rings_two_degrees_apart_all_round() -> None:
    config = robot_named("turtlebot3_vlp16").lidars["velodyne"]
    rays = lidar_rays(config)
    elevation = np.rad2deg(np.arcsin(rays[:, 2])).reshape(16, -1)
    assert np.allclose(elevation[:, 0], np.arange(15, -16, -2), atol=1e-4)
    turn = np.unwrap(np.arctan2(rays[:900, 1], rays[:900, 0]))
    assert np.allclose(np.diff(turn), -2 * np.pi / 900, atol=1e-5)


def test_noise_lies_along_the_ray_with_the_configured_deviation(caster: RayCaster) -> None:
    clean = swept(caster, pose(), rings=16, azimuths=900)
    noisy = swept(caster, pose(), rings=16, azimuths=900, noise_m=0.03)
    assert np.array_equal(clean.ray, noisy.ray)
    error = np.linalg.norm(noisy.points, axis=1) - np.linalg.norm(clean.points, axis=1)
    assert error.std() == pytest.approx(0.03, rel=0.03)
    assert abs(error.mean()) < 5 * 0.03 / np.sqrt(len(error))
    across = np.cross(clean.points, noisy.points)
    assert np.abs(across).max() < 1e-4


def test_shots_are_lost_at_the_configured_share_and_beyond_the_ranges(caster: RayCaster) -> None:
    whole, some = (
        swept(caster, pose(), rings=16, azimuths=900, dropout=share) for share in (0, 0.1)
    )
    assert 1 - len(some.ray) / len(whole.ray) == pytest.approx(0.1, abs=0.01)
    limits = {"min_range_m": 1.5, "range_m": 4.5}
    whole, cut = swept(caster, pose()), swept(caster, pose(), **limits)
    far = np.linalg.norm(whole.points, axis=1)
    inside = (far >= 1.5) & (far < 4.5)
    assert 0 < inside.sum() < len(far)
    assert np.array_equal(cut.ray, whole.ray[inside])


def test_a_turn_shoots_each_column_from_its_own_place(caster: RayCaster) -> None:
    still = swept(caster, pose(), azimuths=90)
    moving = swept(caster, np.tile(pose(), (90, 1, 1)), azimuths=90)
    assert np.array_equal(still.points, moving.points)
    values = {"azimuths": 90, "rate_hz": 10.0, "scan_motion": True}
    seconds = column_seconds(LidarMount(**values))
    poses = np.array([pose(-2 + 2.0 * s, 0.5, 1.5 * s) for s in seconds])
    sweep = swept(caster, poses, **values)
    for column in (0, 17, 45, 89):
        alone = swept(caster, poses[column], **values)
        mine, its = (s.points[s.ray % 90 == column] for s in (sweep, alone))
        assert np.allclose(mine, its, atol=1e-6)
    # Put back to where each was shot from, all lie on the hall's surfaces.
    placed = poses[sweep.ray % 90]
    world = np.einsum("nij,nj->ni", placed[:, :3, :3], sweep.points) + placed[:, :3, 3]
    gaps = np.abs(np.stack([np.abs(world[:, 0]) - 6, np.abs(world[:, 1]) - 4, world[:, 2]]))
    pillar = np.linalg.norm(np.abs(world[:, :2] - (2.5, 0)).clip(min=0.5) - 0.5, axis=1)
    assert np.minimum(gaps.min(axis=0), pillar).max() < 1e-3


@rows("sector", [None, (-0.5, 0.5)])
def test_columns_are_shot_in_the_time_of_a_full_turn(sector: tuple[float, float] | None) -> None:
    config = LidarMount(azimuths=100, rate_hz=5.0, sector_rad=sector)
    seconds = column_seconds(config)
    last = 0.2 * (99 / 100 if sector is None else 1.0 / (2 * np.pi))
    assert seconds[0] == 0 and seconds[-1] == pytest.approx(last)
    assert np.allclose(np.diff(seconds), seconds[1])


def test_points_carry_the_fields_that_are_asked_for(caster: RayCaster) -> None:
    stamp_ns = 1_700_000_000_250_000_000
    fields = ("object", "ring", "time", "intensity", "t", "offset_time", "timestamp", "moving")
    config = LidarMount(**CALM, rings=4, azimuths=30, fields=fields, scan_motion=True)
    sweep = scan(caster, config, pose(), np.random.default_rng(0))
    objects = (caster.part_of(sweep.hits) + 1).astype(np.uint16)
    moving = np.arange(len(objects)) % 2 == 0
    values = point_fields(config, sweep, objects, moving, stamp_ns)
    kinds = {"object": "<u2", "ring": "<u2", "time": "<f4", "intensity": "<f4"}
    kinds |= {"t": "<u4", "offset_time": "<u4", "timestamp": "<f8", "moving": "|u1"}
    assert [(name, array.dtype.str) for name, array in values.items()] == [*kinds.items()]
    height = sweep.points[:, 2] / np.linalg.norm(sweep.points, axis=1)
    rings = np.deg2rad(np.linspace(config.bottom_deg, config.top_deg, 4))
    assert np.allclose(np.sin(rings)[values["ring"]], height, atol=1e-5)
    turn = np.mod(-np.arctan2(sweep.points[:, 1], sweep.points[:, 0]), 2 * np.pi)
    assert np.allclose(values["time"], turn / (2 * np.pi) / config.rate_hz, atol=1e-5)
    for name in ("time", "t", "offset_time", "timestamp"):
        each = Scan(
            stamp_ns=stamp_ns, frame_id="", points=sweep.points, fields={name: values[name]}
        )
        assert each.point_seconds is not None and not each.point_times.remark
        np.testing.assert_allclose(each.point_seconds, values["time"], atol=1e-6)
    assert np.array_equal(values["moving"], moving)
    assert values["intensity"].min() >= 0 and values["intensity"].max() <= 1
    names = np.array(["", *hall().collision.names])[values["object"]]
    floor = np.abs(sweep.points[:, 2] + 0.5) < 1e-4
    assert set(names[floor]) == {"floor"} and "floor" not in set(names[~floor])
    assert set(names[sweep.points[:, 0] > 5.99]) <= {"east", "floor"}
    still = config.model_copy(update={"scan_motion": False})
    sweep = scan(caster, still, pose(), np.random.default_rng(0))
    none = np.zeros(0, np.uint16), np.zeros(0, bool)
    assert not point_fields(still, sweep, *none, stamp_ns)["time"].any()


@rows(
    "values, message",
    [
        ({"top_deg": -10.0, "bottom_deg": 10.0}, r"bottom_deg .*\b10\.0.* top_deg -10\.0"),
        ({"min_range_m": 5.0, "range_m": 5.0}, "min_range_m is 5.0, range_m only 5.0"),
        ({"sector_rad": (-4.0, 4.0)}, r"sector_rad .*\(-4\.0, 4\.0\)"),
        ({"rate_hz": 0.0}, "rate_hz"),
        ({"shapes": "both"}, "'collision' or 'visual'"),
        ({"fields": ("color",)}, "fields"),
    ],
)
def test_a_lidar_that_cannot_be_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        LidarMount(**values)


@pytest.mark.parametrize(
    "name", ["warehouse", pytest.param("small_house", marks=pytest.mark.nightly)]
)
def test_ranges_agree_with_an_independent_simulator(test_data: Path, name: str) -> None:
    for shapes in SHAPES:
        error = range_errors(test_data, name, shapes, every=100)
        # Theirs have noise of 0.008 m, of which 99.7 % lies within three deviations.
        assert len(error) > 5_000
        assert np.mean(np.abs(error) < 0.024) > 0.995
        near = error[np.abs(error) < 0.04]
        assert near.std() == pytest.approx(0.008, rel=0.05) and abs(near.mean()) < 3e-4
