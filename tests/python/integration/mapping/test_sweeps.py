# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that a turning robot bent are straightened along the solved path of their map."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from error_codes import has_code
from fusionslam import Cloud, DataError
from fusionslam.geometry.se3 import exp, inverse, log, motion_size
from fusionslam.mapping.clouds import pack_cloud, unpack_cloud
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import StoredCloud, StoredFrames, StoredKeyframe
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.mapping.sweeps import SolvedSweeps
from fusionslam.registration.clouds import pack_arrays, pack_points
from fusionslam.sensors.frame import Frame
from rows import rows
from streets import OPTIONS

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

Floats = NDArray[np.float64]

STEP_S, SWEEP_S = 0.4, 0.1
TWIST = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 1.0])
"""Metres and radians a second: a circle of half a metre."""
WALLS = np.array([4.0, 3.0, -3.5, -2.5])
"""x, y, x, y of the walls of a room."""
ROUNDED_M = np.sqrt(3) / 256 + 0.004
"""Of stored coordinates, and of 1/255 of a sweep 4 m away."""


def pose_at(seconds: Any) -> Floats:
    """world_from_robot."""
    return exp(np.asarray(seconds)[..., None] * TWIST)


def sweep(number: int) -> tuple[Floats, Floats]:
    """Places in the room that a spinning scanner hits, (N, 3), and when, after its stamp."""
    columns = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    heights = np.linspace(-0.3, 0.3, 7)
    azimuths, slopes = (grid.ravel() for grid in np.meshgrid(columns, heights, indexing="ij"))
    seconds = azimuths / (2 * np.pi) * SWEEP_S
    poses = pose_at(number * STEP_S + seconds)
    rays = np.stack([np.cos(azimuths), np.sin(azimuths), slopes], axis=1)
    rays = np.einsum("nij,nj->ni", poses[:, :3, :3], rays)
    starts = poses[:, :3, 3]
    with np.errstate(divide="ignore"):
        reach = np.stack([(w - starts[:, k % 2]) / rays[:, k % 2] for k, w in enumerate(WALLS)])
    reach[reach <= 0] = np.inf
    return starts + reach.min(axis=0)[:, None] * rays, seconds


def seen(number: int, *, undone: bool = False) -> Cloud:
    """A keyframe's cloud: as measured, or undone by a driver that still publishes times."""
    places, seconds = sweep(number)
    back = inverse(pose_at(number * STEP_S + (0 if undone else seconds)))
    back = np.broadcast_to(back, (len(places), 4, 4))
    points = np.einsum("nij,nj->ni", back[:, :3, :3], places) + back[:, :3, 3]
    return Cloud(points.astype(np.float32), seconds=seconds)


def solved(odometry_turns: float) -> MapContent:
    """Five keyframes where they truly are, though odometry turned too far."""
    twist = TWIST * [1, 1, 1, 1, 1, odometry_turns]
    numbers = np.arange(5)
    odometry = exp(numbers[:, None] * STEP_S * twist)
    keyframes = [
        StoredKeyframe(k, 1, k, round(1e9 * (5 + k * STEP_S)), odometry[k], np.eye(4))
        for k in numbers.tolist()
    ]
    step = exp(STEP_S * twist)
    edges = [Edge(k, "odometry", k, k + 1, step, np.eye(6) * 1e-4, "believed") for k in range(4)]
    poses = pose_at(numbers * STEP_S)
    return MapContent({"a": 1}, keyframes, edges, (numbers, poses, np.zeros(5, np.int64)))


def no_frames(_: int) -> StoredFrames:
    """Of maps in which each frame is a keyframe."""
    return StoredFrames(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 6)))


def straightened(clouds: list[Cloud], odometry_turns: float = 1.3) -> SolvedSweeps:
    packed = [StoredCloud(b"", None, 0.0, pack_cloud(each, 0.02)) for each in clouds]
    return SolvedSweeps(solved(odometry_turns), packed.__getitem__, no_frames)


def off_walls(cloud: Cloud, number: int) -> Floats:
    """Distances of points to the nearest wall, metres, (N,)."""
    pose = pose_at(number * STEP_S)
    places = cloud.points @ pose[:3, :3].T + pose[:3, 3]
    off = np.abs(places[:, [0, 1, 0, 1]] - WALLS)
    nearest: Floats = off.min(axis=1)
    return nearest


def test_points_are_where_the_truth_has_them_however_odometry_turned() -> None:
    sweeps = straightened([seen(number) for number in range(5)])
    for number in range(5):  # the first and the last have one neighbour
        assert np.percentile(off_walls(sweeps.stored(number), number), 90) > 0.1
        assert off_walls(sweeps.cloud(number), number).max() < ROUNDED_M + 0.02  # corners
        assert np.percentile(off_walls(sweeps.cloud(number), number), 95) < ROUNDED_M


def test_clouds_that_a_driver_straightened_stay_to_the_bit() -> None:
    sweeps = straightened([seen(number, undone=True) for number in range(5)])
    for number in range(5):
        assert sweeps.cloud(number) is sweeps.stored(number)
        assert off_walls(sweeps.cloud(number), number).max() < ROUNDED_M + 0.02


def test_clouds_without_times_stay_and_are_stored_as_before() -> None:
    cloud = replace(seen(2), seconds=None)
    sweeps = straightened([cloud] * 5)
    assert sweeps.cloud(2) is sweeps.stored(2)
    points = sweeps.cloud(2).points
    assert pack_cloud(cloud, 0.02) == pack_arrays({"points": pack_points(points)})


def test_a_robot_that_stands_changes_nothing() -> None:
    content = solved(1.0)
    still = [each._replace(odometry=np.eye(4)) for each in content.keyframes]
    poses = np.tile(np.eye(4), (5, 1, 1))
    edges = [replace(each, pose=np.eye(4)) for each in content.edges.values()]
    content = MapContent({"a": 1}, still, edges, (np.arange(5), poses, np.zeros(5, np.int64)))
    packed = StoredCloud(b"", None, 0.0, pack_cloud(seen(0), 0.02))
    sweeps = SolvedSweeps(content, lambda _: packed, no_frames)
    assert sweeps.cloud(2) is sweeps.stored(2)


def test_times_of_points_come_back_to_half_a_tick() -> None:
    cloud = seen(0)
    assert cloud.seconds is not None
    shifted = replace(cloud, seconds=cloud.seconds - 0.07)
    packed = unpack_cloud(pack_cloud(shifted, 1e-3))
    assert packed.seconds is not None and shifted.seconds is not None
    np.testing.assert_allclose(packed.seconds, shifted.seconds, atol=0.51 * SWEEP_S / 255)


def test_the_time_of_a_voxel_is_the_mean_of_its_points() -> None:
    points = np.array([[1, 0, 0], [1.02, 0, 0], [3, 0, 0]], np.float32)
    packed = pack_cloud(Cloud(points, seconds=np.array([0.0, 0.08, 0.1])), 0.1)
    seconds = unpack_cloud(packed).seconds
    np.testing.assert_allclose(seconds, [0.04, 0.1], atol=0.1 / 255)


@rows("seconds", [np.nan, 1.6e9, 0.0])
def test_times_that_are_of_no_sweep_are_not_kept(seconds: float) -> None:
    cloud = seen(0)
    times = np.full(len(cloud), seconds)
    assert unpack_cloud(pack_cloud(replace(cloud, seconds=times), 0.1)).seconds is None


@rows(
    "name, value",
    [
        ("ticks", None),
        ("ticks", np.zeros(2, np.uint8)),
        ("ticks", np.zeros(3, np.int64)),
        ("span", None),
        ("span", np.zeros(3)),
        ("span", np.array([0.1, 0.0])),
        ("span", np.array([0.0, np.nan])),
        ("span", np.array([0.0, 60.0])),
    ],
)
def test_damaged_times_are_refused(name: str, value: Any) -> None:
    arrays = {
        "points": np.zeros((3, 3), np.int16),
        "ticks": np.zeros(3, np.uint8),
        "span": np.array([0.0, 0.1]),
    }
    assert unpack_cloud(pack_arrays(arrays)).seconds is not None
    arrays.pop(name)
    if value is not None:
        arrays[name] = value
    with pytest.raises(DataError, check=has_code("damaged")):
        unpack_cloud(pack_arrays(arrays))


def test_frames_between_keyframes_tell_how_the_robot_turned() -> None:
    """It turns to and fro, and is back at each keyframe; its odometry drifts meanwhile."""

    def turned(seconds: Any, drift: float = 0.0) -> Floats:
        yaw = 0.3 * np.sin(2 * np.pi * np.asarray(seconds) / STEP_S) + drift * np.asarray(seconds)
        return exp(yaw[..., None] * np.array([0, 0, 0, 0, 0, 1.0]))

    stamps = np.arange(5) * STEP_S
    between = np.arange(1, 8) * 0.05
    keyframes = [
        StoredKeyframe(k, 1, k, round(1e9 * (5 + stamps[k])), turned(stamps[k], 0.1), np.eye(4))
        for k in range(5)
    ]
    step = inverse(turned(0.0, 0.1)) @ turned(STEP_S, 0.1)
    edges = [Edge(k, "odometry", k, k + 1, step, np.eye(6), "believed") for k in range(4)]
    solution = np.arange(5), turned(stamps), np.zeros(5, np.int64)
    content = MapContent({"a": 1}, keyframes, edges, solution)
    wall = np.random.default_rng(0).uniform(-3, 3, (4000, 3)) * [0, 1, 0.1] + [5, 0, 0]
    seconds = np.linspace(0, SWEEP_S, len(wall))
    bent = np.einsum("nji,nj->ni", turned(seconds)[:, :3, :3], wall).astype(np.float32)
    motions = log(inverse(turned(0.0, 0.1)) @ turned(between, 0.1))
    packed = StoredCloud(b"", None, 0.0, pack_cloud(Cloud(bent, seconds=seconds), 0.02))

    def passed(number: int) -> StoredFrames:
        stamps_ns = np.rint(1e9 * (5 + stamps[number] + between)).astype(np.int64)
        return StoredFrames(np.arange(7), stamps_ns, motions)

    for frames_after in (passed, no_frames):
        sweeps = SolvedSweeps(content, lambda _: packed, frames_after)
        assert np.ptp(sweeps.stored(2).points[:, 0]) > 0.5
        off = np.abs(sweeps.cloud(2).points[:, 0] - 5.0).max()
        assert off < 0.06 if frames_after is passed else off > 0.5


def test_steps_are_measured_anew_by_straight_clouds_and_what_was_measured_stays(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.fsmap"
    with PlaceMap.open(path, "a", **OPTIONS) as site:
        for number in range(5):
            cloud = seen(number)
            frame = Frame(
                index=number,
                stamp_ns=round(1e9 * (5 + number * STEP_S)),
                points=cloud.points,
                point_seconds=cloud.seconds,
                odometry=exp(number * STEP_S * TWIST * 1.03),
            )
            assert site.add(frame).keyframe == number
        stored = [site.file.cloud(number) for number in range(5)]
        bent = turned_off(site)
        site.solve()
        assert min(bent) > 0.2 and max(turned_off(site)) < 0.05
        assert [site.file.cloud(number) for number in range(5)] == stored
        poses, exported = site.trajectory("a")[1], site.cloud(0.05).points
    with PlaceMap.open(path, read_only=True) as site:
        np.testing.assert_array_equal(site.trajectory("a")[1], poses)
        np.testing.assert_array_equal(site.cloud(0.05).points, exported)
        assert site.check() == []
    assert np.percentile(off_walls(Cloud(exported), 0), 95) < 0.03


def turned_off(site: PlaceMap) -> list[float]:
    """Degrees by which the steps that clouds measure are off."""
    true = pose_at(STEP_S)
    steps = [edge for edge in site.edges if edge.kind == "loop" and edge.b - edge.a == 1]
    assert len(steps) == 4
    return [motion_size(inverse(true) @ edge.pose)[1] for edge in steps]
